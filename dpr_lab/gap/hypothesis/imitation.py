"""Detection of effects that only fit the residual of other causes, and of curves that imitate a removed effect."""

import math

from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis, explained, log_prior_ratio
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


def follows_remainder(bare: Hypothesis, larger: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve, vibration or drift only fits the remainder of small unknown causes."""
    if follows_swing(bare, larger, simple) or follows_decay(bare, larger, simple):
        return True
    return curve_follows_remainder(bare, larger, simple)


def curve_follows_remainder(bare: Hypothesis, with_curve: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve only fits the small remainder of unknown causes.

    Three conditions must hold: the simpler set explains nearly as much, its remainder is below the noise, and the curve
    is not significant if this remainder is treated as noise. A set with far larger prior odds is exempt.
    """
    curves = set(with_curve.curves) - simple.key
    if not curves or not simple.effects or simple.residuals.noise_ratio > 1.0:
        return False
    if log_prior_ratio(with_curve, simple) > math.log(THRESHOLDS.likelier):
        return False
    insignificant = simple.cost - with_curve.cost_at(simple.inflation) < simple.chance
    return insignificant and explained(bare, simple) >= THRESHOLDS.simpler_share * explained(bare, with_curve)


def follows_swing(bare: Hypothesis, vibrating: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a vibration at a multiple of the swing frequency only fits the residual of a missing effect.

    Any missing torque that depends on angle or speed leaves a residual at these frequencies. The vibration is rejected
    if another set reduces the excess by more than half as much.
    """
    if not vibrating.harmonic_vibrations - other.key or not other.effects:
        return False
    return explained(bare, other) > THRESHOLDS.vibration_share * explained(bare, vibrating)


def follows_decay(bare: Hypothesis, drifting: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a friction drift only fits the residual of a missing dissipative effect.

    In a single decay, a dissipative torque that depends on speed looks like a drift of the friction, and every rod has
    such a torque. The drift is rejected if another set without more parameters explains nearly as much.
    """
    if not drifting.decay_drifts - other.key or not other.effects or len(other.fit.free) > len(drifting.fit.free):
        return False
    return explained(bare, other) > THRESHOLDS.simpler_share * explained(bare, drifting)


def substitute_curve(model: Hypothesis, smaller: Hypothesis) -> str | None:
    """Return the curve that imitates the removed effect in a smaller set, or None.

    The amplitudes of such a curve cancel each other, and grow when the effect is removed. For example, an eccentricity
    with large harmonics imitates a zero offset on a small arc, although the offset is the cause.
    """
    if smaller.cost <= model.cost:
        return None
    grown = {
        name: smaller.curves[name] / max(size, PENALTY.ordinary)
        for name, size in model.curves.items()
        if name in smaller.curves
    }
    largest = max(grown, key=lambda name: grown[name], default=None)
    return largest if largest is not None and grown[largest] > THRESHOLDS.curve_growth else None

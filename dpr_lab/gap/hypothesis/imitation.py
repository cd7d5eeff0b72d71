"""Effects that only follow the remainder of other causes.

A curve can also replace a removed effect.
"""

from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


def follows_remainder(bare: Hypothesis, larger: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve, vibration or drift only follows the remainder of small unknown causes."""
    tests = (curve_follows_remainder, follows_swing, follows_decay)
    return any(follows(bare, larger, simple) for follows in tests)


def curve_follows_remainder(bare: Hypothesis, with_curve: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve only follows the small remainder of unknown causes.

    Three conditions must hold: the simpler set explains nearly all that the curve explains, its remainder is below the
    noise, and with this remainder as noise the curve is not significant.
    """
    curves = set(with_curve.curves) - simple.key
    if not curves or not simple.effects or simple.residuals.noise_ratio > 1.0:
        return False
    explained = bare.bounded_excess - with_curve.bounded_excess
    if bare.bounded_excess - simple.bounded_excess < THRESHOLDS.nearly_all * explained:
        return False
    return simple.cost - with_curve.cost_at(simple.inflation) < simple.chance


def follows_swing(bare: Hypothesis, vibrating: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a vibration only follows the residual of a missing law.

    The frequency of such a vibration is a multiple of the frequency of the swing, and another set explains most of this
    residual. Any missing law of angle or speed leaves a residual at these frequencies.
    """
    if not vibrating.harmonic_vibrations - other.key or not other.effects:
        return False
    explained = bare.bounded_excess - vibrating.bounded_excess
    return bare.bounded_excess - other.bounded_excess > THRESHOLDS.most_of_it * explained


def follows_decay(bare: Hypothesis, drifting: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a friction drift only follows the residual of a missing loss.

    The recordings are a single decay, and another set of the same size explains nearly all of this residual. Along a
    decay the amplitude decreases with time. A loss that depends on speed, which every rod has, therefore looks like a
    drift.
    """
    if not drifting.decay_drifts - other.key or not other.effects or len(other.fit.free) > len(drifting.fit.free):
        return False
    explained = bare.bounded_excess - drifting.bounded_excess
    return bare.bounded_excess - other.bounded_excess > THRESHOLDS.nearly_all * explained


def substitute_curve(model: Hypothesis, smaller: Hypothesis) -> str | None:
    """Return the curve of a smaller set that imitates the removed effect, or None.

    The amplitudes of such a curve cancel each other, and grow when the effect is removed. On a small arc, for example,
    an eccentricity with large harmonics imitates a zero offset. This imitation does not make the offset superfluous.
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

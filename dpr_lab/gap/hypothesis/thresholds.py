"""Significance of a reduction of the cost: compared with noise, chance, and the error of an inexact form."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Acceptance thresholds.

    They were set on blind trials below seed 100000 of `benchmarks/diagnosis.py` and tested on others.

    chi2 is counted in units of independent evidence, `ResidualStatistics.inflation`.
    """

    noise_floor: float = 4.0
    """Maximum residual that counts as noise, in standard deviations."""
    far: float = GAUSS_NEWTON.far
    """Fits may end in local minima if chi2 per degree of freedom exceeds this value."""
    chance: float = 30.0
    """Maximum reduction of chi2 that is attributed to chance: the maximum over some 600 shapes."""
    promising: float = 0.5
    """Fraction of the excess that the score of an effect must predict for it to be fitted to a few readings."""
    chance_at_floor: float = 90.0
    """Maximum reduction of chi2 by an additional effect that is attributed to chance if only noise remains."""
    consistent: float = 4.0
    """Standard errors, estimated from the scatter of segments, by which chi2 must fall for a significant reduction
    while a residual remains.
    """
    beyond_chance: float = NORMAL_Q90
    """Difference of two given sets that chance exceeds in 5 % of cases, in standard errors from the scatter of
    segments.
    """
    fewest_segments: int = 10
    """Minimum number of segments for an estimate of their scatter."""
    takes_over: float = 2.0
    """Factor by which the amplitudes of a curve grow if another effect is removed and the curve replaces it."""
    integrator: float = 5e-4
    """Fraction of the explained chi2 that is uncertain because of the integrator's steps."""
    integrator_at_floor: float = 5e-5
    """This fraction if a set leaves only noise, which confirms the steps."""
    slow: float = 1.3
    """Factor by which an additional effect must reduce the excess, unless it is large."""
    keeps: float = 3.0
    """Factor by which the excess must increase without an effect for the effect to be kept."""
    keeps_if_large: float = 1.3
    """A large effect is kept if the excess without it is larger by this factor."""
    large: float = 0.04
    """Maximum fraction of the whole gap that another form of a named effect can explain."""
    small: float = 0.01
    """An effect of less than this fraction of the gap merely compensates for another form, while a residual remains."""
    keeps_if_small: float = 30.0
    """A small effect is kept if the excess without it is larger by this factor."""
    contained: float = 0.003
    """Fraction of the explained chi2 that a richer form of an effect must add while a residual remains."""
    nearly_all: float = 0.9
    """Simple effects replace a curve if they reduce the excess by this fraction of its reduction by the curve, and only
    little remains.
    """
    most_of_it: float = 0.5
    """Minimum reduction of the excess by other effects to replace a vibration at a multiple of the swing's frequency,
    as a fraction of the reduction by the vibration.
    """
    own_share: float = 0.15
    """Minimum fraction of an effect's reduction that no other functional form of the other effects explains, while a
    residual remains.
    """
    secondary: float = 0.1
    """An effect of less than this fraction of the gap may compensate for the form of a larger effect, even if only
    noise remains.
    """
    still_open: float = 0.5
    """Maximum fraction of the gap that the other effects may leave for this test to apply."""
    escaped: float = 10.0
    """Minimum factor by which a repeated fit reduces chi2 if the first one ended in a local minimum."""
    likelier: float = 10.0
    """Minimum ratio of the prior probabilities of the sizes for an indistinguishable effect to replace a named one."""
    indistinguishable: float = 0.999
    """Minimum cosine of the signatures of two effects that a recording hardly distinguishes."""


THRESHOLDS = Thresholds()


def excess(model: Hypothesis) -> float:
    """chi2 above the noise, with the random variation of the noise as lower limit."""
    return max(model.residuals.excess, THRESHOLDS.noise_floor * model.residuals.uncertainty)


def at_noise_floor(model: Hypothesis) -> bool:
    """Whether the residual is consistent with noise."""
    return model.residuals.z < THRESHOLDS.noise_floor


def far_from_noise(model: Hypothesis) -> bool:
    """Whether the residual is so large that a linear score is only an indication."""
    return model.residuals.chi2 > THRESHOLDS.far * model.residuals.dof


def promising_gain(model: Hypothesis) -> float:
    """Predicted reduction of chi2 from which an additional effect is fitted.

    A missing effect inflates the residuals of all readings. With few readings, even the cause of all excess cannot
    reduce chi2 by an amount that is significant for inflated residuals. Such a reduction is not necessary, because the
    residuals are small once the cause is in the model.
    """
    residuals = model.residuals
    inflation = min(residuals.inflation, max(1.0, residuals.chi2 / residuals.dof))
    of_excess = THRESHOLDS.promising * residuals.excess
    return max(THRESHOLDS.chance, min(0.5 * THRESHOLDS.chance * inflation, of_excess))


def substitute_curve(model: Hypothesis, smaller: Hypothesis) -> str | None:
    """The curve of a smaller set that imitates the removed effect by amplitudes that cancel each other; None if none.

    Its amplitudes grow when the effect is removed. On a small arc, for example, an eccentricity with large harmonics
    imitates a zero offset, which does not make the offset superfluous.
    """
    if smaller.cost <= model.cost:
        return None
    grown = {
        name: smaller.curves[name] / max(size, PENALTY.ordinary)
        for name, size in model.curves.items()
        if name in smaller.curves
    }
    largest = max(grown, key=lambda name: grown[name], default=None)
    return largest if largest is not None and grown[largest] > THRESHOLDS.takes_over else None


def follows_remainder(base: Hypothesis, with_curve: Hypothesis, simple: Hypothesis) -> bool:
    """Whether a curve explains, beyond a simpler set, only the small remainder that unknown causes leave on every rig.

    The simpler set explains nearly all that the curve explains, the remainder is below the noise, and with the
    remainder as noise the curve is not significant.
    """
    if follows_swing(base, with_curve, simple) or follows_decay(base, with_curve, simple):
        return True
    curves = set(with_curve.curves) - simple.key
    if not curves or not simple.effects or simple.residuals.noise_ratio > 1.0:
        return False
    explained = excess(base) - excess(with_curve)
    if excess(base) - excess(simple) < THRESHOLDS.nearly_all * explained:
        return False
    inflation = simple.residuals.inflation
    return simple.cost - with_curve.cost_at(inflation) < THRESHOLDS.chance * inflation


def follows_swing(base: Hypothesis, vibrating: Hypothesis, other: Hypothesis) -> bool:
    """Whether a set has a vibration at a multiple of the swing's frequency, and another explains most of its share.

    Any law of angle or speed leaves a residual at these frequencies.
    """
    if not vibrating.on_line - other.key or not other.effects:
        return False
    explained = excess(base) - excess(vibrating)
    return excess(base) - excess(other) > THRESHOLDS.most_of_it * explained


def follows_decay(base: Hypothesis, drifting: Hypothesis, other: Hypothesis) -> bool:
    """Whether a set has a drift of friction along one decay, and another of the same size explains nearly as much.

    Amplitude falls with time along a decay: a loss that depends on speed, as every rod has, looks like a drift.
    """
    if not drifting.of_decay - other.key or not other.effects or len(other.fit.free) > len(drifting.fit.free):
        return False
    explained = excess(base) - excess(drifting)
    return excess(base) - excess(other) > THRESHOLDS.nearly_all * explained


def indifference(
    base: Hypothesis, model: Hypothesis, *, independent: float = THRESHOLDS.chance, share: float = THRESHOLDS.integrator
) -> float:
    """Difference of cost below which two sets are equally good; chance or the integrator's steps can cause it."""
    return max(independent * model.residuals.inflation, share * (base.residuals.chi2 - model.residuals.chi2))


def form_indifference(base: Hypothesis, model: Hypothesis) -> float:
    """Increase of cost up to which a simpler form of an effect replaces a richer one that contains it.

    While a residual remains, a richer form may merely compensate for it; at the noise floor it may follow the error of
    the integrator.
    """
    share = THRESHOLDS.integrator if at_noise_floor(model) else THRESHOLDS.contained
    return indifference(base, model, share=share)


def significance(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Reduction of cost from one set to a larger one that is not significant.

    An effect that follows the noise of a tracker leaves residuals that are less correlated, and the penalty of all
    parameters falls with their inflation. If only noise remains without it, this is no evidence: both sets are compared
    at the inflation of the larger one.
    """
    limit = _significance(base, before, after)
    if at_noise_floor(before):
        limit += max(before.residuals.inflation - after.residuals.inflation, 0.0) * before.penalty
    return limit if at_noise_floor(after) else min(limit, scatter(before, after))


def _significance(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    if not before.effects:
        return THRESHOLDS.chance * after.residuals.inflation
    if at_noise_floor(after) and not at_noise_floor(before):
        return indifference(base, after, share=THRESHOLDS.integrator_at_floor)
    chance = THRESHOLDS.chance_at_floor if at_noise_floor(before) else THRESHOLDS.chance
    return indifference(base, after, independent=chance)


def scatter(before: Hypothesis, after: Hypothesis, errors: float = THRESHOLDS.consistent) -> float:
    """Reduction of chi2 that can occur by chance, from its scatter between segments; inf for too few segments.

    The residual due to small unknown effects is smooth along a segment. If it counted as noise of every reading, a
    cause that improves every segment would not be significant. Segments are therefore the independent units.

    Args:
        before: the set of larger chi2
        after: the other set
        errors: number of standard errors that chance may cause
    """
    reductions = before.fit.linear.chi2_by_segment - after.fit.linear.chi2_by_segment
    if len(reductions) < THRESHOLDS.fewest_segments or not np.isfinite(reductions).all():
        return float("inf")
    return float(errors * np.sqrt(len(reductions) * np.var(reductions, ddof=1)))


def explains_as_much(base: Hypothesis, simple: Hypothesis, rich: Hypothesis) -> bool:
    """Whether a set explains about as much as another one with more parameters, and is therefore preferred.

    It explains nearly all that the richer set explains, and its criterion, which contains the penalty of parameters,
    is not significantly higher. While a residual remains, the difference is compared with its scatter between segments:
    neither set is the exact model, so that the noise of a reading is not the relevant scale of the difference.

    Source: Vuong (1989), Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57,
    307-333.
    """
    if len(simple.fit.free) >= len(rich.fit.free):
        return False
    if excess(base) - excess(simple) < THRESHOLDS.nearly_all * (excess(base) - excess(rich)):
        return False
    margin = indifference(base, rich)
    if not at_noise_floor(rich) and np.isfinite(by_chance := scatter(simple, rich, THRESHOLDS.beyond_chance)):
        margin = max(margin, by_chance)
    return simple.cost - rich.cost < margin


def accepted(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Whether an additional effect explains more than chance and more than an inexact functional form.

    An inexact form leaves a residual. If only noise remains, a significant reduction is sufficient.
    """
    if before.cost - after.cost < significance(base, before, after):
        return False
    return at_noise_floor(before) or at_noise_floor(after) or excess(after) < most_excess(base, before)


def most_excess(base: Hypothesis, before: Hypothesis) -> float:
    """Excess that a set with an additional effect must fall below to be `accepted` while a residual remains."""
    return max(excess(before) / THRESHOLDS.slow, excess(before) - THRESHOLDS.large * excess(base))


def need(base: Hypothesis, model: Hypothesis, smaller: Hypothesis) -> float:
    """Evidence for the effect of `model` that `smaller` lacks, relative to the threshold; 1 is enough to keep it."""
    loss = smaller.cost - model.cost
    if at_noise_floor(model):
        return loss / (THRESHOLDS.chance * model.residuals.inflation)
    growth, factor = smaller.residuals.excess - excess(model), smaller.residuals.excess / excess(model)
    if loss > scatter(smaller, model):  # the effect improves every segment, however small it is next to a large one
        return factor / THRESHOLDS.slow
    if growth < THRESHOLDS.small * excess(base) and factor < THRESHOLDS.keeps_if_small:
        return 0.0
    large = growth > THRESHOLDS.large * excess(base)
    return factor / (THRESHOLDS.keeps_if_large if large else THRESHOLDS.keeps)

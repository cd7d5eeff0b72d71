"""Significance of a reduction of cost, relative to noise, chance, and inexact functional forms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Acceptance thresholds of effects.

    They were set on blind trials with seeds below 100000 of `benchmarks/diagnosis.py` and tested on other seeds. The
    unit of chi2 is `ResidualStatistics.inflation`, the chi2 of one independent reading.
    """

    noise_floor: float = 4.0
    """Maximum residual that counts as noise, in standard deviations."""
    far: float = GAUSS_NEWTON.far
    """chi2 per degree of freedom above which fits may end in local minima."""
    chance: float = 30.0
    """Maximum reduction of chi2 that is attributed to chance: the largest reduction among about 600 shapes."""
    promising: float = 0.5
    """Minimum predicted reduction, as a fraction of the excess, for an effect that is fitted to few readings."""
    chance_at_floor: float = 90.0
    """Maximum reduction of chi2 by an additional effect that is attributed to chance if only noise remains."""
    consistent: float = 4.0
    """Minimum reduction of chi2 that counts as significant while a residual remains.

    The unit is the standard error estimated from the scatter of segments.
    """
    beyond_chance: float = NORMAL_Q90
    """Difference between two given sets that chance exceeds in 5 % of cases.

    The unit is the standard error from the scatter of segments.
    """
    fewest_segments: int = 10
    """Minimum number of segments from which their scatter can be estimated."""
    takes_over: float = 2.0
    """Minimum growth factor of the amplitudes of a curve that replaces a removed effect."""
    integrator: float = 5e-4
    """Fraction of the explained chi2 that is uncertain because of the steps of the integrator."""
    integrator_at_floor: float = 5e-5
    """Fraction like `integrator` for a set that leaves only noise, which confirms that the steps are small enough."""
    explained: float = 0.93
    """Minimum share of the excess of the bare model that a set must explain to be the explanation of the gap.

    In blind trials, correct sets explained at least 0.97 of the excess, and sets from a library without the cause at
    most 0.91.
    """
    slow: float = 1.3
    """Minimum factor by which an additional effect must reduce the excess, unless it is large."""
    keeps: float = 3.0
    """Minimum factor by which the excess must increase without an effect for the effect to be kept."""
    keeps_if_large: float = 1.3
    """Minimum factor by which the excess must increase without a large effect for the effect to be kept."""
    large: float = 0.04
    """Minimum size of a large effect, as a fraction of the whole gap.

    Another form of a named effect can explain at most this fraction.
    """
    small: float = 0.01
    """Size of an effect, as a fraction of the gap, below which it merely compensates for another form.

    The limit applies while a residual remains.
    """
    keeps_if_small: float = 30.0
    """Minimum factor by which the excess must increase without a small effect for the effect to be kept."""
    contained: float = 0.003
    """Minimum fraction of the explained chi2 that a richer form of an effect must add while a residual remains."""
    nearly_all: float = 0.9
    """Minimum reduction of the excess by simple effects that replace a curve, relative to the reduction by the curve.

    The rule applies if only a small residual remains.
    """
    most_of_it: float = 0.5
    """Minimum reduction of the excess by other effects that replace a vibration at a multiple of the swing's frequency.

    It is relative to the reduction by the vibration.
    """
    own_share: float = 0.15
    """Minimum own share of an effect while a residual remains.

    The own share is the fraction of an effect's reduction of chi2 that other functional forms of the remaining effects
    cannot explain.
    """
    secondary: float = 0.1
    """Size of an effect, as a fraction of the gap, below which it may compensate for the form of a larger effect.

    The limit applies even if only noise remains.
    """
    still_open: float = 0.5
    """Maximum fraction of the gap that may remain without an effect for the test of `own_share` to apply."""
    escaped: float = 10.0
    """Minimum factor by which a repeated fit reduces chi2 for the first fit to count as a local minimum."""
    likelier: float = 10.0
    """Minimum ratio of the prior probabilities of two sizes for an indistinguishable effect to replace a named one."""
    indistinguishable: float = 0.999
    """Minimum cosine of the signatures of two effects that recordings hardly distinguish."""


THRESHOLDS = Thresholds()


def bounded_excess(model: Hypothesis) -> float:
    """Return the excess chi-square of a model; its lower limit is the random variation of the noise."""
    return max(model.residuals.excess, THRESHOLDS.noise_floor * model.residuals.uncertainty)


def at_noise_floor(model: Hypothesis) -> bool:
    """Return whether the residual of a model is consistent with noise."""
    return model.residuals.z < THRESHOLDS.noise_floor


def far_from_noise(model: Hypothesis) -> bool:
    """Return whether the residual is so large that linear scores are only approximate."""
    return model.residuals.chi2 > THRESHOLDS.far * model.residuals.dof


def promising_gain(model: Hypothesis) -> float:
    """Return the minimum predicted reduction of chi2 for which an additional effect is fitted.

    A fit may reduce chi2 by `GAUSS_NEWTON.exceeded` times the predicted reduction. The minimum is therefore smaller, by
    this factor, than the largest reduction by chance.

    A missing effect inflates the residuals of all readings. With few readings, even the cause of all excess cannot
    reduce chi2 by an amount that is significant for inflated residuals. Such a reduction is not necessary, because the
    residuals are small once the cause is in the model. `THRESHOLDS.promising` then limits the predicted reduction.
    """
    residuals = model.residuals
    inflation = min(residuals.inflation, max(1.0, residuals.chi2 / residuals.dof))
    of_excess = THRESHOLDS.promising * residuals.excess
    return max(THRESHOLDS.chance, min(THRESHOLDS.chance * inflation / GAUSS_NEWTON.exceeded, of_excess))


def indifference(
    bare: Hypothesis, model: Hypothesis, *, independent: float = THRESHOLDS.chance, share: float = THRESHOLDS.integrator
) -> float:
    """Return the maximum difference of cost of two sets that count as equally good.

    Chance or the steps of the integrator can cause such a difference.
    """
    return max(independent * model.residuals.inflation, share * (bare.residuals.chi2 - model.residuals.chi2))


def significance(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Return the minimum significant reduction of cost from one set to a larger one.

    An effect that follows the noise of a tracker leaves residuals that are less correlated. The penalty of all
    parameters then decreases with the inflation of these residuals. If only noise remains without the effect, this
    decrease is not evidence. Both sets are then compared at the inflation of the larger one.
    """
    limit = _significance(bare, before, after)
    if at_noise_floor(before):
        limit += max(before.residuals.inflation - after.residuals.inflation, 0.0) * before.penalty
    return limit if at_noise_floor(after) else min(limit, scatter(before, after))


def _significance(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    if not before.effects:
        return THRESHOLDS.chance * after.residuals.inflation
    if at_noise_floor(after) and not at_noise_floor(before):
        return indifference(bare, after, share=THRESHOLDS.integrator_at_floor)
    chance = THRESHOLDS.chance_at_floor if at_noise_floor(before) else THRESHOLDS.chance
    return indifference(bare, after, independent=chance)


def scatter(before: Hypothesis, after: Hypothesis, errors: float = THRESHOLDS.consistent) -> float:
    """Return the reduction of chi2 that can occur by chance, from its scatter between segments.

    The result is inf if the segments are too few. The residual due to small unknown effects is smooth along a segment.
    If this residual counted as noise of every reading, a cause that improves every segment would not be significant.
    Segments are therefore the independent units.

    Args:
        before: set of larger chi2
        after: other set
        errors: number of standard errors that chance may cause
    """
    reductions = before.fit.linear.chi2_by_segment - after.fit.linear.chi2_by_segment
    if len(reductions) < THRESHOLDS.fewest_segments or not np.isfinite(reductions).all():
        return float("inf")
    return float(errors * np.sqrt(len(reductions) * np.var(reductions, ddof=1)))


def accepted(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether an additional effect explains more than chance and inexact functional forms can explain.

    An inexact form leaves a residual. If only noise remains, a significant reduction is therefore sufficient.
    """
    if before.cost - after.cost < significance(bare, before, after):
        return False
    return at_noise_floor(before) or at_noise_floor(after) or bounded_excess(after) < most_excess(bare, before)


def most_excess(bare: Hypothesis, before: Hypothesis) -> float:
    """Return the largest excess at which `accepted` accepts an additional effect if a residual remains."""
    return max(
        bounded_excess(before) / THRESHOLDS.slow, bounded_excess(before) - THRESHOLDS.large * bounded_excess(bare)
    )


def need(described: Hypothesis, model: Hypothesis, smaller: Hypothesis) -> float:
    """Return the ratio of the evidence for the additional effect to the required evidence.

    Args:
        described: model whose excess is the whole gap (`FittedSets.described`)
        model: set with the effect
        smaller: set without the effect
    """
    loss = smaller.cost - model.cost
    if at_noise_floor(model):
        return loss / (THRESHOLDS.chance * model.residuals.inflation)
    growth, factor = smaller.residuals.excess - bounded_excess(model), smaller.residuals.excess / bounded_excess(model)
    if loss > scatter(smaller, model):  # even if another effect is much larger, this effect improves every segment
        return factor / THRESHOLDS.slow
    if growth < THRESHOLDS.small * bounded_excess(described) and factor < THRESHOLDS.keeps_if_small:
        return 0.0
    large = growth > THRESHOLDS.large * bounded_excess(described)
    return factor / (THRESHOLDS.keeps_if_large if large else THRESHOLDS.keeps)


def explains_as_much(bare: Hypothesis, simple: Hypothesis, rich: Hypothesis) -> bool:
    """Return whether a smaller set explains about as much as a richer set.

    The smaller set must explain nearly all that the richer set explains. Its criterion, which contains the penalty of
    the parameters, must not be significantly higher. While a residual remains, the difference is compared with its
    scatter between segments. Neither set is then the exact model, so the noise of a reading is not the relevant scale
    of the difference.

    Source: Vuong (1989), Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57,
    307-333.
    """
    if len(simple.fit.free) >= len(rich.fit.free):
        return False
    if bounded_excess(bare) - bounded_excess(simple) < THRESHOLDS.nearly_all * (
        bounded_excess(bare) - bounded_excess(rich)
    ):
        return False
    margin = indifference(bare, rich)
    if not at_noise_floor(rich) and np.isfinite(by_chance := scatter(simple, rich, THRESHOLDS.beyond_chance)):
        margin = max(margin, by_chance)
    return simple.cost - rich.cost < margin


def form_indifference(bare: Hypothesis, model: Hypothesis) -> float:
    """Return the largest increase of cost at which a simpler form replaces a richer one.

    While a residual remains, a richer form may merely compensate for the residual. At the noise floor, a richer form
    may follow the error of the integrator.
    """
    share = THRESHOLDS.integrator if at_noise_floor(model) else THRESHOLDS.contained
    return indifference(bare, model, share=share)


def adds_less_than_remains(richer: Hypothesis, simpler: Hypothesis | None) -> bool:
    """Return whether a richer form leaves more excess than it removes, compared with a simpler form.

    The result is false if no simpler form is fitted, or if the richer form reaches the noise floor.
    """
    if simpler is None or at_noise_floor(richer):
        return False
    return bounded_excess(simpler) - bounded_excess(richer) < bounded_excess(richer)


def small_effects(bare: Hypothesis, path: Sequence[tuple[str, Hypothesis]]) -> frozenset[str]:
    """Return the small effects of a set.

    The small effects together explain less than `THRESHOLDS.small` of the gap in addition to the larger effects.

    Args:
        bare: the bare model
        path: names of the effects, largest first, each with the set of this effect and all larger effects
    """
    before = [bare, *(model for _, model in path)]
    least = THRESHOLDS.small * bounded_excess(bare) + bounded_excess(before[-1])
    return frozenset(name for (name, _), smaller in zip(path, before, strict=False) if bounded_excess(smaller) < least)


def indistinguishable(test: ScoreTest, first: Score, second: Score) -> bool:
    """Return whether each of two effects can imitate the other in these recordings."""
    return min(test.cosine(first, second), test.cosine(second, first)) > THRESHOLDS.indistinguishable


def follows_remainder(bare: Hypothesis, larger: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve, vibration or drift only follows the remainder of small unknown causes."""
    tests = (curve_follows_remainder, follows_swing, follows_decay)
    return any(follows(bare, larger, simple) for follows in tests)


def is_dismissed(bare: Hypothesis, other: Hypothesis, chosen: Hypothesis) -> bool:
    """Return whether a set only follows the remainder and is therefore no alternative to the selected set.

    A curve whose set costs no more than the selected set is an alternative: its amplitudes are worth their penalty. The
    amplitude and phase of a vibration fit the residual of any missing law, so its cost is no evidence.
    """
    if follows_swing(bare, other, chosen):
        return True
    dearer = other.cost_at(chosen.residuals.inflation) > chosen.cost
    return dearer and curve_follows_remainder(bare, other, chosen)


def curve_follows_remainder(bare: Hypothesis, with_curve: Hypothesis, simple: Hypothesis) -> bool:
    """Return whether a curve only follows the small remainder of unknown causes.

    Three conditions must hold: the simpler set explains nearly all that the curve explains, its remainder is below the
    noise, and with this remainder as noise the curve is not significant.
    """
    curves = set(with_curve.curves) - simple.key
    if not curves or not simple.effects or simple.residuals.noise_ratio > 1.0:
        return False
    explained = bounded_excess(bare) - bounded_excess(with_curve)
    if bounded_excess(bare) - bounded_excess(simple) < THRESHOLDS.nearly_all * explained:
        return False
    inflation = simple.residuals.inflation
    return simple.cost - with_curve.cost_at(inflation) < THRESHOLDS.chance * inflation


def follows_swing(bare: Hypothesis, vibrating: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a vibration only follows the residual of a missing law.

    The frequency of such a vibration is a multiple of the frequency of the swing, and another set explains most of this
    residual. Any missing law of angle or speed leaves a residual at these frequencies.
    """
    if not vibrating.on_line - other.key or not other.effects:
        return False
    explained = bounded_excess(bare) - bounded_excess(vibrating)
    return bounded_excess(bare) - bounded_excess(other) > THRESHOLDS.most_of_it * explained


def follows_decay(bare: Hypothesis, drifting: Hypothesis, other: Hypothesis) -> bool:
    """Return whether a friction drift along one decay only follows the residual of a missing loss.

    In this case another set of the same size explains nearly all of this residual. Along a decay the amplitude
    decreases with time. A loss that depends on speed, which every rod has, therefore looks like a drift.
    """
    if not drifting.of_decay - other.key or not other.effects or len(other.fit.free) > len(drifting.fit.free):
        return False
    explained = bounded_excess(bare) - bounded_excess(drifting)
    return bounded_excess(bare) - bounded_excess(other) > THRESHOLDS.nearly_all * explained


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
    return largest if largest is not None and grown[largest] > THRESHOLDS.takes_over else None

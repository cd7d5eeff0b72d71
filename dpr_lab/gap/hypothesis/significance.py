"""Significance of a reduction of cost, in view of noise, chance and inexact functional forms."""

import math

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, explained, log_prior_ratio
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


def promising_gain(model: Hypothesis) -> float:
    """Return the smallest predicted reduction of chi2 for which an effect is fitted.

    The largest reduction by chance is divided by `GAUSS_NEWTON.exceeded`, the factor by which a fit may exceed its
    prediction. With few readings, one cause can increase the variance inflation so much that its own reduction seems
    due to chance. The result is therefore at most the share `THRESHOLDS.promising` of the excess.
    """
    residuals = model.residuals
    inflation = min(residuals.inflation, max(1.0, residuals.chi2 / residuals.dof))
    of_excess = THRESHOLDS.promising * residuals.excess
    return max(THRESHOLDS.chance, min(THRESHOLDS.chance * inflation / GAUSS_NEWTON.exceeded, of_excess))


def cost_with_prior(model: Hypothesis, current: Hypothesis) -> float:
    """Return the cost of a set, reduced by the logarithm of its prior ratio to the current set."""
    unit = CALIBRATION.unit(min(model.inflation, current.inflation))  # the same in both directions
    return model.cost - unit * log_prior_ratio(model, current)


def member_odds(model: Hypothesis, chosen: Hypothesis, name: str, other: str) -> float:
    """Return the odds of an indistinguishable effect against the named effect, from priors and numbers of parameters.

    The odds are the ratio of the priors times a factor from the difference of the costs. If the other effect has the
    lower cost, at most the penalty of its fewer parameters counts, because the rest of the difference can be an error
    of the integrator. Simpler or richer forms are compared by their priors alone.

    Args:
        model: set with the other effect
        chosen: set with the named effect
        name: the named effect
        other: the other effect
    """
    odds = model.priors[other] / chosen.priors[name]
    if are_forms(name, other):
        return odds
    saved = max(chosen.penalty - model.penalty, 0.0) / CALIBRATION.unit(1.0)
    return odds * math.exp(min((chosen.cost - model.cost) / CALIBRATION.unit(chosen.inflation), saved))


def are_forms(name: str, other: str) -> bool:
    """Return whether one effect is a special case of the other."""
    return name in EFFECTS[other].nested or other in EFFECTS[name].nested


def indifference(
    bare: Hypothesis, model: Hypothesis, *, independent: float = THRESHOLDS.chance, share: float = THRESHOLDS.integrator
) -> float:
    """Return the largest difference of cost that chance or the steps of the integrator can cause."""
    return max(independent * model.inflation, share * (bare.residuals.chi2 - model.residuals.chi2))


def significance(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Return the minimum significant reduction of cost from one set to a larger one.

    With the inflation i of the larger set and its reduction r of the bare model's chi2, the limit is

        no other effect                        `chance` i
        only noise remains without the effect  max(`chance_at_floor` i, `integrator` r),
                                               for a common effect max(`chance_at_floor` i, `integrator_at_floor` r)
        only noise remains with the effect     max(`chance` i, `integrator_at_floor` r)
        a residual remains with the effect     max(`chance` i, `integrator` r), at most `segment_scatter`

    An effect that follows the noise of a tracker reduces the inflation, and with it the penalty of all parameters. If
    only noise remains without the effect, this reduction of the penalty is not evidence: both sets are compared at the
    inflation of the larger set.
    """
    if not before.effects:
        limit = after.chance
    elif before.at_noise_floor:
        common = before.key < after.key and all(EFFECTS[name].common for name in after.key - before.key)
        share = THRESHOLDS.integrator_at_floor if common else THRESHOLDS.integrator
        limit = indifference(bare, after, independent=THRESHOLDS.chance_at_floor, share=share)
    elif after.at_noise_floor:
        limit = indifference(bare, after, share=THRESHOLDS.integrator_at_floor)
    else:
        limit = indifference(bare, after)
    if before.at_noise_floor:
        limit += max(before.inflation - after.inflation, 0.0) * before.penalty
    return limit if after.at_noise_floor else min(limit, segment_scatter(before, after))


def segment_scatter(
    before: Hypothesis, after: Hypothesis, standard_errors: float = THRESHOLDS.significant_scatter
) -> float:
    """Return the reduction of chi2 that can occur by chance, from its scatter between segments.

    Segments count as independent units, because the residual of small unknown effects is smooth along a segment. The
    result is inf if there are fewer than `THRESHOLDS.fewest_segments`.

    Args:
        before: set of larger chi2
        after: other set
        standard_errors: largest deviation that is attributed to chance, in standard errors
    """
    reductions = before.fit.linear.chi2_by_segment - after.fit.linear.chi2_by_segment
    if len(reductions) < THRESHOLDS.fewest_segments or not np.isfinite(reductions).all():
        return float("inf")
    return float(standard_errors * np.sqrt(len(reductions) * np.var(reductions, ddof=1)))


def accepted(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether an added effect reduces the cost significantly and, above the noise floor, also the excess."""
    if before.cost - after.cost < significance(bare, before, after):
        return False
    return before.at_noise_floor or after.at_noise_floor or after.bounded_excess < most_excess(bare, before)


def most_excess(bare: Hypothesis, before: Hypothesis) -> float:
    """Return the largest excess of a set with one more effect that is accepted."""
    excess = before.bounded_excess
    return max(excess / THRESHOLDS.excess_factor, excess - THRESHOLDS.large * bare.bounded_excess)


def evidence_ratio(bare: Hypothesis, model: Hypothesis, smaller: Hypothesis) -> float:
    """Return the evidence for an effect, relative to the required evidence.

    At the noise floor, the evidence is the increase of the cost without the effect. Above the noise floor, it is the
    factor by which the excess increases without the effect. The required factor is `excess_factor` for an effect that
    is large or improves the segments consistently, `necessary_factor_if_small` for a small effect, and
    `necessary_factor` otherwise.

    Args:
        bare: model whose excess is the whole gap (`FittedSets.corrected_bare`)
        model: set with the effect
        smaller: set without the effect
    """
    loss = smaller.cost - model.cost
    if model.at_noise_floor:
        return loss / model.chance
    growth, factor = smaller.residuals.excess - model.bounded_excess, smaller.residuals.excess / model.bounded_excess
    share = growth / bare.bounded_excess
    if share > THRESHOLDS.large or loss > segment_scatter(smaller, model):
        return factor / THRESHOLDS.excess_factor
    if share < THRESHOLDS.small and factor < THRESHOLDS.necessary_factor_if_small:
        return 0.0
    return factor / THRESHOLDS.necessary_factor


def explains_as_much(bare: Hypothesis, simple: Hypothesis, rich: Hypothesis) -> bool:
    """Return whether a set with fewer parameters explains nearly as much, at no significantly higher cost.

    While a residual remains, neither set is the exact model. The difference of their costs is then compared with its
    scatter between segments instead of the noise.

    Source: Vuong (1989), Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57,
    307-333.
    """
    if len(simple.fit.free) >= len(rich.fit.free):
        return False
    if explained(bare, simple) < THRESHOLDS.simpler_share * explained(bare, rich):
        return False
    margin = indifference(bare, rich)
    if not rich.at_noise_floor and np.isfinite(by_chance := segment_scatter(simple, rich, THRESHOLDS.chance_scatter)):
        margin = max(margin, by_chance)
    return simple.cost - rich.cost < margin


def form_indifference(bare: Hypothesis, model: Hypothesis) -> float:
    """Return the largest increase of cost at which a simpler form replaces a richer form.

    The richer form may follow the residual or, at the noise floor, the error of the integrator.
    """
    share = THRESHOLDS.integrator if model.at_noise_floor else THRESHOLDS.richer_form_share
    return indifference(bare, model, share=share)


def adds_less_than_remains(richer: Hypothesis, simpler: Hypothesis | None) -> bool:
    """Return whether a richer form explains less in addition to a simpler form than remains unexplained.

    The result is False if the richer form leaves only noise, or if the simpler form was not fitted.
    """
    if simpler is None or richer.at_noise_floor:
        return False
    return simpler.bounded_excess - richer.bounded_excess < richer.bounded_excess

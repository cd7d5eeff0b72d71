"""Significance of a reduction of cost, relative to noise, chance, and inexact functional forms."""

import numpy as np

from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS


def promising_gain(model: Hypothesis) -> float:
    """Return the smallest predicted reduction of chi2 for which an effect is fitted.

    A fit may reduce chi2 by `GAUSS_NEWTON.exceeded` times the predicted reduction. The result is therefore the largest
    reduction by chance, divided by this factor.

    A missing effect inflates the residuals of all readings. With few readings, even the only cause of the excess cannot
    reduce chi2 significantly relative to inflated residuals. A significant reduction is not necessary, because
    the residuals are small once the cause is in the model. `THRESHOLDS.promising` then limits the predicted reduction.
    """
    residuals = model.residuals
    inflation = min(residuals.inflation, max(1.0, residuals.chi2 / residuals.dof))
    of_excess = THRESHOLDS.promising * residuals.excess
    return max(THRESHOLDS.chance, min(THRESHOLDS.chance * inflation / GAUSS_NEWTON.exceeded, of_excess))


def indifference(
    bare: Hypothesis, model: Hypothesis, *, independent: float = THRESHOLDS.chance, share: float = THRESHOLDS.integrator
) -> float:
    """Return the difference of cost below which two sets count as equally good.

    Chance or the steps of the integrator can cause such a difference.
    """
    return max(independent * model.inflation, share * (bare.residuals.chi2 - model.residuals.chi2))


def significance(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Return the minimum significant reduction of cost from one set to a larger one.

    The limit depends on what remains without and with the additional effect. Here i is the inflation of the larger set,
    and r is the reduction of chi2 from the bare model to the larger set:

        no other effect                        `chance` i
        only noise remains without the effect  max(`chance_at_floor` i, `integrator` r)
        only noise remains with the effect     max(`chance` i, `integrator_at_floor` r)
        a residual remains with the effect     max(`chance` i, `integrator` r)

    While a residual remains with the effect, a reduction is also significant that is consistent among the segments
    (`segment_scatter`).

    An effect that follows the noise of a tracker leaves residuals that are less correlated. The penalty of all
    parameters then decreases with the inflation of these residuals. If only noise remains without the effect, this
    decrease is not evidence. Both sets are then compared at the inflation of the larger one.
    """
    if not before.effects:
        limit = after.chance
    elif before.at_noise_floor:
        limit = indifference(bare, after, independent=THRESHOLDS.chance_at_floor)
    elif after.at_noise_floor:
        limit = indifference(bare, after, share=THRESHOLDS.integrator_at_floor)
    else:
        limit = indifference(bare, after)
    if before.at_noise_floor:
        limit += max(before.inflation - after.inflation, 0.0) * before.penalty
    return limit if after.at_noise_floor else min(limit, segment_scatter(before, after))


def segment_scatter(before: Hypothesis, after: Hypothesis, standard_errors: float = THRESHOLDS.consistent) -> float:
    """Return the reduction of chi2 that can occur by chance.

    It is estimated from the scatter between segments. The result is inf if the segments are too few. The residual due
    to small unknown effects is smooth along a segment. If this residual counted as noise of every reading, a cause that
    improves every segment would not be significant. Segments are therefore the independent units.

    Args:
        before: set of larger chi2
        after: other set
        standard_errors: number of standard errors that chance may cause
    """
    reductions = before.fit.linear.chi2_by_segment - after.fit.linear.chi2_by_segment
    if len(reductions) < THRESHOLDS.fewest_segments or not np.isfinite(reductions).all():
        return float("inf")
    return float(standard_errors * np.sqrt(len(reductions) * np.var(reductions, ddof=1)))


def accepted(bare: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether an effect explains more than chance and inexact forms can explain.

    An inexact form leaves a residual. If only noise remains, a significant reduction is therefore sufficient.
    """
    if before.cost - after.cost < significance(bare, before, after):
        return False
    return before.at_noise_floor or after.at_noise_floor or after.bounded_excess < most_excess(bare, before)


def most_excess(bare: Hypothesis, before: Hypothesis) -> float:
    """Return the largest excess that may remain after an additional effect."""
    excess = before.bounded_excess
    return max(excess / THRESHOLDS.excess_factor, excess - THRESHOLDS.large * bare.bounded_excess)


def need(described: Hypothesis, model: Hypothesis, smaller: Hypothesis) -> float:
    """Return the ratio of the evidence for the additional effect to the required evidence.

    Above the noise floor, the evidence is the factor by which the excess increases without the effect. The required
    factor is `excess_factor` for a large effect, and for an effect that improves every segment. It is
    `necessary_factor_if_small` for a small effect, and `necessary_factor` for any other effect.

    Args:
        described: model whose excess is the whole gap (`FittedSets.described`)
        model: set with the effect
        smaller: set without the effect
    """
    loss = smaller.cost - model.cost
    if model.at_noise_floor:
        return loss / model.chance
    growth, factor = smaller.residuals.excess - model.bounded_excess, smaller.residuals.excess / model.bounded_excess
    share = growth / described.bounded_excess
    if share > THRESHOLDS.large or loss > segment_scatter(smaller, model):
        return factor / THRESHOLDS.excess_factor
    if share < THRESHOLDS.small and factor < THRESHOLDS.necessary_factor_if_small:
        return 0.0
    return factor / THRESHOLDS.necessary_factor


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
    if bare.bounded_excess - simple.bounded_excess < THRESHOLDS.nearly_all * (
        bare.bounded_excess - rich.bounded_excess
    ):
        return False
    margin = indifference(bare, rich)
    if not rich.at_noise_floor and np.isfinite(by_chance := segment_scatter(simple, rich, THRESHOLDS.beyond_chance)):
        margin = max(margin, by_chance)
    return simple.cost - rich.cost < margin


def form_indifference(bare: Hypothesis, model: Hypothesis) -> float:
    """Return the largest increase of cost at which a simpler form replaces a richer one.

    While a residual remains, a richer form may merely compensate for the residual. At the noise floor, a richer form
    may follow the error of the integrator.
    """
    share = THRESHOLDS.integrator if model.at_noise_floor else THRESHOLDS.richer_form_share
    return indifference(bare, model, share=share)


def adds_less_than_remains(richer: Hypothesis, simpler: Hypothesis | None) -> bool:
    """Return whether a richer form leaves more excess than it removes.

    The excess is compared with that of the simpler form. The result is false if no simpler form is fitted, or if the
    richer form reaches the noise floor.
    """
    if simpler is None or richer.at_noise_floor:
        return False
    return simpler.bounded_excess - richer.bounded_excess < richer.bounded_excess

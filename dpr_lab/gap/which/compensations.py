"""Odds that an effect of the selected set only compensates for the inexact form of another effect.

No law of the library describes a real rig exactly. An additional effect can therefore improve every prediction although
the rig does not have it. It stays in the model, which predicts better with it, but it is hardly probable as a cause.
The own share of an effect (`dpr_lab.gap.which.forms.own_share`) shows whether it may be such a compensation.
"""

from collections.abc import Iterator, Mapping

from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.significance import explains_as_much
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.forms import own_share


def compensation_odds(
    fitted_sets: FittedSets, chosen: Hypothesis, without: Mapping[str, Hypothesis]
) -> dict[str, float]:
    """Return the odds that an effect is a compensation and not a cause, by the name of the effect.

    Effects that are certainly no compensations are not included.

    Args:
        fitted_sets: all fitted sets
        chosen: the selected set
        without: fits of this set without one effect, by the removed effect
    """
    odds = CALIBRATION.odds_of_compensation
    secondary = {name: odds(share) for name, share in _secondary(fitted_sets, chosen, without)}
    return secondary | {name: odds(share, remainder=True) for name, share in _replaceable(fitted_sets, chosen)}


def _secondary(
    fitted_sets: FittedSets, chosen: Hypothesis, without: Mapping[str, Hypothesis]
) -> Iterator[tuple[str, float]]:
    """Yield the secondary effects with their own shares.

    An effect is secondary if it explains less than the share `THRESHOLDS.secondary` of the gap. A single effect, and
    effects that every rig has, are not considered.
    """
    limit = chosen.bounded_excess + THRESHOLDS.secondary * fitted_sets.bare.residuals.excess
    for name, smaller in without.items():
        is_secondary = fitted_sets.without_substitute(chosen, name).residuals.excess < limit
        if smaller.effects and is_secondary and not fitted_sets.library[name].universal:
            share = own_share(fitted_sets.problem, smaller, fitted_sets.test(smaller), name)
            if share is not None:
                yield name, share


def _replaceable(fitted_sets: FittedSets, chosen: Hypothesis) -> Iterator[tuple[str, float]]:
    """Yield the effects that other forms of the remaining effects can replace while a residual remains.

    Each effect is yielded with the smallest own share of its set (`_smallest_own_share`). The other effects are then
    tested without it.
    """
    model = chosen
    while (smallest := _smallest_own_share(fitted_sets, model)) is not None:
        smaller, share = smallest
        for name in model.key - smaller.key:
            yield name, share
        model = smaller


def _smallest_own_share(fitted_sets: FittedSets, model: Hypothesis) -> tuple[Hypothesis, float] | None:
    """Return the set without the effect of the smallest own share, and this share.

    The own share is small even for a true cause if a free function in the set imitates this cause. Therefore, if a set
    without another effect has fewer parameters and explains as much, this set is returned, with the smallest own share.
    The result is None if only noise remains, or if no own share is below `THRESHOLDS.own_share`.
    """
    if model.at_noise_floor or len(model.effects) < 2:
        return None
    smaller_sets = _without_possible_compensations(fitted_sets, model)
    shares = {
        name: share
        for name, smaller in smaller_sets.items()
        if (share := own_share(fitted_sets.problem, smaller, fitted_sets.test(smaller), name)) is not None
    }
    least = min(shares, key=lambda name: shares[name], default=None)
    if least is None or shares[least] >= THRESHOLDS.own_share:
        return None
    without = smaller_sets[least]
    simpler = [other for other in smaller_sets.values() if explains_as_much(fitted_sets.bare, other, without)]
    return min(simpler, key=lambda other: (len(other.fit.free), other.cost), default=without), shares[least]


def _without_possible_compensations(fitted_sets: FittedSets, model: Hypothesis) -> dict[str, Hypothesis]:
    """Return the set without each effect that may only compensate for the inexact form of another effect.

    Effects that every rig has, and effects without which the excess is far above that of the best fitted set, are not
    included. The result is empty if a curve that explains less would replace a removed effect.
    """
    closest = min(fit.bounded_excess for fit in fitted_sets.fits.values())
    limit = min(THRESHOLDS.necessary_factor_if_small * closest, THRESHOLDS.open_share * fitted_sets.bare.bounded_excess)
    removable = (name for name in fitted_sets.unexpected(model) if not fitted_sets.library[name].universal)
    smaller_sets = {name: fitted_sets.without(model, name) for name in removable}  # also fitted for the following test
    if _curve_is_best_smaller_set(fitted_sets, model):
        return {}
    return {
        name: smaller
        for name, smaller in smaller_sets.items()
        if smaller.bounded_excess <= limit and fitted_sets.as_possible(smaller, model)
    }


def _curve_is_best_smaller_set(fitted_sets: FittedSets, model: Hypothesis) -> bool:
    """Return whether the set with the lowest cost among those of fewer effects contains a curve.

    A curve is recognised by more parameters at a higher cost than the given set. All sets without one effect must be
    fitted first.
    """
    others = (
        fit for fit in fitted_sets.fits.values() if len(fit.effects) < len(model.effects) and fitted_sets.possible(fit)
    )
    best = min(others, key=lambda other: other.cost, default=model)
    return best.cost > model.cost and len(best.fit.free) > len(model.fit.free)

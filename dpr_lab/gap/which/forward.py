"""Forward selection: candidates are ranked by score tests, the best are fitted, and two sets are extended."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refutes_torque_noise
from dpr_lab.gap.hypothesis.imitation import follows_decay, follows_remainder, follows_swing
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, joint_gain
from dpr_lab.gap.hypothesis.significance import accepted, most_excess, promising_gain, significance
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.restarts import escaped
from dpr_lab.gap.which.search import Decision, Move, Proposal


@dataclass(frozen=True, slots=True)
class Beam:
    """Limits of the beam search: numbers of fitted candidates and of extended sets."""

    fitted: int = 4
    """Number of candidates that are fitted near the noise."""
    fitted_when_far: int = 6
    """Number of candidates that are fitted far from the noise, where linear scores are unreliable."""
    width: int = 2
    """Number of sets that are extended to the next larger size."""
    worse: float = 4.0
    """Maximum ratio of the excess of an extended set to that of the best set."""
    exceeded: float = GAUSS_NEWTON.exceeded
    """Largest expected ratio of a fitted to the predicted reduction."""
    as_promising: float = 0.5
    """Minimum predicted reduction of a further candidate, relative to the actual reduction by one that leaves only
    noise."""
    same_gain: float = 1e-3
    """Maximum relative difference of the predicted reductions of two similar effects of which only one is fitted."""


BEAM = Beam()


def forward_selection(max_effects: int, *, to_floor: bool = False) -> Move:
    """Create the move that adds effects one at a time.

    With `to_floor`, the move ends as soon as only noise remains: longer segments then show the remaining effects.
    """
    return Move(
        "add",
        "forward selection: the candidates with the largest scores are fitted, the two best sets are extended further",
        partial(_larger_sets, max_effects=max_effects, to_floor=to_floor),
        _significant_and_large,
        then="go on",
    )


def _larger_sets(fitted_sets: FittedSets, start: Hypothesis, max_effects: int, to_floor: bool) -> Iterator[Proposal]:
    """Yield the best set of each size, in the order of the sizes.

    Far from the noise, the search continues after one rejected effect, because two effects may reduce the excess only
    together. It ends if the residual is inconsistent with the noise of known torques, because the search is then
    repeated without this noise (`dpr_lab.gap.corrections`). With `to_floor`, one effect is fitted before this test,
    because a linear test predicts the reduction by a backlash poorly.
    """
    best, front, last_rejected = start, [start], False
    for remaining in range(max_effects - len(fitted_sets.unexpected(start)), 0, -1):
        if not (to_floor and front == [start]) and no_effects_reach_noise(fitted_sets, best):
            return
        ranked = _next_level(fitted_sets, best, front, max_effects, last=last_rejected or remaining == 1)
        if not ranked:
            return
        largest = ranked[0]
        yield Proposal(largest)
        if accepted(fitted_sets.bare, best, largest) and not follows_remainder(fitted_sets.bare, largest, best):
            best, last_rejected = largest, False
        elif last_rejected or not best.far_from_noise:
            return
        else:
            last_rejected = True
        if to_floor and best.at_noise_floor:
            return
        front = [largest] if largest.at_noise_floor else [largest, *_runners_up(fitted_sets, largest, ranked[1:])]


def _next_level(
    fitted_sets: FittedSets, best: Hypothesis, front: Sequence[Hypothesis], max_effects: int, *, last: bool
) -> list[Hypothesis]:
    """Extend each set of `front` by one effect or by two dissipative effects; return the new sets, best first."""
    level: dict[frozenset[str], Hypothesis] = {}
    for model in front:
        level = _with_one_more(fitted_sets, best, model, level, last=last)
        if len(fitted_sets.unexpected(model)) + 2 <= max_effects and (pair := _with_two_losses(fitted_sets, model)):
            level[pair.key] = pair
    ranked = _ranked(fitted_sets, best, level.values())
    return _ranked(fitted_sets, best, [escaped(fitted_sets, ranked[0]), *ranked[1:]]) if ranked else []


def no_effects_reach_noise(fitted_sets: FittedSets, model: Hypothesis) -> bool:
    """Return whether the residual exceeds the noise even with all candidates.

    The noise includes that of known torques. A linear fit of all candidates together gives the residual.
    """
    if not refutes_torque_noise(fitted_sets.problem, model):
        return False
    test = fitted_sets.test(model)
    remaining = float(np.sum(test.linear.e**2)) - test.space.gain()
    return remaining > THRESHOLDS.far * model.residuals.dof


def _with_one_more(
    fitted_sets: FittedSets,
    best: Hypothesis,
    model: Hypothesis,
    level: Mapping[frozenset[str], Hypothesis],
    *,
    last: bool,
) -> dict[frozenset[str], Hypothesis]:
    """Extend a set by one promising effect at a time; return the extended level.

    Once a set leaves only noise, only candidates with a similar predicted reduction are fitted. A candidate is skipped
    if even `BEAM.exceeded` times its predicted reduction leaves too much excess (`_deciding_excess`).

    Args:
        fitted_sets: the fitted sets
        best: best smaller set
        model: set that is extended
        level: sets of the next larger size that were fitted so far
        last: whether the search ends after this level unless it accepts a set
    """
    extended, least = dict(level), 0.0
    for score in _candidates(model, fitted_sets.test(model)):
        if score.gain <= least:
            continue
        reached = model.bounded_excess - BEAM.exceeded * score.gain
        if reached > _deciding_excess(fitted_sets, best, model, list(extended.values()), last):
            continue
        larger = fitted_sets.with_one(model, score)
        if larger.at_noise_floor:
            least = max(least, BEAM.as_promising * (model.fit.chi2 - larger.fit.chi2))
        extended[larger.key] = larger
    return extended


def _candidates(model: Hypothesis, test: ScoreTest) -> list[Score]:
    """Return the effects with the largest scores, without nearly equal ones, and their simpler forms."""
    least = promising_gain(model)
    promising = [score for score in test.ranking if score.gain > least and not set(score.effect.nested) & model.key]
    picked: list[Score] = []
    for score in promising:
        if len(picked) == (BEAM.fitted_when_far if model.far_from_noise else BEAM.fitted):
            break
        if not any(_nearly_equal(score, other) for other in picked):
            picked.append(score)
    names = {score.effect.name for score in picked}
    simpler = {name for score in picked for name in score.effect.nested} - names
    return picked + [score for score in promising if score.effect.name in simpler]


def _nearly_equal(score: Score, other: Score) -> bool:
    """Return whether two similar effects have nearly the same predicted reduction and equally many amplitudes."""
    same_gain = abs(score.gain - other.gain) <= BEAM.same_gain * max(score.gain, other.gain)
    return same_gain and len(score.columns) == len(other.columns) and other.effect.name in score.effect.twins


def _deciding_excess(
    fitted_sets: FittedSets, best: Hypothesis, model: Hypothesis, level: Sequence[Hypothesis], last: bool
) -> float:
    """Return the largest excess at which a further extension of `model` could be accepted or extended in turn.

    Near the noise, an extension with fewer parameters than a fitted set may have a larger excess at the same cost.
    """

    def excess(other: Hypothesis) -> float:
        fewer = 0.0 if model.far_from_noise else other.inflation * max(other.penalty - model.penalty, 0.0)
        return other.bounded_excess + fewer

    sound = sorted((m for m in level if not any(_doubts(fitted_sets, best, level, m))), key=lambda model: model.cost)
    ahead = [*sound[:1], *_runners_up(fitted_sets, sound[0], sound[1:])] if sound else []
    if last:
        noise = THRESHOLDS.noise_floor * model.residuals.uncertainty
        return max(noise, min([most_excess(fitted_sets.bare, best), *map(excess, ahead[:1])]))
    if len(ahead) == BEAM.width:
        return excess(ahead[-1])
    return BEAM.worse * min(map(excess, ahead), default=np.inf)


def _with_two_losses(fitted_sets: FittedSets, model: Hypothesis) -> Hypothesis | None:
    """Add two dissipative effects of one joint that together explain more than any single effect.

    The energy loss per swing is proportional to the amplitude for Coulomb friction, to its square for viscous friction,
    which the model contains, and to its cube for air drag. Coulomb friction and drag therefore change a decay in
    opposite ways, and each alone explains little or has the wrong sign. The result is None without such a pair.
    """
    test = fitted_sets.test(model)
    best_scores = (test.shaped[name][0] for name in sorted(test.shaped))
    one_size = (score for score in best_scores if len(score.columns) == 1 and not score.effect.shapes)
    losses = [score for score in one_size if score.effect.dissipative]
    pairs = [
        (gain, *sorted(pair, key=lambda score: -score.gain))
        for pair in combinations(losses, 2)
        if not set(pair[0].effect.joints).isdisjoint(pair[1].effect.joints)
        and (gain := joint_gain(test, pair)) > pair[0].gain + pair[1].gain
    ]
    if not pairs:
        return None
    gain, larger, smaller = max(pairs, key=lambda pair: pair[0])
    if gain < test.ranking[0].gain + THRESHOLDS.chance:
        return None
    with_larger = fitted_sets.with_one(model, larger)
    score = fitted_sets.score(with_larger, smaller.effect.name)
    return None if score is None else fitted_sets.with_one(with_larger, score)


def _ranked(fitted_sets: FittedSets, best: Hypothesis, models: Iterable[Hypothesis]) -> list[Hypothesis]:
    """Sort sets by the criterion; sets with impossible sizes, or with effects that imitate other causes, are last."""
    models = list(models)
    return sorted(models, key=lambda model: (*_doubts(fitted_sets, best, models, model), model.cost))


def _doubts(
    fitted_sets: FittedSets, best: Hypothesis, models: Iterable[Hypothesis], model: Hypothesis
) -> tuple[bool, bool]:
    """Return whether a size of a set is impossible, and whether an effect of the set only imitates other causes."""
    imitates = follows_remainder(fitted_sets.bare, model, best) or any(
        follows_swing(fitted_sets.bare, model, other) or follows_decay(fitted_sets.bare, model, other)
        for other in models
    )
    return not fitted_sets.possible(model), imitates


def _runners_up(fitted_sets: FittedSets, best: Hypothesis, others: list[Hypothesis]) -> list[Hypothesis]:
    """Return the next best sets of similar excess, without simpler or richer forms of the best set."""
    separate = [model for model in others if not _are_forms(fitted_sets, model, best)]
    return [model for model in separate[: BEAM.width - 1] if model.bounded_excess < BEAM.worse * best.bounded_excess]


def _are_forms(fitted_sets: FittedSets, model: Hypothesis, other: Hypothesis) -> bool:
    """Return whether two sets differ in one effect that is a simpler form of the other."""
    only_first, only_second = model.key - other.key, other.key - model.key
    if len(only_first) != 1 or len(only_second) != 1:
        return False
    (first,), (second,) = only_first, only_second
    return first in fitted_sets.library[second].nested or second in fitted_sets.library[first].nested


def _significant_and_large(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    limit = significance(fitted_sets.bare, current, model)
    if current.cost - model.cost < limit:
        return Decision(False, f"the criterion falls by less than {limit:.3g}, which is not significant")
    if accepted(fitted_sets.bare, current, model):
        return Decision(True, "only noise remains" if model.at_noise_floor else "explains more than random noise")
    return Decision(False, f"the excess decreases by less than a factor of {THRESHOLDS.excess_factor:g}")

"""The move that compares all fitted sets under torques that do not repeat (`dpr_lab.gap.hypothesis.wandering`)."""

from collections.abc import Iterator

from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.wandering import WANDERING, wandering
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _likeliest(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The likeliest fitted set, extended by further effects, while a residual remains."""
    torques = wandering(sets.problem, current) if current.effects else None
    if torques is None:
        return
    known, before = current.key & sets.expected, torques.cost(current)
    costs = {model.key: torques.cost(model) for model in sets.fits.values()}

    def least() -> Hypothesis:
        possible = (m for m in sets.fits.values() if m.effects and known <= m.key and sets.as_possible(m, current))
        return min(possible, key=lambda model: costs[model.key], default=current)

    best = least()
    for score in sets.test(best).ranking[: WANDERING.extensions]:
        larger = sets.with_one(best, score)
        costs[larger.key] = torques.cost(larger)
    best = least()
    if best.key != current.key:
        yield Proposal(best, before - costs[best.key])


def _likelier(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    better = proposal.value > PENALTY.parameter
    return Decision(
        better,
        f"{'likelier' if better else 'not likelier'} where torques wander: -2 log likelihood and penalty fall by"
        f" {proposal.value:.3g}",
    )


WANDERING_TORQUE = Move(
    "wandering torque",
    "while a residual remains, the sets are compared under torques that do not repeat, for which neighbouring residuals"
    " are no independent evidence",
    _likeliest,
    _likelier,
    then="repeat",
)

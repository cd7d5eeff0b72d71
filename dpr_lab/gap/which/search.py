"""The driver of the search: one move after the other, each proposes sets of effects and accepts or rejects them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.selected import TracedTrial


class Proposal(NamedTuple):
    """A set that a move would put in place of the current one."""

    model: Hypothesis
    value: float = float("nan")
    """What the move measured to choose it, where the criterion alone does not decide."""


class Decision(NamedTuple):
    """Whether a proposal is accepted, and why."""

    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class Move:
    """One kind of change to a set of effects."""

    name: str
    purpose: str
    """What it is for, in a sentence."""
    propose: Callable[[FittedSets, Hypothesis], Iterable[Proposal]]
    """Sets to try in place of the current one, in order."""
    accept: Callable[[FittedSets, Hypothesis, Proposal], Decision]
    """Decide about one of them, given the current set."""
    then: Literal["stop", "repeat", "go on"] = "stop"
    """After an acceptance: stop; propose again from the accepted set; or go on with the same proposals."""


@dataclass(frozen=True, slots=True)
class SearchState:
    """Where the search stands."""

    current: Hypothesis
    trace: tuple[TracedTrial, ...] = ()
    """Every trial so far, in order."""

    def after(self, move: Move, proposal: Proposal, decision: Decision) -> "SearchState":
        """The state after a trial."""
        model = proposal.model
        step = TracedTrial(move.name, self.current.effects, model.effects, model.cost - self.current.cost, *decision)
        return SearchState(model if decision.accepted else self.current, (*self.trace, step))


def run(moves: Sequence[Move], sets: FittedSets, state: SearchState) -> SearchState:
    """Run moves in order, each from where the one before ended."""
    for move in moves:
        state = apply(move, sets, state)
    return state


def apply(move: Move, sets: FittedSets, state: SearchState) -> SearchState:
    """Run one move."""
    while True:
        before = state.current
        for proposal in move.propose(sets, before):
            decision = move.accept(sets, state.current, proposal)
            state = state.after(move, proposal, decision)
            if decision.accepted and move.then != "go on":
                break
        if move.then != "repeat" or state.current is before:
            return state


def moved_to(state: SearchState, move: str, model: Hypothesis, reason: str) -> SearchState:
    """The state after a set was taken over without alternatives."""
    step = TracedTrial(move, state.current.effects, model.effects, model.cost - state.current.cost, True, reason)
    return replace(state, current=model, trace=(*state.trace, step))

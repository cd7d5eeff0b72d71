"""The driver of the search: one move after the other, each proposes sets of effects and accepts or rejects them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.selected import TracedTrial


class Proposal(NamedTuple):
    """A set that a move would put in place of the current one."""

    model: Hypothesis
    value: float = float("nan")
    """What the move measured to choose it, where the criterion alone does not decide."""
    trials: tuple[TracedTrial, ...] = ()
    """Those of a search that led to it."""


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
    """State of the search. A move returns a new state and does not change the old one."""

    current: Hypothesis
    """The best set so far."""
    fits: Mapping[frozenset[str], Hypothesis]
    """Every set that was fitted so far, the bare model among them."""
    tests: Mapping[frozenset[str], ScoreTest]
    """The score tests on them."""
    trace: tuple[TracedTrial, ...] = ()
    """Every trial so far, in order."""

    @classmethod
    def bare(cls, sets: FittedSets) -> "SearchState":
        """The model without effects, at the start of a search."""
        return cls(sets.bare, sets.fits, sets.tests)

    def after(self, move: Move, proposal: Proposal, decision: Decision) -> "SearchState":
        """The state after a trial."""
        model = proposal.model
        trial = TracedTrial(
            move=move.name,
            before=self.current.effects,
            tried=model.effects,
            criterion=model.cost,
            change=model.cost - self.current.cost,
            accepted=decision.accepted,
            reason=decision.reason,
        )
        trace = (*self.trace, *proposal.trials, trial)
        return replace(self, current=model if decision.accepted else self.current, trace=trace)


def run(moves: Sequence[Move], sets: FittedSets, state: SearchState) -> SearchState:
    """Run moves in order, each from the state that the previous one returned."""
    for move in moves:
        state = apply(move, sets, state)
    return state


def apply(move: Move, sets: FittedSets, state: SearchState) -> SearchState:
    """Run one move.

    Args:
        move: the move
        sets: the recordings and the library
        state: where the search stands
    """
    sets = sets.resumed(state.fits, state.tests)
    while True:
        before = state.current
        for proposal in move.propose(sets, before):
            decision = move.accept(sets, state.current, proposal)
            state = state.after(move, proposal, decision)
            if decision.accepted and move.then != "go on":
                break
        if move.then != "repeat" or state.current is before:
            return replace(state, fits=sets.fits, tests=sets.tests)

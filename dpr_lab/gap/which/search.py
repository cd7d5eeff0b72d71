"""State and moves of the search; a move proposes sets of effects, and accepts or rejects them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal, NamedTuple

from dpr_lab.fitting.gauss_newton import StopReason
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.imitation import follows_remainder
from dpr_lab.gap.result.search_step import SearchStep
from dpr_lab.gap.which.fitted_sets import FittedSets


class Proposal(NamedTuple):
    """A set that a move proposes in place of the current set."""

    model: Hypothesis
    value: float = float("nan")
    """Quantity by which the move selected the set; nan for the criterion."""
    trials: tuple[SearchStep, ...] = ()
    """Trials of the search that led to the proposal, if it was a nested search."""


class Decision(NamedTuple):
    """Whether a proposal is accepted, and the reason."""

    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class Move:
    """One kind of change of the current set of effects."""

    name: str
    purpose: str
    propose: Callable[[FittedSets, Hypothesis], Iterable[Proposal]]
    """Function that returns the proposals in the order of their trial."""
    accept: Callable[[FittedSets, Hypothesis, Proposal], Decision]
    """Function that decides whether a proposed set replaces the current set."""
    then: Literal["stop", "repeat", "go on"] = "stop"
    """Action after an accepted proposal: stop, propose again for the new set, or continue with the remaining
    proposals."""


@dataclass(frozen=True, slots=True)
class SearchState:
    """State of the search: the current set, all fitted sets, and the trials."""

    current: Hypothesis
    fitted_sets: FittedSets
    """All fitted sets with their score tests; each move works on a copy."""
    max_effects: int
    """Maximum number of effects in addition to those that the rig is known to have."""
    trace: tuple[SearchStep, ...] = ()
    """All trials so far, in chronological order."""

    def after(self, move: Move, proposal: Proposal, decision: Decision) -> "SearchState":
        """Return the state after a trial."""
        model, change = proposal.model, proposal.model.cost - self.current.cost
        trial = SearchStep(
            move=move.name,
            before=list(self.current.effects),
            tried=list(model.effects),
            criterion=model.cost if isfinite(model.cost) else None,
            change=change if isfinite(change) else None,
            accepted=decision.accepted,
            reason=decision.reason + _caveat(model),
        )
        trace = (*self.trace, *proposal.trials, trial)
        return replace(self, current=model if decision.accepted else self.current, trace=trace)


def _caveat(model: Hypothesis) -> str:
    """Return a note if the fit of a set ended without a descent, or an empty text."""
    stuck = model.fit.stop is StopReason.NO_DESCENT
    return "; its fit may not have reached the minimum that the criterion assumes" if stuck else ""


def apply_moves(moves: Sequence[Move], state: SearchState) -> SearchState:
    """Apply moves in order."""
    for move in moves:
        state = apply_move(move, state)
    return state


def apply_move(move: Move, state: SearchState) -> SearchState:
    """Apply one move; a set that the move accepts can be rejected by `_refusal`."""
    fitted_sets = state.fitted_sets.copied()
    while True:
        before = state.current
        for proposal in move.propose(fitted_sets, before):
            decision = move.accept(fitted_sets, state.current, proposal)
            if decision.accepted and (reason := _refusal(state, proposal.model)):
                decision = Decision(False, reason)
            state = state.after(move, proposal, decision)
            if decision.accepted and move.then != "go on":
                break
        if move.then != "repeat" or state.current is before:
            return replace(state, fitted_sets=fitted_sets)


def _refusal(state: SearchState, model: Hypothesis) -> str:
    """Return the reason why no move may replace the current set by a given set; empty if it may."""
    fitted_sets = state.fitted_sets
    if follows_remainder(fitted_sets.bare, model, state.current):
        return "the additional effect only fits the remainder of small unknown causes"
    size = len(fitted_sets.unexpected(model))
    if size > max(state.max_effects, len(fitted_sets.unexpected(state.current))):
        return f"more effects than the maximum number of {state.max_effects}"
    return ""

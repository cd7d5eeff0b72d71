"""Selection of effects: forward selection, then the moves that refine the set.

Forward selection is greedy. Therefore two sets are extended in parallel, and further moves then remove and replace
effects (`dpr_lab.gap.which.moves`).
"""

from collections.abc import Iterator

from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refutes_torque_noise
from dpr_lab.gap.hypothesis.refits import refit_without
from dpr_lab.gap.hypothesis.significance import cost_with_prior, explains_as_much, indifference
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.compensations import compensation_odds
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.forward import forward_selection
from dpr_lab.gap.which.moves import CONVERGE, REFINE, REVISIONS, SHORT, START
from dpr_lab.gap.which.removals import HELD_OUT
from dpr_lab.gap.which.replacements import LARGER_PRIOR, fit_alternatives
from dpr_lab.gap.which.restarts import fitted_to_working_segments
from dpr_lab.gap.which.search import Decision, Move, Proposal, SearchState, apply_move, apply_moves
from dpr_lab.gap.which.selected import Selection

MOST_REVISIONS = 3
"""Maximum number of revisions of the selected set."""


def forward(fitted_sets: FittedSets, max_effects: int = 4) -> SearchState:
    """Return the state of the search after forward selection of at most `max_effects` effects.

    Far from the noise, the search begins with short segments, in which the readings depend more linearly on the
    effects. If their residual is inconsistent with the noise of known torques, the search ends and is repeated without
    this noise (`dpr_lab.gap.corrections`).
    """
    start = SearchState(fitted_sets.bare, fitted_sets, max_effects)
    if not fitted_sets.bare.far_from_noise:
        return apply_moves((START, forward_selection(max_effects)), start)
    additions = (START, forward_selection(max_effects, to_floor=True))
    short_sets = fitted_sets.on_short()
    short = apply_moves(additions, SearchState(short_sets.bare, short_sets, max_effects))
    if refutes_torque_noise(fitted_sets.problem, short.current):
        return start
    return apply_moves((short_segments(short), forward_selection(max_effects)), start)


def refined(state: SearchState) -> Selection:
    """Refine the result of forward selection; repeat the search if the bare model was in a local minimum."""
    selection = _one_search(state)
    bare = _better_bare_model(state.fitted_sets.problem, selection)
    if bare is None:
        return selection
    return _one_search(forward(state.fitted_sets.from_bare(bare), state.max_effects))


def _better_bare_model(problem: Problem, selection: Selection) -> Hypothesis | None:
    """Return a better fit of the bare model if its first fit was a local minimum; otherwise None.

    The fit starts from the smallest set of the path. An effect that only leads the fit out of a local minimum is not a
    cause.
    """
    first = selection.bare
    if not selection.path or not first.far_from_noise:
        return None
    name, smallest = selection.path[0]
    bare = refit_without(problem, smallest, name, first)
    escaped = bare.fit.chi2 < first.fit.chi2 / THRESHOLDS.local_minimum_factor
    return bare if escaped or (bare.at_noise_floor and not first.at_noise_floor) else None


def _one_search(state: SearchState) -> Selection:
    """Complete one search after forward selection: refinement, revisions, held-out runs."""
    state = apply_moves(REFINE, state)
    for _ in range(MOST_REVISIONS):
        before = state.current
        state = _revised(state)
        if state.current is before:
            break
    state = apply_moves((LARGER_PRIOR, CONVERGE), state)  # a form can be more probable at a higher criterion
    final = apply_move(HELD_OUT, state)
    misleading = tuple(name for name in state.current.effects if name not in final.current.effects)
    return _selection(final, misleading)


def short_segments(short: SearchState) -> Move:
    """Create the move that fits the set selected with short segments to full segments.

    The set is refined first. If it replaced a smaller set, the smaller set may be better in full segments, and is
    fitted as well unless only noise remains.
    """

    def propose(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
        state = apply_moves(SHORT, short)
        chosen = state.current
        model = _at_full_length(fitted_sets, chosen)
        yield Proposal(model, trials=state.trace)
        if model.at_noise_floor:
            return
        accepted = [frozenset(step.tried) for step in reversed(short.trace) if step.accepted]
        replaced = next((key for key in accepted if len(key) < len(chosen.key) and not key <= chosen.key), None)
        if replaced is not None:
            yield Proposal(_at_full_length(fitted_sets, short.fitted_sets.fits[replaced]))

    return Move(
        "short segments",
        "if the gap is far above the noise, the set that was selected with short segments is fitted to the"
        " full segments, and so is a smaller set that it replaced",
        propose,
        _predicts_whole_segments,
        then="go on",
    )


def _at_full_length(fitted_sets: FittedSets, short: Hypothesis) -> Hypothesis:
    return fitted_to_working_segments(fitted_sets, short) if short.effects else fitted_sets.bare


def _predicts_whole_segments(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    if explains_as_much(fitted_sets.bare, proposal.model, current):
        return Decision(True, "explains about as much with fewer parameters in the full segments")
    better = proposal.model.cost < current.cost
    return Decision(better, f"the criterion {'falls' if better else 'does not fall'} in the full segments")


def _revised(state: SearchState) -> SearchState:
    """Try the revisions, each with the moves that follow it, and return the state after the first success.

    A revision succeeds if it does not increase the criterion significantly; with more parameters, the criterion must
    decrease. Otherwise the revision is undone.
    """
    for revision, moves in REVISIONS:
        after = apply_move(revision, state)
        if after.current is state.current:
            state = after
            continue
        tested = apply_moves(moves, after)
        added = cost_with_prior(tested.current, state.current) - state.current.cost
        richer = tested.current.parameters > state.current.parameters
        if added < (0.0 if richer else indifference(state.fitted_sets.bare, state.current)):
            return tested
        undone = Decision(True, "the criterion of the other set is higher after the moves that follow")
        state = tested.after(revision, Proposal(state.current), undone)
    return state


def _selection(state: SearchState, misleading: tuple[str, ...]) -> Selection:
    """Return the result of the search, with the fits in which each effect is removed or replaced."""
    fitted_sets, chosen = state.fitted_sets.copied(), state.current
    fits = fit_alternatives(fitted_sets, chosen)
    without = {name: fitted_sets.without(chosen, name) for name in chosen.effects}
    final_test = fitted_sets.test(chosen)
    return Selection(
        bare=fitted_sets.bare,
        chosen=chosen,
        fitted=fits,
        final_test=final_test,
        detectable=detectable(chosen, final_test),
        without=without,
        without_substitute={name: fitted_sets.without_substitute(chosen, name) for name in chosen.effects},
        tests_without={name: fitted_sets.test(smaller) for name, smaller in without.items()},
        compensation_odds=compensation_odds(fitted_sets, chosen, without),
        path=_path(fitted_sets, chosen),
        expected=fitted_sets.expected,
        impossible=frozenset(key for key, model in fits.items() if not fitted_sets.possible(model)),
        oversized=fitted_sets.oversized(chosen),
        misleading=misleading,
        trace=state.trace,
    )


def _path(fitted_sets: FittedSets, chosen: Hypothesis) -> tuple[tuple[str, Hypothesis], ...]:
    """Return nested sets up to the selected set, from the successive removal of the least necessary effect."""
    path: list[tuple[str, Hypothesis]] = []
    model = chosen
    while model.effects:
        without_substitute = {name: fitted_sets.without_substitute(model, name) for name in model.effects}
        weakest = min(without_substitute, key=lambda name: without_substitute[name].cost)
        simpler = [
            name
            for name, smaller in without_substitute.items()
            if explains_as_much(fitted_sets.bare, smaller, without_substitute[weakest])
        ]
        weakest = min(simpler, key=lambda name: without_substitute[name].cost, default=weakest)
        path.append((weakest, model))
        model = fitted_sets.without(model, weakest)
    return tuple(reversed(path))

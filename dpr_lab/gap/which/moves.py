"""Order of the moves of the search, and the two moves `known effects` and `converge`."""

from collections.abc import Iterator

from dpr_lab.effects import named_params
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.removals import DROP, SMALLEST_ADEQUATE
from dpr_lab.gap.which.replacements import BETTER_ALTERNATIVE, LARGER_PRIOR, SEVERAL_CAUSES, SIMPLER_FORM
from dpr_lab.gap.which.restarts import escaped
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _with_known_effects(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the bare model with the known effects of the rig, added in the order of their scores."""
    model = fitted_sets.bare
    while score := fitted_sets.best_known(model):
        model = fitted_sets.with_one(model, score)
    if model.effects:
        yield Proposal(escaped(fitted_sets, model))


START = Move(
    "known effects",
    "effects that every rig of this kind has are included first, as far as the recordings show them",
    _with_known_effects,
    lambda *_: Decision(True, "present in every rig of this kind"),
)


def _converged(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set with a converged fit, without effects whose fitted size is zero."""
    model = fitted_sets.fits[current.key]
    if model.effects and not model.fit.converged:
        refitted = fit(fitted_sets.problem, model.estimate, model.fit.free, iterations=2 * EFFORT.fine)
        model = fitted_sets.keep(hypothesis(fitted_sets.problem, model.effects, refitted))
    present = tuple(name for name in model.effects if name in named_params(model.estimate.params))
    if len(present) < len(model.effects):
        free = free_parameters(model.estimate, present, fitted_sets.problem)
        smaller = fit(fitted_sets.problem, model.estimate, free, iterations=EFFORT.fine)
        model = fitted_sets.keep(hypothesis(fitted_sets.problem, present, smaller))
    if model is not current:
        yield Proposal(model)


def _fitted_to_the_end(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    fewer = len(proposal.model.effects) < len(current.effects)
    return Decision(
        True, "the fit converged; effects with zero amplitude are removed" if fewer else "the minimum was not reached"
    )


CONVERGE = Move("converge", "the fit is continued to its minimum", _converged, _fitted_to_the_end)

REFINE = (SMALLEST_ADEQUATE, DROP, SIMPLER_FORM, SEVERAL_CAUSES, DROP, CONVERGE)
"""Moves after forward selection, in order; DROP occurs twice, because a replacement can make another effect
unnecessary.

The last move of the search is `removals.HELD_OUT`, which `select` applies after the revisions.
"""

SHORT = (SMALLEST_ADEQUATE, DROP, SIMPLER_FORM)
"""Moves after forward selection in short segments, in order."""

REVISIONS = ((BETTER_ALTERNATIVE, (DROP, CONVERGE)), (LARGER_PRIOR, (CONVERGE,)))
"""Revisions of the selected set, each with the moves that follow it if it changes the set."""

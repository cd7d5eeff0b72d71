"""Fits of sets in which one effect is replaced by another."""

from collections.abc import Iterator

from dpr_lab.effects import named_params, param_index, without_effect
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.refits import refit, refit_without, shaped
from dpr_lab.gap.hypothesis.score_test import Score
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets


def simpler_forms(sets: FittedSets, current: Hypothesis) -> Iterator[Hypothesis]:
    """Yield sets in which a simpler form replaces an effect that contains this form."""
    for name in current.effects:
        for simpler in sets.library[name].nested:
            if simpler in sets.library and simpler not in current.effects:
                model = replaced(sets, current, name, simpler)
                if model is not None:
                    yield model


def replaced(sets: FittedSets, model: Hypothesis, effect: str, other: str) -> Hypothesis | None:
    """Replace one effect of a set by another; return None if the other effect has no score.

    The fit starts without either effect. If this fit fails, it is repeated from a fit with both effects. In the
    repeated fit, the new effect gradually takes over the share of the replaced effect.
    """
    smaller = sets.without(model, effect)
    score = sets.score(smaller, other)
    if score is None:
        return None
    result = sets.with_one(smaller, score)
    if result.fit.chi2 > EFFORT.nowhere * smaller.fit.chi2:
        result = sets.keep(_handed_over(sets, model, effect, other))
    if model.at_noise_floor and not result.at_noise_floor:
        return imaged(sets, model, effect, score)
    return result


def _handed_over(sets: FittedSets, model: Hypothesis, effect: str, other: str) -> Hypothesis:
    """Replace one effect by another, starting from the amplitudes of the replaced effect.

    Rods that hardly move stick even at the smallest Coulomb friction. Its derivative at zero is then no search
    direction.
    """
    params = model.estimate.params.copy()
    values = named_params(params).get(effect, {})  # empty if its fitted size is zero
    for parameter in sets.library[other].amplitudes:
        params[param_index(other, parameter.name)] = values.get(parameter.name, 0.0)
    start = model.estimate.changed(params=without_effect(params, effect))
    names = tuple(other if name == effect else name for name in model.effects)
    return refit(sets.problem, start, names, EFFORT.fine)


def imaged(sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    """Replace one effect by another, starting from the linear prediction at `model`.

    From this estimate, two indistinguishable effects fit equally well. A fit that starts without both effects may end
    in a local minimum in which another effect has a wrong shape. `score` is the score of the new effect.
    """
    return sets.keep(sets.once((model, effect, score), lambda: _at_image(sets, model, effect, score)))


def _at_image(sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    start, names = shaped(model, score), (*model.effects, score.effect.name)
    free = free_parameters(start, names, sets.problem)
    with_both = hypothesis(sets.problem, names, fit(sets.problem, start, free, iterations=0))
    return refit_without(sets.problem, with_both, effect, sets.bare)

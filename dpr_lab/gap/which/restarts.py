"""Fits of sets from other starting points: they leave local minima, or replace one effect by another.

A few segments, long segments or a wrong order cause local minima.
"""

from collections.abc import Iterator

from dpr_lab.arrays import Array
from dpr_lab.effects import named_params, param_index, without_effect
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.robust import without_outstanding
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.refits import PRELIMINARY, refit, refit_without, settings_to_beat, shaped
from dpr_lab.gap.hypothesis.score_test import Score
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets


def escaped(sets: FittedSets, model: Hypothesis) -> Hypothesis:
    """Refit a set to leave a local minimum; the result is not fitted again."""
    best = sets.keep(sets.once((model,), lambda: _escaped(sets, model)))
    sets.results[best,] = best
    return best


def _escaped(sets: FittedSets, model: Hypothesis) -> Hypothesis:
    if not model.at_noise_floor:
        model = _in_best_order(sets, model)
        model = _better(sets, without_outstanding(sets.problem, model.fit, settings=PRELIMINARY), model)
    if not model.at_noise_floor and model.effects and not sets.is_short:
        short_sets = sets.on_short()
        start = model.estimate.changed(initial=short_sets.bare.estimate.initial)
        near = fit(short_sets.problem, start, model.fit.free, iterations=EFFORT.rough, settings=PRELIMINARY)
        lengthened = _lengthened(sets, near, model.estimate.initial, iterations=EFFORT.fine)
        model = _better(sets, without_outstanding(sets.problem, lengthened, settings=settings_to_beat(model)), model)
    return model


def fitted_to_working_segments(sets: FittedSets, short: Hypothesis) -> Hypothesis:
    """Fit a set to the working segments, starting from its fit to short segments."""
    long = _lengthened(sets, short.fit, sets.bare.estimate.initial, iterations=2 * EFFORT.fine)
    return escaped(sets, hypothesis(sets.problem, short.effects, long))


def _lengthened(sets: FittedSets, near: Fit, initial: Array, iterations: int) -> Fit:
    """Continue a fit to short segments with the segments of this collection.

    Missing initial states are taken from `initial`.
    """
    short_segments = sets.on_short().problem.segments
    initial_states = carried(short_segments, near.estimate.initial, sets.problem.segments, initial)
    start = near.estimate.changed(initial=initial_states)
    return fit(sets.problem, start, near.free, iterations=iterations, settings=PRELIMINARY)


def _in_best_order(sets: FittedSets, model: Hypothesis) -> Hypothesis:
    """Replace the orders of effects by neighbouring orders, as long as this reduces chi2.

    On an arc of less than a turn, different orders have similar signatures, and scores may favour a wrong order.
    """
    orders = [
        (param_index(name, shape.name), shape.scan)
        for name in model.effects
        for shape in sets.library[name].shapes
        if shape.whole and shape.scan
    ]
    for index, scan in orders:
        best = None
        while best is not model:
            best, order = model, model.estimate.params[index]
            for other in (order - 1.0, order + 1.0):
                if other in scan:
                    params = best.estimate.params.copy()
                    params[index] = other
                    start = best.estimate.changed(params=params)
                    near = fit(
                        sets.problem, start, model.fit.free, iterations=EFFORT.fine, settings=settings_to_beat(model)
                    )
                    model = _better(sets, near, model)
    return model


def _better(sets: FittedSets, other: Fit, model: Hypothesis) -> Hypothesis:
    """Return the set of `model` with the better of two fits."""
    return hypothesis(sets.problem, model.effects, other) if other.chi2 < model.fit.chi2 else model


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
    candidate = sets.with_one(smaller, score)
    if candidate.fit.chi2 > EFFORT.nowhere * smaller.fit.chi2:
        candidate = sets.keep(_replaced_from_amplitudes(sets, model, effect, other))
    if model.at_noise_floor and not candidate.at_noise_floor:
        return replaced_linearly(sets, model, effect, score)
    return candidate


def _replaced_from_amplitudes(sets: FittedSets, model: Hypothesis, effect: str, other: str) -> Hypothesis:
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


def replaced_linearly(sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    """Replace one effect by another, starting from the linear prediction at `model`.

    From this estimate, two indistinguishable effects fit equally well. A fit that starts without both effects may end
    in a local minimum in which another effect has a wrong shape. `score` is the score of the new effect.
    """
    return sets.keep(sets.once((model, effect, score), lambda: _at_linear_prediction(sets, model, effect, score)))


def _at_linear_prediction(sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    start, names = shaped(model, score), (*model.effects, score.effect.name)
    free = free_parameters(start, names, sets.problem)
    with_both = hypothesis(sets.problem, names, fit(sets.problem, start, free, iterations=0))
    return refit_without(sets.problem, with_both, effect, sets.bare)

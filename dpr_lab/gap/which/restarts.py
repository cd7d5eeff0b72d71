"""Repeated fits from other initial values, which leave local minima or replace one effect by another.

Local minima are caused by a few outstanding segments, by long segments, or by a wrong order of a periodic effect.
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


def escaped(fitted_sets: FittedSets, model: Hypothesis) -> Hypothesis:
    """Return the best of repeated fits of a set; the result is stored and not fitted again."""
    best = fitted_sets.keep(fitted_sets.once((model,), lambda: _escaped(fitted_sets, model)))
    fitted_sets.results[best,] = best
    return best


def _escaped(fitted_sets: FittedSets, model: Hypothesis) -> Hypothesis:
    if not model.at_noise_floor:
        model = _in_best_order(fitted_sets, model)
        model = _better(fitted_sets, without_outstanding(fitted_sets.problem, model.fit, settings=PRELIMINARY), model)
    if not model.at_noise_floor and model.effects and not fitted_sets.is_short:
        short_sets = fitted_sets.on_short()
        start = model.estimate.changed(initial=short_sets.bare.estimate.initial)
        near = fit(short_sets.problem, start, model.fit.free, iterations=EFFORT.rough, settings=PRELIMINARY)
        lengthened = _lengthened(fitted_sets, near, model.estimate.initial, iterations=EFFORT.fine)
        model = _better(
            fitted_sets, without_outstanding(fitted_sets.problem, lengthened, settings=settings_to_beat(model)), model
        )
    return model


def fitted_to_working_segments(fitted_sets: FittedSets, short: Hypothesis) -> Hypothesis:
    """Fit a set to the working segments, starting from its fit to short segments."""
    long = _lengthened(fitted_sets, short.fit, fitted_sets.bare.estimate.initial, iterations=2 * EFFORT.fine)
    return escaped(fitted_sets, hypothesis(fitted_sets.problem, short.effects, long))


def _lengthened(fitted_sets: FittedSets, near: Fit, initial: Array, iterations: int) -> Fit:
    """Continue a fit to short segments with the segments of `fitted_sets`.

    `initial` contains the initial states of segments whose states the short segments do not determine.
    """
    short_segments = fitted_sets.on_short().problem.segments
    initial_states = carried(short_segments, near.estimate.initial, fitted_sets.problem.segments, initial)
    start = near.estimate.changed(initial=initial_states)
    return fit(fitted_sets.problem, start, near.free, iterations=iterations, settings=PRELIMINARY)


def _in_best_order(fitted_sets: FittedSets, model: Hypothesis) -> Hypothesis:
    """Change the integer orders of effects by one, as long as this reduces chi2.

    On an arc of less than a turn, different orders have similar signatures, and scores may favour a wrong order.
    """
    orders = [
        (param_index(name, shape.name), shape.scan)
        for name in model.effects
        for shape in fitted_sets.library[name].shapes
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
                        fitted_sets.problem,
                        start,
                        model.fit.free,
                        iterations=EFFORT.fine,
                        settings=settings_to_beat(model),
                    )
                    model = _better(fitted_sets, near, model)
    return model


def _better(fitted_sets: FittedSets, other: Fit, model: Hypothesis) -> Hypothesis:
    """Return the set of `model` with the better of two fits."""
    return hypothesis(fitted_sets.problem, model.effects, other) if other.chi2 < model.fit.chi2 else model


def simpler_forms(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Hypothesis]:
    """Yield sets in which a simpler form replaces an effect that contains this form."""
    for name in current.effects:
        for simpler in fitted_sets.library[name].nested:
            if simpler in fitted_sets.library and simpler not in current.effects:
                model = replaced(fitted_sets, current, name, simpler)
                if model is not None:
                    yield model


def replaced(fitted_sets: FittedSets, model: Hypothesis, effect: str, other: str) -> Hypothesis | None:
    """Replace one effect of a set by another; return None if the other effect has no score.

    The first fit starts from the set without both effects. If it fails, a fit starts from the amplitudes of the
    replaced effect. If the original set leaves only noise but the new set does not, a fit starts from the linear
    prediction at the original set.
    """
    smaller = fitted_sets.without(model, effect)
    score = fitted_sets.score(smaller, other)
    if score is None:
        return None
    candidate = fitted_sets.with_one(smaller, score)
    if candidate.fit.chi2 > EFFORT.nowhere * smaller.fit.chi2:
        candidate = fitted_sets.keep(_replaced_from_amplitudes(fitted_sets, model, effect, other))
    if model.at_noise_floor and not candidate.at_noise_floor:
        return replaced_linearly(fitted_sets, model, effect, score)
    return candidate


def _replaced_from_amplitudes(fitted_sets: FittedSets, model: Hypothesis, effect: str, other: str) -> Hypothesis:
    """Replace one effect by another, starting from the amplitudes of the replaced effect.

    This is necessary for Coulomb friction: rods that hardly move stick even at the smallest friction, so the derivative
    at zero friction is useless.
    """
    params = model.estimate.params.copy()
    values = named_params(params).get(effect, {})  # empty if its fitted size is zero
    for parameter in fitted_sets.library[other].amplitudes:
        params[param_index(other, parameter.name)] = values.get(parameter.name, 0.0)
    start = model.estimate.changed(params=without_effect(params, effect))
    names = tuple(other if name == effect else name for name in model.effects)
    return refit(fitted_sets.problem, start, names, EFFORT.fine)


def replaced_linearly(fitted_sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    """Replace one effect by another, starting from the linear prediction at `model`.

    There, an indistinguishable effect fits equally well. A fit that starts from the set without both effects may end in
    a local minimum in which a remaining effect has a wrong shape. `score` is the score of the new effect.
    """
    return fitted_sets.keep(
        fitted_sets.once((model, effect, score), lambda: _at_linear_prediction(fitted_sets, model, effect, score))
    )


def _at_linear_prediction(fitted_sets: FittedSets, model: Hypothesis, effect: str, score: Score) -> Hypothesis:
    start, names = shaped(model, score), (*model.effects, score.effect.name)
    free = free_parameters(start, names, fitted_sets.problem)
    with_both = hypothesis(fitted_sets.problem, names, fit(fitted_sets.problem, start, free, iterations=0))
    return refit_without(fitted_sets.problem, with_both, effect, fitted_sets.bare)

"""Repeated fits that leave local minima.

A few segments, long segments or a wrong order cause such minima.
"""

from dpr_lab.arrays import Array
from dpr_lab.effects import param_index
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.robust import without_outstanding
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, hypothesis
from dpr_lab.gap.hypothesis.refits import PRELIMINARY, beating, preliminary_fit
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
        short = sets.on_short()
        start = model.estimate.changed(initial=short.bare.estimate.initial)
        near = preliminary_fit(short.problem, start, model.fit.free, iterations=EFFORT.rough)
        long = _lengthened(sets, near, model.estimate.initial, iterations=EFFORT.fine)
        model = _better(sets, without_outstanding(sets.problem, long, settings=beating(model)), model)
    return model


def carried_over(sets: FittedSets, short: Hypothesis) -> Hypothesis:
    """Fit a set to the working segments, starting from its fit to short segments."""
    long = _lengthened(sets, short.fit, sets.bare.estimate.initial, iterations=2 * EFFORT.fine)
    return escaped(sets, hypothesis(sets.problem, short.effects, long))


def _lengthened(sets: FittedSets, near: Fit, initial: Array, iterations: int) -> Fit:
    """Continue a fit to short segments with the segments of this collection.

    Missing initial states are taken from `initial`.
    """
    short = sets.on_short().problem.segments
    initial_states = carried(short, near.estimate.initial, sets.problem.segments, initial)
    start = near.estimate.changed(initial=initial_states)
    return preliminary_fit(sets.problem, start, near.free, iterations=iterations)


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
                    near = fit(sets.problem, start, model.fit.free, iterations=EFFORT.fine, settings=beating(model))
                    model = _better(sets, near, model)
    return model


def _better(sets: FittedSets, other: Fit, model: Hypothesis) -> Hypothesis:
    """Return the set of `model` with the better of two fits."""
    return hypothesis(sets.problem, model.effects, other) if other.chi2 < model.fit.chi2 else model

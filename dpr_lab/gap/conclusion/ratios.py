"""Ratios to b with their intervals, and the value of b that absolute sizes assume."""

from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE, alone_share, unknown_ratios
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.conclusion.uncertainty import by_unseen_ratios
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.state import Transferred
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.setup import only_inner


def ratios(problem: Problem, model: Hypothesis, covariance: Array, rig: Rig) -> dict[str, Interval]:
    """Return the ratios to b with 90 % intervals.

    The interval of a friction ratio contains no negative values. The same applies to an interval that the bounds of the
    rig file widen.

    Args:
        problem: segments and noise
        model: a fitted set of effects
        covariance: (free, free) covariance of its fitted values
        rig: bounds
    """
    values = model.estimate.ratios[: len(RATIOS)].tolist()
    prior_variance = by_unseen_ratios(problem, model, rig)
    reaches = NORMAL_Q90 * np.sqrt(np.diag(ratio_covariance(model.fit, covariance)) + prior_variance)
    positive = (prior_variance > 0.0) | np.isin(np.arange(len(RATIOS)), FRICTION)
    floors = np.where(positive, 0.0, -np.inf).tolist()
    return {
        name: Interval.about(value, reach, floor)
        for name, value, reach, floor in zip(RATIOS, values, reaches.tolist(), floors, strict=True)
    }


def determined(problem: Problem, fit: Fit, covariance: Array, rig: Rig) -> tuple[dict[str, Interval], Array]:
    """Return the ratios that the recordings determine.

    The ratios refer to the inertia b, or to a if only the inner rod is mounted. The value and the covariance of a
    fitted parameter are divided by this inertia. The arguments are those of `ratios`.

    Returns:
        the ratios, and their (n, n) covariance
    """
    alone, reaches = only_inner(problem.segments.setups), NORMAL_Q90 * np.sqrt(np.diag(covariance))
    parameter_of, places, divisors = {}, list[int](), list[float]()
    for place, parameter in enumerate(fit.free):
        if (ratio := ratio_of(parameter, fit.estimate, rig, alone=alone)) is not None:
            name, value, per = ratio
            error = float(reaches[place]) / per
            floor = 0.0 if parameter.lower == 0.0 else -np.inf
            parameter_of[name] = Interval.about(value, error, floor)
            places.append(place)
            divisors.append(per)
    return parameter_of, covariance[np.ix_(places, places)] / np.outer(divisors, divisors)


def most_deviating(state: Transferred) -> str:
    """Return the fitted ratio that deviates most from its nominal value, as a clause with both values.

    Friction ratios are not compared, because their nominal values are rough guesses.
    """
    setups, fit, rig = state.fitted.problem.segments.setups, state.selection.chosen.fit, state.fitted.recordings.rig
    rated = unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))
    nominal, alone, deviations = fit.estimate.changed(ratios=rated), only_inner(setups), dict[str, float]()
    for parameter in fit.free:
        if parameter.block == "ratios" and parameter.place < len(RATIOS) and parameter.place not in FRICTION:
            fitted, of_rig = (ratio_of(parameter, estimate, rig, alone=alone) for estimate in (fit.estimate, nominal))
            if fitted and of_rig:
                unit = " 1/s²" if parameter.name.startswith("e") else ""
                words = f": {fitted[0]} is {fitted[1]:.3g}{unit} in the fit and {of_rig[1]:.3g}{unit} from the rig file"
                deviations[words] = abs(fitted[1] / of_rig[1] - 1)
    return max(deviations, key=deviations.__getitem__, default="")


def ratio_fields(state: Transferred) -> dict[str, Any]:
    """Return the fields of a diagnosis about ratios and b.

    If only the inner rod is mounted, the ratios are those to a.
    """
    problem, chosen, rig = state.fitted.problem, state.selection.chosen, state.fitted.recordings.rig
    setups, unknown, alone = problem.segments.setups, chosen.estimate.ratios, only_inner(problem.segments.setups)
    of_rods = ratios(problem, chosen, state.covariance, rig)
    shown, covariance = determined(problem, chosen.fit, state.covariance, rig)
    return {
        "ratios": shown if alone else of_rods,
        "fitted": [*of_rods.values()] if alone else [],
        "ratio_covariance": ratio_covariance(chosen.fit, state.covariance).tolist(),
        "determined": shown,
        "determined_covariance": covariance.tolist(),
        "p_over_b": float(unknown[ON_ELBOW]) if any(setup.alone for setup in setups) else None,
        "scale_b": float(unknown[SCALE]),
    }


def scale(state: Transferred) -> Scale:
    """Return the value of b that absolute sizes assume, fitted or from the rig file.

    If only the inner rod is mounted, the value of a is stated instead.
    """
    setups, unknown = state.fitted.problem.segments.setups, state.selection.chosen.estimate.ratios
    alone = only_inner(setups)
    of_b = _scale_b(state, alone)
    return of_b.as_inertia("a", alone_share(unknown)) if alone else of_b


def _scale_b(state: Transferred, alone: bool) -> Scale:
    rig, unknown, intervals = state.fitted.recordings.rig, state.selection.chosen.estimate.ratios, state.intervals
    b = float(unknown[SCALE])
    if ("", "b") in intervals:
        setups = state.fitted.problem.segments.setups
        driven = any(setup.torques is not None and setup.arm_moves for setup in setups)
        of_drive = drive_gain(rig).relative_std if driven else 0.0
        reach = float(np.hypot(intervals["", "b"], NORMAL_Q90 * b * of_drive))
        return Scale(b=b, interval90=(max(b - reach, 1e-3 * b), b + reach), fixed_by="data", constants_std=of_drive)
    places = {p.place: i for i, p in enumerate(state.selection.chosen.fit.free) if p.block == "ratios"}
    visible = sorted(places)
    columns = [places[place] for place in visible]
    # an effect such as a spring may make a ratio uncertain
    return posterior_of(unknown, rig, visible, state.covariance[np.ix_(columns, columns)], alone=alone).scale(b)


def ratio_covariance(fit: Fit, covariance: Array) -> Array:
    """Return the (5, 5) covariance of the ratios, from that of the fitted values (free, free).

    It is zero for ratios of the rig file.
    """
    column_of = {parameter.place: i for i, parameter in enumerate(fit.free) if parameter.block == "ratios"}
    of_ratios = np.zeros((len(RATIOS), len(RATIOS)))
    visible = [i for i in range(len(RATIOS)) if i in column_of]
    columns = [column_of[i] for i in visible]
    of_ratios[np.ix_(visible, visible)] = covariance[np.ix_(columns, columns)]
    return of_ratios

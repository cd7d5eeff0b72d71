"""Ratios to b with their intervals, and the inertia b that absolute sizes assume."""

from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE, UNKNOWN_RATIOS, alone_share, unknown_ratios
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.conclusion.uncertainty import by_undetermined_ratios
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.state import Transferred
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.prior_update import Posterior, clamped_cosine, posterior_of, prior_ratio_std
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.setup import only_inner


def ratios(problem: Problem, model: Hypothesis, covariance: Array, rig: Rig) -> dict[str, Interval]:
    """Return the ratios to b with 90 % intervals.

    An undetermined ratio has the interval that follows from the rig file. The interval of a friction ratio contains no
    negative values, and neither does an interval that the rig file widens.

    Args:
        problem: segments and noise
        model: a fitted set of effects
        covariance: (free, free) covariance of its fitted values
        rig: rig file with the bounds of undetermined ratios
    """
    values = model.estimate.ratios[: len(RATIOS)].tolist()
    by_prior = unknown_covariance(model.fit, by_undetermined_ratios(problem, model.fit))
    fitted = np.isin(np.arange(len(RATIOS)), [p.place for p in model.fit.free if p.block == "ratios"])
    prior_variance = np.where(fitted, np.diag(by_prior)[: len(RATIOS)], np.square(prior_ratio_std(rig)))
    variance = np.diag(unknown_covariance(model.fit, covariance))[: len(RATIOS)]
    half_widths = NORMAL_Q90 * np.sqrt(variance + prior_variance)
    positive = (prior_variance > 0.0) | np.isin(np.arange(len(RATIOS)), FRICTION)
    floors = np.where(positive, 0.0, -np.inf).tolist()
    return {
        name: Interval.about(value, half_width, floor)
        for name, value, half_width, floor in zip(RATIOS, values, half_widths.tolist(), floors, strict=True)
    }


def determined(problem: Problem, fit: Fit, covariance: Array, rig: Rig) -> tuple[dict[str, Interval], Array]:
    """Return the ratios that the recordings determine.

    The ratios refer to the inertia b, or to a if only the inner rod is mounted. The intervals and the covariance
    include the uncertainty that undetermined ratios cause; e1/a and c1/a of the inner rod alone do not depend on
    undetermined ratios. The arguments are those of `ratios`.

    Returns:
        the ratios by name, and their (n, n) covariance
    """
    alone = only_inner(problem.segments.setups)
    by_prior = np.zeros_like(covariance) if alone else by_undetermined_ratios(problem, fit)
    covariance = covariance + by_prior
    half_widths = NORMAL_Q90 * np.sqrt(np.diag(covariance))
    parameter_of, places, divisors = {}, list[int](), list[float]()
    for place, parameter in enumerate(fit.free):
        if (ratio := ratio_of(parameter, fit.estimate, rig, alone=alone)) is not None:
            name, value, per = ratio
            error = float(half_widths[place]) / per
            floor = 0.0 if parameter.lower == 0.0 or by_prior[place, place] > 0.0 else -np.inf
            parameter_of[name] = Interval.about(value, error, floor)
            places.append(place)
            divisors.append(per)
    return parameter_of, covariance[np.ix_(places, places)] / np.outer(divisors, divisors)


def most_deviating(state: Transferred) -> str:
    """Return a clause on the fitted ratio with the largest relative deviation from its nominal value.

    The clause starts with a colon and contains both values. Friction ratios are not compared, because their nominal
    values are rough guesses.
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
        "ratio_covariance": unknown_covariance(chosen.fit, state.covariance)[: len(RATIOS), : len(RATIOS)].tolist(),
        "determined": shown,
        "determined_covariance": covariance.tolist(),
        "p_over_b": float(unknown[ON_ELBOW]) if any(setup.alone for setup in setups) else None,
        "scale_b": float(unknown[SCALE]),
    }


def scale(state: Transferred) -> Scale:
    """Return the inertia b that absolute sizes assume: fitted, or from the rig file.

    If only the inner rod is mounted, the value of a is stated instead.
    """
    problem, fit, rig = state.fitted.problem, state.selection.chosen.fit, state.fitted.recordings.rig
    unknown, alone = fit.estimate.ratios, only_inner(problem.segments.setups)
    of_b = fitted_scale(problem, fit, state.covariance, rig)
    if of_b is None:
        of_b = rig_posterior(problem, fit, state.covariance, rig).scale(float(unknown[SCALE]))
    return of_b.as_inertia("a", alone_share(unknown)) if alone else of_b


def rig_posterior(problem: Problem, fit: Fit, covariance: Array, rig: Rig) -> Posterior:
    """Return the distribution of the rig parameters, given the fitted ratios and their covariance.

    The arguments are those of `ratios`.
    """
    setups = problem.segments.setups
    visible = sorted(parameter.place for parameter in fit.free if parameter.block == "ratios")
    errors = unknown_covariance(fit, covariance)[np.ix_(visible, visible)]
    alone, clamped = only_inner(setups), clamped_cosine(setups)
    return posterior_of(fit.estimate.ratios, rig, visible, errors, alone=alone, clamped=clamped)


def fitted_scale(problem: Problem, fit: Fit, covariance: Array, rig: Rig) -> Scale | None:
    """Return the inertia b that the recordings determine, with its interval; None if they do not determine it.

    With an elbow clamped in all runs, b follows from the inertia of the whole body, a/b and d/b (`Scale.sizes90`). The
    arguments are those of `ratios`.
    """
    is_scale = [parameter.block == "ratios" and parameter.place == SCALE for parameter in fit.free]
    if not any(is_scale):
        return None
    b, setups = float(fit.estimate.ratios[SCALE]), problem.segments.setups
    driven = any(setup.torques is not None and setup.arm_moves for setup in setups)
    of_drive = drive_gain(rig).relative_std if driven else 0.0
    covariance = covariance + np.diag(np.where(is_scale, (b * of_drive) ** 2, 0.0))
    if clamped_cosine(setups) is not None:
        of_b = rig_posterior(problem, fit, covariance, rig).scale(b)
    else:
        half_width = NORMAL_Q90 * float(unknown_covariance(fit, covariance)[SCALE, SCALE]) ** 0.5
        of_b = Scale(b=b, interval90=(max(b - half_width, 1e-3 * b), b + half_width), fixed_by="data")
    weighs = any(setup.weighs for setup in setups)
    return of_b.model_copy(update={"constants_std": of_drive, "by_friction": not weighs})


def unknown_covariance(fit: Fit, covariance: Array) -> Array:
    """Return the (7, 7) covariance of the ratios, b and p/b, from that of the fitted values (free, free).

    The rows and columns of values that come from the rig file are zero.
    """
    column_of = {parameter.place: i for i, parameter in enumerate(fit.free) if parameter.block == "ratios"}
    places, columns = list(column_of), list(column_of.values())
    of_unknowns = np.zeros((len(UNKNOWN_RATIOS), len(UNKNOWN_RATIOS)))
    of_unknowns[np.ix_(places, places)] = covariance[np.ix_(columns, columns)]
    return of_unknowns

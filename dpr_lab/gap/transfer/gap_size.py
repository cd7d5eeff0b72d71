"""Gap above the noise before and after correction: by joint, by effect, and by segment length."""

from collections.abc import Mapping
from functools import cache, partial

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import Fit, GaussNewton, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import TINY
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import bounded_residual, residual_statistics
from dpr_lab.gap.result.gap_budget import GapBudget
from dpr_lab.gap.result.gap_size import ClosedShare, Gap
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.state import Selected
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.where.discrepancy import Discrepancy

HORIZONS_S = (0.25, 0.5, 1.0, 2.0)
"""Segment lengths for which the gap is reported, s: from lengths at which every model fits, up to the onset of
chaos."""

TWO_DIGITS = GaussNewton(converged=1e-3, converged_frozen=1e-4)
"""Tolerances of a fit whose gap is reported with two digits."""


def gap(
    state: Selected,
    transfer: Transfer,
    simulated: Mapping[str, FreeRuns],
    budget: GapBudget,
    remainder: Discrepancy | None,
) -> Gap:
    """Compute all measures of the gap that a diagnosis reports.

    Args:
        state: the state with the selected set of effects
        transfer: performance of the selected set on held-out recordings
        simulated: free runs of the models before and after the correction along all recordings, held-out ones included
        budget: reproducible and other shares of the gap
        remainder: discrepancy term of the selected set; None if only noise remains
    """
    problem, selection = state.fitted.problem, state.selection
    bare, chosen = selection.bare, selection.chosen
    errors = {name: runs.errors_rad for name, runs in simulated.items()}
    return Gap(
        floor_rad=floor_rad(problem),
        before_rad=gap_rad(problem, bare),
        after_rad=gap_rad(problem, chosen),
        explained_share=selection.share_explained,
        closed_held_out=ClosedShare(
            estimate=transfer.closed.value,
            interval90=transfer.closed.interval90,
            per_run={name: share.value for name, share in transfer.left_out.items()},
            held_out={name: share.value for name, share in transfer.held_out.items()},
        ),
        by_horizon=by_horizon(state.fitted.recordings, problem, selection.models),
        free_run_rad={
            run: {name: of_model[run] for name, of_model in errors.items()}
            for run in errors["before"]
            if all(run in of_model for of_model in errors.values())
        },
        waterfall=[
            {"effect": name, "gap_rad": _per_reading(gaps, problem), "rms_rad": float(np.linalg.norm([*gaps.values()]))}
            for name, model in selection.path
            for gaps in (gap_rad(problem, model),)
        ],
        budget=budget,
        remainder_Nm=dict(zip(ALL_AXES, remainder.torque_Nm, strict=False)) if remainder else {},
        remainder_rad=dict(zip(ALL_AXES, remainder.reading_rad, strict=False)) if remainder else {},
    )


def floor_rad(problem: Problem) -> dict[str, float]:
    """Return the rms noise of a reading that the diagnosis fits, rad, by axis."""
    return _by_axis(np.sqrt(_mean(np.where(problem.read, np.maximum(problem.weight, TINY) ** -2.0, 0.0), problem)))


def gap_rad(problem: Problem, model: Hypothesis) -> dict[str, float]:
    """Return the rms residual of a model above the noise, rad, by axis."""
    return _above_noise(problem, model.fit, model.residuals.level)


def _above_noise(problem: Problem, fitted: Fit, level: float) -> dict[str, float]:
    """Return the rms residual of a fit above a noise level, rad, by axis."""
    residual = bounded_residual(problem, fitted)
    lost = 1 - (problem.segments.initial_values.sum() + len(fitted.free)) / np.count_nonzero(problem.read)
    above = _mean(residual**2, problem) / lost - level
    return _by_axis(np.sqrt(np.maximum(above, 0.0) / np.maximum(_mean(problem.weight**2, problem), TINY)))


def by_horizon(
    recordings: Recordings, working: Problem, models: Mapping[str, Hypothesis]
) -> dict[str, dict[str, float]]:
    """Return the gap, rad, by segment length, s, and by model, with fitted initial states of the segments."""
    gaps: dict[str, dict[str, float]] = {}
    for length in HORIZONS_S:
        problem, initial = (working, None) if length == recordings.working_length else recordings.cut(length)
        of_model = cache(partial(_at_length, problem, initial, working))
        gaps[f"{length:g}"] = {name: _per_reading(of_model(model), problem) for name, model in models.items()}
    return gaps


def _at_length(problem: Problem, initial: Array | None, working: Problem, model: Hypothesis) -> dict[str, float]:
    """Return the rms residual above the noise, rad, by axis, in segments of another length.

    Args:
        problem: these segments
        initial: initial states of these segments before the fit; None if `problem` is that of the fit
        working: segments of the fit
        model: the fitted model
    """
    if initial is None:
        return gap_rad(problem, model)
    states = carried(working.segments, model.estimate.initial, problem.segments, initial)
    fitted = fit(problem, model.estimate.changed(initial=states), (), settings=TWO_DIGITS)
    return _above_noise(problem, fitted, residual_statistics(problem, fitted).level)


def _per_reading(by_axis: Mapping[str, float], problem: Problem) -> float:
    """Return the root mean square over the axes that have readings."""
    return float(np.sqrt(np.mean(np.square([*by_axis.values()])[problem.read.any(axis=0)])))


def _mean(values: Array, problem: Problem) -> Array:
    """Return the (axes,) mean of values (samples, 2) over the used readings of each axis.

    The mean is zero for an axis without readings.
    """
    counts = np.count_nonzero(problem.read, axis=0)
    return values.sum(axis=0) / np.maximum(counts, 1)


def _by_axis(values: Array) -> dict[str, float]:
    return dict(zip(ALL_AXES, values.tolist(), strict=False))

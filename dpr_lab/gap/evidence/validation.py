"""Validation by free runs before and after correction: errors, uncertainty, areas between distributions, curves.

Only readings before the predictability horizon are compared. The area between the empirical distributions F of
simulated and measured angles,

    d = integral |F_S(x) - F_D(x)| dx,

has the unit rad, contains no arbitrary tolerance or weight, and is zero only for equal distributions.

Source: S. Ferson, W. L. Oberkampf & L. Ginzburg (2008), Model validation and predictive capability for the thermal
challenge problem, Computer Methods in Applied Mechanics and Engineering 197, 2408-2430.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.evidence.budget import mean_squares, sources, uncertainty_sources
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.evidence import Budget, Curves, RunBudget
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import FREE_RUN, FreeRuns, FreeSwing, growth_rate, horizon
from dpr_lab.rig_tables import INPUT_UNITS


@dataclass(frozen=True, slots=True)
class CurveSettings:
    """Resolution of the stored curves."""

    rate_hz: float = 50.0
    """Approximate rate of the points of a stored curve, Hz: ten points per period of the fastest swing."""
    digits: int = 5
    """Number of digits after the decimal point of an angle in rad."""


CURVE = CurveSettings()


def validation(
    recordings: Recordings, problem: Problem, models: Mapping[str, Hypothesis], simulated: Mapping[str, FreeRuns]
) -> tuple[Budget, list[Curves]]:
    """Return the validation budget and curves from free runs before and after correction.

    Args:
        recordings: the fitted runs
        problem: segments of the fitted runs
        models: models before and after correction
        simulated: free runs along all recordings, fitted ones first, by model
    """
    by_run = zip(*(runs.swings for runs in simulated.values()), strict=True)
    pairs = [dict(zip(simulated, of_models, strict=True)) for of_models in by_run]
    ends = [horizon(pair["after"]) for pair in pairs]
    untils = [FREE_RUN.length_s if end is None else end for end in ends]
    samples = [_compared(pair, until_s) for pair, until_s in zip(pairs, untils, strict=True)]
    of_model = cache(lambda model, runs: list(sources(problem, model, recordings, runs)))
    parts = {name: of_model(model, simulated[name]) for name, model in models.items()}
    variances = {name: mean_squares(parts[name], samples) for name in models}
    errors = {name: _mean_errors(simulated[name], samples) for name in models}
    counts = np.array([of_run.sum() for of_run in samples], dtype=np.float64)
    share = counts / max(counts.sum(), 1.0)
    runs = [
        RunBudget(
            run=pair["after"].record.run.name,
            held_out=i >= len(recordings.records),
            until_s=untils[i],
            reaches_horizon=ends[i] is not None,
            growth_per_s=growth_rate(pair["after"], untils[i]),
            **_rms(
                error={name: errors[name][i] for name in models},
                u={name: variances[name][:, i].sum() for name in models},
            ),
            **_areas(pair, samples[i]),
        )
        for i, pair in enumerate(pairs)
    ]
    pooled = {name: variances[name] @ share for name in models}
    budget = Budget(
        sources=uncertainty_sources(parts, pooled),
        **_rms(
            error={name: errors[name] @ share for name in models}, u={name: np.sum(pooled[name]) for name in models}
        ),
        runs=runs,
    )
    return budget, [_curves(recordings, pair, run) for pair, run in zip(pairs, runs, strict=True)]


def _compared(pair: Mapping[str, FreeSwing], until_s: float) -> Flags:
    """Return the (n, 2) mask of the readings that are compared: before `until_s`, and simulated by both models."""
    after, followed = pair["after"], np.all([np.isfinite(swing.predicted) for swing in pair.values()], axis=0)
    return after.compared & (after.t <= until_s)[:, None] & followed


def _mean_errors(runs: FreeRuns, samples: Sequence[Flags]) -> Array:
    """Return the (runs,) mean squared error of the compared readings, rad^2; zero without such readings."""
    errors = [(swing.predicted - swing.measured)[of_run] for swing, of_run in zip(runs.swings, samples, strict=True)]
    return np.array([np.mean(of_run**2) if len(of_run) else 0.0 for of_run in errors])


def _rms(**squares: Mapping[str, float]) -> dict[str, float]:
    """Return root mean squares, with the field names of `RunBudget`, of mean squares by quantity and model."""
    return {
        f"{quantity}_{name}_rad": float(np.sqrt(square))
        for quantity, by_model in squares.items()
        for name, square in by_model.items()
    }


def _areas(pair: Mapping[str, FreeSwing], compared: Flags) -> dict[str, float]:
    """Return the areas between measured and simulated distributions, rad, for both models and for noise alone.

    Each area is a mean over the joints, with the field names of `RunBudget`.
    """
    after = pair["after"]
    noise = np.random.default_rng(0).standard_normal(after.measured.shape) / np.where(compared, after.weight, 1.0)
    areas: dict[str, list[float]] = {"before": [], "after": [], "noise": []}
    for j in range(after.measured.shape[1]):
        samples = compared[:, j]
        if samples.any():
            for name, swing in pair.items():
                areas[name].append(_area_between(swing.predicted[samples, j], swing.measured[samples, j]))
            exact = after.predicted[samples, j]
            areas["noise"].append(_area_between(exact, exact + noise[samples, j]))
    return {f"area_{name}_rad": float(np.mean(values)) if values else 0.0 for name, values in areas.items()}


def _area_between(first: Array, second: Array) -> float:
    """Return the area between the empirical distribution functions of two samples of equal size.

    scipy's wasserstein_distance returns the same area, but its import is slow.
    """
    return float(np.mean(np.abs(np.sort(first) - np.sort(second))))


def _curves(recordings: Recordings, pair: Mapping[str, FreeSwing], run: RunBudget) -> Curves:
    after = pair["after"]
    samples = slice(None, None, max(1, round(len(after.t) / (FREE_RUN.length_s * CURVE.rate_hz))))
    joints, moving = recordings.rig.encoders.joint_angles, after.setup.arm_moves
    arm = [swing[samples, 2] for swing in (after.measured, pair["before"].predicted, after.predicted) if moving]
    return Curves(
        run=run.run,
        held_out=run.held_out,
        settled_s=FREE_RUN.settle_s,
        until_s=run.until_s,
        t_s=_rounded(after.t[samples]),
        measured_rad=_rounded(joints.to_rods(after.measured[samples, :2])),
        before_rad=_rounded(joints.to_rods(pair["before"].predicted[samples, :2])),
        after_rad=_rounded(joints.to_rods(after.predicted[samples, :2])),
        rods=1 if after.setup.alone else 2,
        arm_rad=_rounded(np.stack(arm, axis=1)) if moving else [],
        **_input(recordings, after, after.t[samples]),
    )


def _input(recordings: Recordings, swing: FreeSwing, t: Array) -> dict[str, Any]:
    """Return the input of the arm's drive at given times, with its name and unit, as fields of `Curves`.

    `t` contains (n,) times after the first reading, s. The result is empty if the run has no input.
    """
    run, motor = swing.record.run, recordings.rig.motor
    if run.arm_input is None or motor is None:
        return {}
    rows = np.searchsorted(run.t + run.input_delay_s, swing.record.t[0] + t, side="right") - 1
    values = np.round(run.arm_input[np.maximum(rows, 0)], CURVE.digits)
    return {"input": values.tolist(), "input_name": f"{motor.input} ({INPUT_UNITS[motor.input]})"}


def _rounded(values: Array) -> Any:
    """Return the rounded numbers as nested lists, with zero for failed simulations."""
    return np.round(np.nan_to_num(values), CURVE.digits).tolist()

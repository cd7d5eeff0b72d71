"""Test whether the input of a driven arm acts at other instants than its rows, or changes between them.

A row shows the value of its instant; how long it acts is not recorded (docs/decisions/0025). The fit holds each value
until the next row. It is repeated with other delays, and with rows that are samples of a continuous signal. Chi-square
is a parabola of the delay, because the readings change in proportion to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.errors import IdentificationError
from dpr_lab.identification.moving_arm.fit import ArmFit, fit_segments
from dpr_lab.identification.moving_arm.problem import problem_of, recordings_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class InputRows:
    """Limits of this test."""

    doubted: float = 1.1
    """Reduced chi-square above which it is made."""
    better: float = 1.3
    """Factor by which the reduced chi-square must fall, as for an additional effect of a diagnosis."""
    least: float = 0.05
    """Smallest delay that is reported, as a share of the interval between rows."""
    explained: float = 0.8
    """Share of the excess chi-square that a delay after the rows must explain: it is an effect of the drive, and other
    effects resemble it in part.
    """
    step_s: float = 0.004
    """Smallest step of the delay."""
    most_steps: float = 8.0
    """Largest distance of a delay from the tried ones, in steps; the parabola is not valid farther away."""


INPUT_ROWS = InputRows()


@dataclass(frozen=True, slots=True)
class _InputModel:
    """The input between and after its rows, and the misfit with it."""

    delay_s: float
    """Delay in addition to that of the runs, s."""
    continuous: bool
    """Whether the rows are samples of a continuous signal."""
    misfit: float
    """Reduced chi-square."""


@dataclass(frozen=True, slots=True)
class _Tested:
    """The fit whose segments are fitted again with another input."""

    fit: ArmFit
    runs: Sequence[Run]
    rig: Rig

    def model(self, delay_s: float, continuous: bool) -> _InputModel:
        """Fit with an input that acts later, or changes between rows.

        Raises:
            IdentificationError: it cannot be fitted.
        """
        runs = [
            replace(run, input_delay_s=run.input_delay_s + delay_s, continuous=continuous or run.continuous)
            for run in self.runs
        ]
        problem = problem_of(recordings_of(runs, self.rig), self.rig, self.fit.problem.cuts, self.fit.problem.max_step)
        fit = fit_segments(problem, self.fit.p, self.fit.initial)
        return _InputModel(delay_s, continuous, fit.chi2_per_dof)

    def near(self, centre: _InputModel, step_s: float) -> _InputModel:
        """The best delay according to the parabola through one model and its two neighbours."""
        before, after = (self.model(centre.delay_s + sign * step_s, centre.continuous).misfit for sign in (-1, 1))
        curvature = before - 2 * centre.misfit + after
        if curvature <= 0:
            return centre
        steps = float(np.clip((before - after) / (2 * curvature), -INPUT_ROWS.most_steps, INPUT_ROWS.most_steps))
        best = self.model(centre.delay_s + steps * step_s, centre.continuous)
        return min(centre, best, key=lambda model: model.misfit)


def other_input(fit: ArmFit, misfit: float, runs: Sequence[Run], rig: Rig) -> str:
    """Sentence with the options that correct an input that acts otherwise than held from row to row; else empty.

    Args:
        fit: fit with the input as the runs state it
        misfit: its reduced chi-square at the noise of the readings
        runs: the fitted runs
        rig: their rig
    """
    driven = [run for run in runs if run.arm_mode == "driven"]
    if not driven or misfit < INPUT_ROWS.doubted:
        return ""
    interval = float(np.median(np.concatenate([np.diff(run.t) for run in driven])))
    try:
        held, best = _tried(_Tested(fit, runs, rig), interval, all(run.continuous for run in driven))
    except IdentificationError:
        return ""
    if best is held or best.misfit * INPUT_ROWS.better > held.misfit:
        return ""
    of_drive = best.delay_s > INPUT_ROWS.least * interval
    if of_drive and best.misfit - 1.0 > (1.0 - INPUT_ROWS.explained) * (held.misfit - 1.0):
        return ""
    delay = float(np.mean([run.input_delay_s for run in driven])) + best.delay_s
    return _sentence(best, delay, interval, misfit, misfit * best.misfit / held.misfit)


def _tried(tested: _Tested, interval: float, continuous: bool) -> tuple[_InputModel, _InputModel]:
    """The input as stated, and the best of the others: held with a delay, or continuous with or without one."""
    stated = tested.model(0.0, continuous)
    step = max(interval / 2, INPUT_ROWS.step_s)
    best = tested.near(stated, step)
    if best is stated:
        return stated, stated
    best = tested.near(best, step)
    if continuous:
        return stated, best
    # A held value acts on average half a row after its instant.
    delay = best.delay_s + interval / 2
    smooth = tested.model(0.0 if abs(delay) < INPUT_ROWS.least * interval else delay, True)
    return stated, min(best, smooth, key=lambda model: model.misfit)


def _sentence(model: _InputModel, delay_s: float, interval: float, before: float, after: float) -> str:
    options = ["--intersample continuous"] if model.continuous else []
    if abs(model.delay_s) > INPUT_ROWS.least * interval:
        options.append(f"--input-delay-s {delay_s:.3g}")
    if model.continuous:
        cause = "the input of the arm changes between its rows, as a continuous signal"
    elif model.delay_s < 0:
        cause = f"the input of the arm acts before its rows, {-model.delay_s / interval:.2g} of a row"
    else:
        cause = "the input of the arm acts after its rows"
    if model.delay_s > INPUT_ROWS.least * interval:
        cause += f", with a delay of {1e3 * model.delay_s:.3g} ms" if model.continuous else f" by {1e3 * model.delay_s:.3g} ms"
    return (
        f"{cause}: with this input the reduced chi-square falls from {before:.3g} to {after:.3g}. Import the table with"
        f" {' '.join(options)}, or record the input at the rate of the controller"
    )

"""Test whether the input of a driven arm is delayed, or continuous between its rows.

A row contains the value at one instant; how long this value acts is not recorded (docs/decisions/0025). The fit holds
each value until the next row. The test repeats the fit with other delays, and with rows interpreted as samples of a
continuous signal. Chi-square is a parabola in the delay, because the readings change in proportion to the delay.
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
    """Settings of the test of the interpolation and the delay of the input."""

    doubted: float = 1.1
    """Reduced chi-square above which the input is tested."""
    better: float = 1.3
    """Minimum factor by which the reduced chi-square must decrease, as for an additional effect of a diagnosis."""
    least: float = 0.1
    """Smallest delay that is reported, relative to the interval between rows."""
    explained: float = 0.8
    """Minimum share of the excess chi-square that a delay of the input after its rows must explain.

    Such a delay is an effect of the drive, which other effects can resemble.
    """
    alike: float = 1.1
    """Minimum factor by which the reduced chi-square must decrease for a more complex description of the input.

    An input with a delay is more complex than an input without a delay. A delayed continuous input is more complex than
    a delayed held input.
    """
    step_s: float = 0.004
    """Minimum increment of the tested delays, s."""
    most_steps: float = 8.0
    """Maximum distance of a delay from the tested delays, in steps. The parabola is not valid farther away."""


INPUT_ROWS = InputRows()


@dataclass(frozen=True, slots=True)
class _InputModel:
    """Interpolation and delay of the input, and the misfit with this input."""

    delay_s: float
    """Delay between a row of the input and its effect, s."""
    continuous: bool
    """Whether the rows are samples of a continuous signal."""
    misfit: float
    """Reduced chi-square of the fit."""


@dataclass(frozen=True, slots=True)
class _Tested:
    """A fit that is repeated with other interpolations and delays of the input of its runs."""

    fit: ArmFit
    runs: Sequence[Run]
    rig: Rig

    def model(self, delay_s: float, continuous: bool) -> _InputModel:
        """Repeat the fit with a delayed input that is held or continuous.

        Raises:
            IdentificationError: the segments cannot be fitted with this input.
        """
        runs = [replace(run, input_delay_s=delay_s, continuous=continuous) for run in self.runs]
        problem = problem_of(recordings_of(runs, self.rig), self.rig, self.fit.problem.cuts, self.fit.problem.max_step)
        fit = fit_segments(problem, self.fit.estimate)
        return _InputModel(delay_s, continuous, fit.chi2_per_dof)

    def near(self, centre: _InputModel, step_s: float) -> _InputModel:
        """Refine the delay by the minimum of a parabola.

        The parabola passes through the reduced chi-squares at the delay of `centre` and at the delays one step earlier
        and later.
        """
        before, after = (self.model(centre.delay_s + sign * step_s, centre.continuous).misfit for sign in (-1, 1))
        curvature = before - 2 * centre.misfit + after
        if curvature <= 0:
            return centre
        steps = float(np.clip((before - after) / (2 * curvature), -INPUT_ROWS.most_steps, INPUT_ROWS.most_steps))
        best = self.model(centre.delay_s + steps * step_s, centre.continuous)
        return min(centre, best, key=lambda model: model.misfit)


def other_input(fit: ArmFit, runs: Sequence[Run], rig: Rig) -> str:
    """Return a message with import options that describe the input better.

    The text is empty if no other options describe it better.

    Args:
        fit: fit with the input as the runs state it
        runs: the fitted runs
        rig: rig of the runs
    """
    driven = [run for run in runs if run.arm_mode == "driven"]
    if not driven or fit.misfit < INPUT_ROWS.doubted:
        return ""
    interval = float(np.median(np.concatenate([np.diff(run.t) for run in driven])))
    try:
        stated, best = _tried(_Tested(fit, runs, rig), driven[0], interval)
    except IdentificationError:
        return ""
    if best.misfit * INPUT_ROWS.better > stated.misfit:
        return ""
    if best.delay_s > 0 and best.misfit - 1.0 > (1.0 - INPUT_ROWS.explained) * (stated.misfit - 1.0):
        return ""
    options = [f"--input-delay-s {best.delay_s:.3g}"] if best.delay_s else []
    if best.continuous or stated.continuous:
        options.insert(0, f"--intersample {'continuous' if best.continuous else 'held'}")
    after, option = fit.misfit * best.misfit / stated.misfit, " ".join(options) or "no input delay"
    return (
        f"{_cause(best, interval)}: with this input the reduced chi-square falls from {fit.misfit:.3g} to {after:.3g}."
        f" Import a table with {option}, or record the input at the rate of the controller"
    )


def _tried(tested: _Tested, run: Run, interval: float) -> tuple[_InputModel, _InputModel]:
    """Return the input as described, and the best alternative.

    Alternatives are held or continuous inputs, with or without a delay.
    """
    stated = tested.model(run.input_delay_s, run.continuous)
    step = max(interval / 2, INPUT_ROWS.step_s)
    best = tested.near(stated, step)
    if best is stated:
        return stated, stated
    best = tested.near(best, step)
    # A held value acts on average half a row after its instant.
    other = best.delay_s + (-0.5 if best.continuous else 0.5) * interval
    negligible = INPUT_ROWS.least * interval
    if abs(best.delay_s) < negligible:
        best = tested.model(0.0, best.continuous)
    return stated, min(
        best, tested.model(0.0 if abs(other) < negligible else other, not best.continuous), key=_preference
    )


def _preference(model: _InputModel) -> float:
    """Return the reduced chi-square of an input model times a complexity penalty.

    A delay is penalised, and a continuous signal with a delay is penalised twice.
    """
    return model.misfit * INPUT_ROWS.alike ** ((1 + model.continuous) if model.delay_s else 0)


def _cause(model: _InputModel, interval: float) -> str:
    """Describe the interpolation and the delay of the input."""
    late = f"{1e3 * model.delay_s:.3g} ms after its rows" if model.delay_s > 0 else ""
    if model.continuous:
        return f"the input of the arm changes between its rows, as a continuous signal{late and f', and acts {late}'}"
    if model.delay_s < 0:
        return f"the input of the arm acts {-model.delay_s / interval:.2g} of a row interval before its rows"
    return f"the input of the arm acts {late}" if late else "the input of the arm is held from row to row"

"""Test whether the input of a driven arm acts before its rows, as samples of a continuous signal do.

A row shows the value of its instant; how long it acted before is not recorded (docs/decisions/0025). The fit holds each
value until the next row. It is repeated with values that begin before their rows by a half of the interval and by all
of it. Chi-square is a parabola of this share, because the readings change in proportion to it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

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
    """Smallest share that is reported."""


INPUT_ROWS = InputRows()


def early_input(fit: ArmFit, misfit: float, runs: Sequence[Run], rig: Rig) -> str:
    """Sentence with the delay that corrects an input that acts before its rows; empty without one.

    Args:
        fit: fit with the input held from row to row
        misfit: its reduced chi-square at the noise of the readings
        runs: the fitted runs
        rig: their rig
    """
    driven = [run for run in runs if run.arm_mode == "driven"]
    if not driven or misfit < INPUT_ROWS.doubted:
        return ""
    try:
        half, whole = (_misfit(fit, runs, rig, share) for share in (0.5, 1.0))
    except IdentificationError:
        return ""
    held = _misfit(fit, runs, rig, 0.0)
    curvature, slope = 2 * (held - 2 * half + whole), 4 * half - 3 * held - whole
    share = float(np.clip(-slope / (2 * curvature), 0.0, 1.0)) if curvature > 0 else float(half < held)
    if share < INPUT_ROWS.least:
        return ""
    best = _misfit(fit, runs, rig, share)
    if best * INPUT_ROWS.better > held:
        return ""
    interval = float(np.median(np.concatenate([np.diff(run.t) for run in driven])))
    return (
        f"the input of the arm acts before its rows: if every value begins {share:.2g} of a row earlier, the reduced"
        f" chi-square falls from {misfit:.3g} to {misfit * best / held:.3g}. Import the table with --input-delay-s"
        f" {-share * interval:.3g}, or record the input at the rate of the controller"
    )


def _misfit(fit: ArmFit, runs: Sequence[Run], rig: Rig, share: float) -> float:
    """Reduced chi-square of the same segments with an input that begins earlier by a share of a row."""
    recordings = recordings_of(runs, rig, share)
    problem = problem_of(recordings, rig, fit.problem.cuts, fit.problem.max_step)
    return fit_segments(problem, fit.p, fit.initial).chi2_per_dof

"""Create the tables of an identification and a comparison with a moving arm."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import plus_minus
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.run_names import run_label
from dpr_lab.report.tables import role
from dpr_lab.shown import counted

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import ArmComparison
    from dpr_lab.identification.moving_arm.model import MovingArmModel


UNITS = dict.fromkeys("abdA", "kg m²") | dict.fromkeys(("c0", "c1", "c2"), "N m s/rad")
UNITS |= {"e1": "N m", "k0": "N m/rad", "f0": "N m", "kt gear/R": "N m/V", "kt gear": "N m/A"}

SEGMENT_NOTE = (
    "Residuals increase with the length of the segments. `identify` prints the residuals of its own segments, which may"
    " be shorter."
)


def summary(model: "MovingArmModel", angles: AngleUnit = RADIANS) -> str:
    """Describe the residuals and the segments."""
    scale = angles.small_per_rad
    rms = ", ".join(
        f"{name} {scale * value:.3g} {angles.small} (noise {scale * model.fit.noise_rad[name]:.2g})"
        for name, value in model.fit.rms_rad.items()
    )
    runs, segments = counted(len(model.runs), "run"), counted(model.fit.segments, "segment")
    return (
        f"{runs}, {segments} of {model.fit.segment_s:g} s; residual: {rms}; reduced chi-square"
        f" {model.fit.chi2_per_dof:.3g}"
    )


@page_table("parameter", "value", "unit", "determined by")
def absolute_table(model: "MovingArmModel") -> Rows:
    """Return one row for each absolute value."""
    fixed = {"data": "the recordings and measured values", "bound": "the scale of the rig file"}
    return [
        [name, plus_minus(estimate.value, estimate.std), UNITS.get(name, ""), fixed[estimate.fixed_by]]
        for name, estimate in model.absolute.items()
    ]


@page_table("run", "role", "joint", "segment (s)", "residual (mrad rms)", "noise (mrad)", caption=SEGMENT_NOTE)
def comparison_table(compared: Mapping[str, Any]) -> Rows:
    """Return one row per run and joint of the output of `dpr-lab compare --json`."""
    return [
        [
            run_label(run["run"]),
            role(run["held_out"], run["truncated"]),
            joint,
            f"{run['segment_s']:.3g}",
            f"{1e3 * rms:.3g}",
            f"{1e3 * run['noise_rad'][joint]:.2g}",
        ]
        for run in compared["runs"]
        for joint, rms in run["rms_rad"].items()
    ]


def angles_csv(compared: "Sequence[ArmComparison]") -> str:
    """Return the measured and simulated angles as CSV text.

    Joints without an encoder have the value nan. Instants at which no joint was simulated are omitted.
    """
    rows = [
        ",".join([comparison.run, *(f"{value:.9g}" for value in (t, *measured, *simulated))])
        for comparison in compared
        for t, measured, simulated in zip(comparison.t, comparison.measured, comparison.simulated, strict=True)
        if np.isfinite(simulated).any()
    ]
    names = [f"{kind}_joint{joint}_rad" for kind in ("measured", "simulated") for joint in range(3)]
    return "\n".join([",".join(["run", "t_s", *names]), *rows]) + "\n"

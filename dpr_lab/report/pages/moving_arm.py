"""Page of a comparison with a model whose arm moves: ratios, and angles of arm and rods with their residuals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.identification.moving_arm.identify import JOINTS_READ, ArmComparison
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.report import moving_arm, style
from dpr_lab.report.envelope import trace
from dpr_lab.report.figures import NOISE_SIGMAS, legend_above, new_figure, save_each
from dpr_lab.report.pages.page import Items, PageTable, Section, page_html, pictures, write_page

FIGURES = {
    "response": (
        "Line charts of the angles of arm and rods over time, measured and simulated, for each run.",
        "Angles as their encoders read them: theta0 of the arm, theta1 with 0 = upright. The initial state of each"
        " segment is fitted.",
    ),
    "error": (
        "Line charts of measured minus simulated angle over time with the noise floor, for each run.",
        "Residuals inside the band and without a pattern are noise; a pattern shows an effect that the model lacks.",
    ),
}
"""Name of a figure -> text alternative and caption."""


def write_arm_report(
    model: MovingArmModel, runs: Sequence[ArmComparison], compared: Mapping[str, Any], out_dir: Path
) -> Path:
    """Write `report.html` with its figures and return its path.

    Args:
        model: the model
        runs: runs simulated with it
        compared: errors of these runs, as JSON values
        out_dir: folder of the report

    Raises:
        DprError: the folder or a file cannot be written.
    """
    drawn = pictures(save_each({"response": _responses(runs), "error": _residuals(runs)}, out_dir), FIGURES)
    scale = f"{model.scale_sentence} A is the total inertia about the arm's axis."
    sections = [
        Section("Warnings", [Items([*model.failures, *model.warnings])], "warnings", is_open=True),
        Section(
            "Measured and simulated angles",
            [
                PageTable(moving_arm.COMPARISON_COLUMNS, moving_arm.comparison_rows(compared)),
                drawn["response"],
                drawn["error"],
            ],
            is_open=True,
        ),
        Section(
            f"Ratios to {model.scale}",
            [
                PageTable(moving_arm.RATIO_COLUMNS, moving_arm.ratio_rows(model)),
                Items([f"{name}: {reason}" for name, reason in model.undetermined.items()]),
            ],
            is_open=True,
        ),
        Section("Absolute values", [PageTable(moving_arm.ABSOLUTE_COLUMNS, moving_arm.absolute_rows(model), scale)]),
        Section("Notes", [Items(model.notes)]),
    ]
    footer = f"Rig {model.rig.name}, file SHA-256 {model.rig.sha256 or 'unknown'}. Written by dpr-lab {model.version}."
    title = f"Rig “{model.rig.name}” with a moving arm: identified model"
    return write_page(page_html(title, moving_arm.summary(model), sections, footer=footer), out_dir / "report.html")


def _panels(runs: Sequence[ArmComparison]) -> tuple[Figure, list[tuple[Any, ArmComparison, int]]]:
    """A figure with one panel for each run and read joint."""
    rows = [(run, joint) for run in runs for joint, name in enumerate(JOINTS_READ) if name in run.rms_rad]
    figure = new_figure(0.6 + 1.5 * len(rows))
    panels = figure.subplots(len(rows), squeeze=False)[:, 0]
    rows_of_axes = [(axes, run, joint) for axes, (run, joint) in zip(panels, rows, strict=True)]
    for axes, run, joint in rows_of_axes:
        if joint == 0 or JOINTS_READ[0] not in run.rms_rad:
            axes.set_title(run.run, parse_math=False)
        axes.set_xlim(float(run.t[0]), float(run.t[-1]))
    panels[-1].set_xlabel("time since the release (s)")
    return figure, rows_of_axes


def _responses(runs: Sequence[ArmComparison]) -> Figure:
    with style.house_style():
        figure, panels = _panels(runs)
        for axes, run, joint in panels:
            axes.plot(*trace(run.t, run.measured[:, joint]), label="measured", **style.MEASURED)
            axes.plot(*trace(run.t, run.simulated[:, joint]), label="simulated", **style.SIMULATED)
            axes.set_ylabel(f"{JOINTS_READ[joint]} (rad)")
        legend_above(figure)
        return figure


def _residuals(runs: Sequence[ArmComparison]) -> Figure:
    with style.house_style():
        figure, panels = _panels(runs)
        for axes, run, joint in panels:
            band = NOISE_SIGMAS * 1e3 * run.noise_rad[JOINTS_READ[joint]]
            residual = 1e3 * (run.measured[:, joint] - run.simulated[:, joint])
            largest = 1.1 * max(1.2 * band, float(np.nanmax(np.abs(residual))))
            axes.axhspan(-band, band, label=f"noise floor, ±{NOISE_SIGMAS}σ", **style.NOISE_BAND)
            axes.plot(*trace(run.t, residual), label="measured − simulated", **style.RESIDUAL)
            axes.set_ylim(-largest, largest)
            axes.set_ylabel(f"{JOINTS_READ[joint]} (mrad)")
        legend_above(figure)
        return figure

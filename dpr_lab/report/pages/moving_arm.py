"""Write the page that compares a moving-arm model with runs: ratios, angles and residuals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dpr_lab.identification.moving_arm.identify import ArmComparison
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.report import moving_arm, tables
from dpr_lab.report.figures import error_figure, response_figure, save_each
from dpr_lab.report.pages.page import Items, Section, page_html, pictures, write_page

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
"""Text alternative and caption of each figure."""


def write_arm_report(
    model: MovingArmModel, runs: Sequence[ArmComparison], compared: Mapping[str, Any], out_dir: Path
) -> Path:
    """Write `report.html` with its figures, and return the path of the file.

    Args:
        model: the model
        runs: runs that are simulated with the model
        compared: errors of these runs, as JSON values
        out_dir: folder of the report

    Raises:
        DprError: the folder or a file cannot be written.
    """
    drawn = pictures(save_each({"response": response_figure(runs), "error": error_figure(runs)}, out_dir), FIGURES)
    scale = f"{model.scale_sentence} A is the total inertia about the arm's axis."
    sections = [
        Section("Warnings", [Items([*model.failures, *model.warnings])], "warnings", is_open=True),
        Section(
            "Measured and simulated angles",
            [moving_arm.comparison_table(compared), drawn["response"], drawn["error"]],
            is_open=True,
        ),
        Section(
            f"Ratios to {model.scale}",
            [
                tables.ratio_table(model),
                Items([f"{name}: {reason}" for name, reason in model.undetermined.items()]),
            ],
            is_open=True,
        ),
        Section("Absolute values", [replace(moving_arm.absolute_table(model), caption=scale)]),
        Section("Notes", [Items(model.notes)]),
    ]
    footer = f"Rig {model.rig.name}, file SHA-256 {model.rig.sha256 or 'unknown'}. Written by dpr-lab {model.version}."
    title = f"Rig “{model.rig.name}” with a moving arm: identified model"
    return write_page(page_html(title, moving_arm.summary(model), sections, footer=footer), out_dir / "report.html")

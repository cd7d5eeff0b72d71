"""Results for a rig with a moving arm: tables of Identify, charts of Compare."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group
from rich.text import Text

from dpr_lab.report import moving_arm, tables
from dpr_lab.report.angles import AngleUnit
from dpr_lab.report.digits import pair, superscripts
from dpr_lab.tui.steps.compare_charts import SETTINGS
from dpr_lab.tui.texts import report_table, sentences
from dpr_lab.tui.widgets.chart import Band, Chart, Series

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import ArmComparison
    from dpr_lab.identification.moving_arm.model import MovingArmModel

JOINT_NAMES = ("arm θ0", "rod θ1", "rod θ2")
KEYS = ("joint 0", "joint 1", "joint 2")
"""Names of joints 0, 1 and 2 in a comparison."""
VIEWS = ("angle", "segment residual")


def start_of_diagnosis(model: Path | None) -> Path | None:
    """Return the initial model of a diagnosis, or None for the rig file.

    The diagnosis of a rig with a moving arm starts from the rig file.

    Raises:
        RunError: the file is missing, not JSON, or not a model.
    """
    from dpr_lab.identification.moving_arm.model import MovingArmModel, load_model

    return None if model is None or isinstance(load_model(model), MovingArmModel) else model


def ratios(model: "MovingArmModel") -> Group:
    """Draw a table of the ratios that the recordings determine, followed by warnings."""
    inertia = "the inertia a of the inner rod" if model.scale == "a" else "the inertia b of the outer rod"
    rows = report_table(f"Ratios to {inertia}", tables.ratio_table(model))
    return Group(rows, sentences("Warnings", [*model.failures, *model.warnings], mark="!"))


def absolute(model: "MovingArmModel") -> Group:
    """Draw a table of the absolute values, and state the source of their scale."""
    rows = report_table("Absolute values", moving_arm.absolute_table(model))
    note = f"{model.scale_sentence} A is the total inertia about the arm's axis."
    return Group(rows, Text(note, "dim"))


def identifiability(model: "MovingArmModel") -> Group:
    """Draw sentences on the values that the recordings cannot determine or cannot separate."""
    undetermined = [f"{name}: {reason}" for name, reason in model.undetermined.items()]
    notes = [superscripts(note) for note in model.notes]
    known = "" if undetermined or model.notes else "The recordings determine all values of this rig."
    return Group(
        sentences("Not determined by the recordings:", undetermined),
        sentences("Notes:", notes),
        known,
    )


def draw_merges(model: "MovingArmModel", misfit: Chart, length: Chart) -> None:
    """Draw the misfit and the segment length after each merge of segments.

    The segments are short at first, and are merged as long as the model can fit the merged segments.
    """
    lengths, misfits = np.array(model.fit.merges, dtype=np.float64).reshape(-1, 2).T
    merge = np.arange(len(lengths), dtype=np.float64)
    misfit.show([Series("fit", merge, misfits)], x_label="merge of segments", y_label="reduced chi-square")
    length.show(
        [Series("segments", merge, lengths, "secondary")], x_label="merge of segments", y_label="median length (s)"
    )


@dataclass(frozen=True, slots=True)
class ComparedArmRun:
    """Charts of one run: measured and simulated angle of one joint, by segment."""

    comparison: "ArmComparison"
    joint: int
    unit: AngleUnit

    def draw_angle(self, chart: Chart) -> None:
        """Draw the measured and the simulated angle."""
        shown, scale = self.comparison, self.unit.per_rad
        lines = [
            Series("measured", shown.t, scale * shown.measured[:, self.joint], on_top=True),
            Series("simulated", shown.t, scale * shown.simulated[:, self.joint], "secondary"),
        ]
        chart.show(lines, x_label="time (s)", y_label=f"{JOINT_NAMES[self.joint]} ({self.unit.symbol.strip()})")

    def draw_error(self, chart: Chart) -> None:
        """Draw the residual by segment, with the noise band."""
        shown, scale = self.comparison, self.unit.small_per_rad
        residual = scale * (shown.measured - shown.simulated)[:, self.joint]
        noise = SETTINGS.noise_sigmas * scale * shown.noise_rad[KEYS[self.joint]]
        chart.show(
            [Series("residual", shown.t, residual)],
            x_label="time (s)",
            y_label=f"{JOINT_NAMES[self.joint]} ({self.unit.small})",
            band=Band(-noise, noise, f"noise ±{SETTINGS.noise_sigmas}σ"),
        )

    def figures(self, news: str) -> str:
        """Return the residuals of all joints in one line, followed by `news`."""
        shown, scale = self.comparison, self.unit.small_per_rad
        sizes = [
            f"{JOINT_NAMES[joint][-2:]} {pair(scale * np.array([shown.rms_rad[name], shown.noise_rad[name]]))}"
            for joint, name in enumerate(KEYS)
            if name in shown.rms_rad
        ]
        role = "held out" if shown.held_out else "fitted"
        text = f"{role}, segments of {shown.segment_s:g} s, rms residual, noise ({self.unit.small}): {'; '.join(sizes)}"
        return f"{text}  {news}" if news else text


def joints_of(comparison: "ArmComparison") -> list[int]:
    """Return the joints of a comparison that have readings."""
    return [joint for joint, name in enumerate(KEYS) if name in comparison.rms_rad]

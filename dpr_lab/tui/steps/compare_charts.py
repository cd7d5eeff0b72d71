"""Charts of one comparison in the step Compare: angle, error and figures.

A second curve can be added.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.report.angles import AngleUnit
from dpr_lab.tui.widgets.chart import Band, Chart, Mark, Series

if TYPE_CHECKING:
    from dpr_lab.identification.compare import Comparison

AXES = ("inner rod θ1", "outer rod θ2")
VIEWS = ("angle", "free-run error", "segment residual")


@dataclass(frozen=True, slots=True)
class CompareSettings:
    """Settings of the comparison charts."""

    noise_sigmas: int = 2
    """Half width of the noise band, in standard deviations. The band contains 95 % of pure noise."""
    tall: int = 36
    """Minimum height of the step, in rows, for showing angle and error below each other."""


SETTINGS = CompareSettings()


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """Content of the charts: one joint of one or two comparisons."""

    comparison: "Comparison"
    second: "Comparison | None"
    axis: int
    """0: inner rod, 1: outer rod."""
    unit: AngleUnit
    freely: bool
    """Whether the error of the free run is drawn instead of that of the segments."""

    @property
    def horizon(self) -> list[Mark]:
        """Mark at the predictability horizon, if it is before the end."""
        horizon_s = self.comparison.horizon_s
        within = horizon_s < float(self.comparison.t[-1])
        return [Mark(horizon_s, f"horizon {horizon_s:.2f} s")] if within else []

    def draw_angle(self, chart: Chart) -> None:
        """Draw the measured and the simulated angle."""
        scale, axis, shown = self.unit.per_rad, self.axis, self.comparison
        measured = Series("measured", shown.t, scale * shown.measured[:, axis], on_top=True)
        simulated = Series("free run", shown.t, scale * shown.free_run[:, axis], "secondary")
        lines = [measured, simulated]
        if (second := self.second) is not None:
            theta = second.free_run if second.run == shown.run else second.measured
            lines.append(Series(self._second_name(second), second.t, scale * theta[:, axis], "accent"))
        chart.show(
            lines,
            x_label="time (s)",
            y_label=f"{AXES[axis]} ({self.unit.symbol.strip()})",
            marks=self.horizon,
            y_range=_range_of(measured.y),
        )

    def draw_error(self, chart: Chart) -> None:
        """Draw the error of the segments, or that of the free run up to its horizon."""
        scale, axis, shown = self.unit.small_per_rad, self.axis, self.comparison
        noise = SETTINGS.noise_sigmas * scale * float(shown.noise_rad[axis])
        t, error = shown.t, shown.segment_residual[:, axis]
        if self.freely:
            near = t <= shown.horizon_s
            t, error = t[near], shown.free_run_error[near, axis]
        lines = [Series("residual", t, scale * error)]
        if (second := self.second) is not None:
            near = second.t <= (second.horizon_s if self.freely else second.t[-1])
            error = (second.free_run_error if self.freely else second.segment_residual)[near, axis]
            lines.append(Series(self._second_name(second), second.t[near], scale * error, "accent"))
        chart.show(
            lines,
            x_label="time (s)",
            y_label=f"{AXES[axis]} ({self.unit.small})",
            marks=self.horizon if self.freely else [],
            band=Band(-noise, noise, f"noise ±{SETTINGS.noise_sigmas}σ"),
            x_range=(float(shown.t[0]), float(shown.t[-1])),
        )

    def figures(self, news: str) -> str:
        """Return the figures of the comparison and `news`, then those of a second comparison."""
        second = "" if self.second is None else f"\nsecond: {_figures(self.second, self.unit)}"
        return _figures(self.comparison, self.unit) + (f"  {news}" if news else "") + second

    def _second_name(self, second: "Comparison") -> str:
        return "2nd model" if second.run == self.comparison.run else "other run"


def _figures(comparison: "Comparison", unit: AngleUnit) -> str:
    """Return one sentence with the residuals and free-run errors of both rods.

    `dpr-lab compare` tabulates the same figures.
    """
    from dpr_lab.report.tables import comparison_table, to_the_end

    result = comparison_table([comparison], unit)
    row = dict(zip(result.columns, result.rows[0], strict=True))
    until = "to the end of the record" if to_the_end(comparison) else f"up to {row['horizon (s)']} s"
    return (
        f"{row['role']}, {row['segments']} segments, θ1, θ2: rms residual {row['rms (mrad)']} {unit.small}"
        f" ({row['rms / noise']} times the noise); free-run error from the release"
        f" {row['free run (mrad)']} {unit.small} {until}"
    )


def _range_of(angle: Array) -> tuple[float, float]:
    """Return the range of the chart that a measured angle needs.

    The free run does not change the range. If it diverges, its curve leaves the chart.
    """
    low, high = float(np.nanmin(angle)), float(np.nanmax(angle))
    room = max(0.06 * (high - low), 0.01)
    return low - room, high + room

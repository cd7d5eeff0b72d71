"""What the corrected model may be used for: the speeds, angles and days on which it was fitted and tested."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Occupancy, RecordingUsed
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import empty_figure, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, FoldedTable, evidence_of

COLOURS = "cividis_r"
"""Made for colour-blind readers; Nuñez, Anderton & Renslow (2018), PLOS ONE 13(7)."""


def domain_figure(diagnosis: Diagnosis) -> Figure:
    """Seconds at each angle and speed, by rod; what was held out is outlined."""
    maps = evidence_of(diagnosis).coverage
    with style.house_style():
        if not maps:
            return empty_figure("no rod swung freely")
        figure = new_figure(3.4)
        panels = figure.subplots(1, len(maps), squeeze=False)[0]
        most = max(float(np.max(item.fitted_s)) for item in maps.values())
        colours = LogNorm(max(most / 300, 1e-4), max(most, 2e-4))
        for axes, (rod, item) in zip(panels, maps.items(), strict=True):
            _draw_map(axes, rod, item, colours)
        scale = ScalarMappable(colours, COLOURS)
        figure.colorbar(scale, ax=panels.tolist(), label="time in the cell (s)")
        return figure


def _draw_map(axes: Axes, rod: str, item: Occupancy, colours: LogNorm) -> None:
    angle, speed = np.array(item.angle_edges_rad), np.array(item.speed_edges_rad_per_s)
    fitted, unseen = np.array(item.fitted_s), np.array(item.held_out_s)
    axes.pcolormesh(angle, speed, np.ma.masked_less_equal(fitted, 0).T, norm=colours, cmap=COLOURS)
    if unseen.any():
        fine = np.kron(unseen > 0, np.ones((PAGE.sharp, PAGE.sharp)))
        along = (np.linspace(edges[0], edges[-1], n) for edges, n in zip((angle, speed), fine.shape, strict=True))
        axes.contour(*along, fine.T, levels=[0.5], colors=[style.SIMULATED["color"]], linewidths=1.2)
    axes.grid(visible=False)
    axes.set_xticks(np.pi * np.arange(5) / 2, ["0", "π/2", "π", "3π/2", "2π"])
    axes.set(title=f"{rod} rod", xlabel="angle (rad, 0 = upright, π = hanging)", ylabel="speed (rad/s)")


def domain_words(diagnosis: Diagnosis) -> list[str]:
    """Intended use, and what was not seen."""
    told = evidence_of(diagnosis)
    fitted, unseen = ([item for item in told.recordings if item.held_out is held] for held in (False, True))
    until = min((run.until_s for run in told.budget.runs), default=0.0)
    fastest = " and ".join(
        f"{three(item.speed_edges_rad_per_s[-1])} rad/s ({rod})" for rod, item in told.coverage.items()
    )
    swings = "swings that known torques drive" if any(item.driven for item in told.recordings) else "free swings"
    days = sorted({item.recorded_utc[:10] for item in told.recordings if item.recorded_utc})
    return [
        f"The corrected model is made to foretell {swings} of rig “{told.rig}”, angle by angle, for {until:.2g} s"
        f" from a"
        f" start that 0.3 s of readings fix; and to stand for the rig in a simulator at the angles and speeds of the"
        f" map:"
        f" up to {fastest}.",
        f"It was fitted to {_of(fitted)}"
        + (f" and tested on {_of(unseen)} that took no part." if unseen else "; none was held out by hand."),
        _days(days, len(told.recordings)),
        "Blank cells were not seen: there the model is an extrapolation, and this report says nothing of it. Nor does"
        " it"
        " speak of other loads, other bearings, other temperatures, or of joints that are driven in another way.",
    ]


def _of(recordings: Sequence[RecordingUsed]) -> str:
    seconds = sum(item.duration_s for item in recordings)
    return f"{len(recordings)} recording{'s' if len(recordings) != 1 else ''} ({seconds:.0f} s)"


def _days(days: list[str], count: int) -> str:
    if not days:
        return (
            "The recordings do not say when they were made, so nothing is known of how the rig changes from day to day."
        )
    if len(days) == 1:
        return f"All that is dated was recorded on {days[0]}: nothing shows how the model holds on another day."
    return f"Recorded on {len(days)} days, from {days[0]} to {days[-1]} ({count} recordings)."


def domain_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Speeds seen, by range of angles."""
    rows = []
    for rod, item in evidence_of(diagnosis).coverage.items():
        edges, speeds = item.angle_edges_rad, item.speed_edges_rad_per_s
        fitted, unseen = np.array(item.fitted_s), np.array(item.held_out_s)
        for i in range(0, len(fitted), PAGE.rows_of):
            own, other = fitted[i : i + PAGE.rows_of].sum(axis=0), unseen[i : i + PAGE.rows_of].sum(axis=0)
            seen = np.flatnonzero(own)
            reach = f"{three(speeds[seen[0]])} to {three(speeds[seen[-1] + 1])}" if len(seen) else NONE
            angles = f"{edges[i]:.2f} to {edges[i + PAGE.rows_of]:.2f}"
            rows.append((rod, angles, reach, *(three(float(some.sum())) for some in (own, other))))
    return rows


COLUMNS = ("rod", "angle (rad)", "speeds seen (rad/s)", "fitted (s)", "held out (s)")

DOMAIN = EvidenceSection(
    name="domain",
    title="What it may be used for",
    words=domain_words,
    figure=domain_figure,
    alternative="Maps of the time that each rod spent at each angle and speed.",
    caption="Time that each rod spent at each angle and speed in the fitted recordings, cells of 15 degrees, by"
    " the scale beside it. The outline holds what was held out. Blank: not seen.",
    tables=(
        FoldedTable(
            "The map in numbers",
            ("rod", "angle (rad)", "speeds seen (rad/s)", "fitted (s)", "held out (s)"),
            domain_rows,
        ),
    ),
)

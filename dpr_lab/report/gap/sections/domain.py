"""Show the domain of validity: angles, speeds and days of the fitted and validation data."""

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
from dpr_lab.report.figures import new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, evidence_of
from dpr_lab.report.pages.page import Rows, page_table

COLOURS = "cividis_r"
"""Colour map for colour-blind readers; Nuñez, Anderton & Renslow (2018), PLOS ONE 13(7)."""


def domain_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw the time that each rod spent at each angle and speed, and outline the cells of held-out runs.

    The result is None if no rod swung freely.
    """
    maps = evidence_of(diagnosis).coverage
    if not maps:
        return None
    figure = new_figure(3.4)
    panels = figure.subplots(1, len(maps), squeeze=False)[0]
    most = max(float(np.max(occupancy.fitted_s)) for occupancy in maps.values())
    colours = LogNorm(max(most / 300, 1e-4), max(most, 2e-4))
    for axes, (rod, occupancy) in zip(panels, maps.items(), strict=True):
        _draw_map(axes, rod, occupancy, colours)
    scale = ScalarMappable(colours, COLOURS)
    figure.colorbar(scale, ax=panels.tolist(), label="time in the cell (s)")
    return figure


def _draw_map(axes: Axes, rod: str, occupancy: Occupancy, colours: LogNorm) -> None:
    angle, speed = np.array(occupancy.angle_edges_rad), np.array(occupancy.speed_edges_rad_per_s)
    fitted, held_out = np.array(occupancy.fitted_s), np.array(occupancy.held_out_s)
    axes.pcolormesh(angle, speed, np.ma.masked_less_equal(fitted, 0).T, norm=colours, cmap=COLOURS)
    if held_out.any():
        fine = np.kron(held_out > 0, np.ones((PAGE.sharp, PAGE.sharp)))
        coordinates = (np.linspace(edges[0], edges[-1], n) for edges, n in zip((angle, speed), fine.shape, strict=True))
        axes.contour(*coordinates, fine.T, levels=[0.5], colors=[style.SIMULATED["color"]], linewidths=1.2)
    axes.grid(visible=False)
    axes.set_xticks(np.pi * np.arange(5) / 2, ["0", "π/2", "π", "3π/2", "2π"])
    axes.set(title=f"{rod} rod", xlabel="angle (rad, 0 = upright, π = hanging)", ylabel="speed (rad/s)")


def domain_words(diagnosis: Diagnosis) -> list[str]:
    """Describe for which motions the corrected model is valid."""
    evidence = evidence_of(diagnosis)
    if not evidence.coverage:
        return ["No rod swung freely, so no range of angles and speeds can be stated."]
    fitted, held_out = ([r for r in evidence.recordings if r.held_out is wanted] for wanted in (False, True))
    until = min((run.until_s for run in evidence.budget.runs), default=0.0)
    speeds = " and ".join(
        f"{three(occupancy.speed_edges_rad_per_s[-1])} rad/s ({rod} rod)"
        for rod, occupancy in evidence.coverage.items()
    )
    driven = any(recording.driven for recording in evidence.recordings)
    swings = "swings driven by known torques" if driven else "free swings"
    days = sorted({recording.recorded_utc[:10] for recording in evidence.recordings if recording.recorded_utc})
    return [
        f"The corrected model predicts {swings} of rig “{evidence.rig}” for {until:.2g} s from an initial"
        " state that is fitted to 0.3 s of readings. A simulator can use the model at the angles and"
        f" speeds of the map, up to {speeds}.",
        f"The model was fitted to {_count(fitted)}"
        + (f" and validated on {_count(held_out)} that were held out." if held_out else ". No recording was held out."),
        _days(days, len(evidence.recordings)),
        "Blank cells were not visited. There the model extrapolates, and this report makes no statement."
        " Other loads, bearings, temperatures and drives are untested.",
    ]


def _count(recordings: Sequence[RecordingUsed]) -> str:
    seconds = sum(recording.duration_s for recording in recordings)
    return f"{len(recordings)} recording{'s' if len(recordings) != 1 else ''} ({seconds:.0f} s)"


def _days(days: list[str], count: int) -> str:
    if not days:
        return "The recordings have no date, so changes of the rig from day to day are unknown."
    if len(days) == 1:
        return f"All dated recordings were made on {days[0]}, so the validity on another day is untested."
    return f"Recorded on {len(days)} days, from {days[0]} to {days[-1]} ({count} recordings)."


@page_table(
    "rod",
    "angle (rad)",
    "speed range (rad/s)",
    "time fitted (s)",
    "time held out (s)",
    style="prose",
    title="Values of the maps",
)
def domain_table(diagnosis: Diagnosis) -> Rows:
    """Return rows with speeds and durations for each range of angles."""
    rows = []
    for rod, occupancy in evidence_of(diagnosis).coverage.items():
        edges, speeds = occupancy.angle_edges_rad, occupancy.speed_edges_rad_per_s
        fitted, held_out = np.array(occupancy.fitted_s), np.array(occupancy.held_out_s)
        for i in range(0, len(fitted), PAGE.rows_of):
            times = [cells[i : i + PAGE.rows_of].sum(axis=0) for cells in (fitted, held_out)]
            visited = np.flatnonzero(times[0])
            speed_range = f"{three(speeds[visited[0]])} to {three(speeds[visited[-1] + 1])}" if len(visited) else NONE
            angles = f"{edges[i]:.2f} to {edges[i + PAGE.rows_of]:.2f}"
            rows.append((rod, angles, speed_range, *(three(float(time.sum())) for time in times)))
    return rows


DOMAIN = EvidenceSection(
    name="domain",
    title="Domain of validity",
    words=domain_words,
    figure=domain_figure,
    alternative="Maps of the time that each rod spent at each angle and speed.",
    caption="Time that each rod spent at each angle and speed in the fitted recordings, in cells of 15 degrees. The"
    " outline encloses the held-out recordings. Blank: not visited.",
    tables=(domain_table,),
)

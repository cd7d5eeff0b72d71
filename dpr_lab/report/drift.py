"""What changed between groups of runs: a sentence, tables, control charts and a page."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.drift.changes import Drift, Moved
from dpr_lab.drift.estimates import Estimates
from dpr_lab.report import style
from dpr_lab.report.figures import new_figure, save_each
from dpr_lab.report.page import figures_html, page_html, paragraph_html, section_html, table_html, write_page
from dpr_lab.shown import listed

COLUMNS = ("parameter", "moved", "first group", "change", "simultaneous interval", "between", "by chance")
GROUP_COLUMNS = ("parameter", "groups", "change", "simultaneous interval")
CHART = (
    "Control charts: each parameter of each run in the order of time, with the mean and the limits of the first group.",
    "Each run alone, as the change from the first group's mean. Shaded: where single runs of the first group are to"
    " lie, the critical value times the scatter of one run; runs of different poses are shown as they are. A dotted"
    " line stands where a parameter moved.",
)
BASES = {
    "runs of one group": "what runs of one group and pose differ by",
    "neighbouring runs": "what neighbouring runs differ by, because no group has several",
    "the noise of each run": "the noise of each run alone, because too few runs are repeated: what a rig differs by"
    " from run to run is not known, and an alarm is to be confirmed by more runs",
}


def sentence(drift: Drift) -> str:
    """The result in a sentence."""
    counted = f"{sum(drift.runs_of)} runs in {len(drift.groups)} groups"
    if not drift.moved:
        return f"Nothing moved between {listed(drift.groups)} that chance does not explain ({counted})."
    said = [f"{item.name} by {relative(item, item.change)} {between(item)}" for item in drift.moved]
    return f"{len(said)} of {len(drift.parameters)} parameters moved: {'; '.join(said)} ({counted})."


def between(item: Moved) -> str:
    """`between 2026-11-16 and 2026-11-17`: the groups that differ."""
    return f"between {item.between[0]} and {item.between[1]}"


def relative(item: Moved, change: float) -> str:
    """A change in per cent of the first group's mean; in the parameter's own unit where that is next to nothing."""
    return f"{100 * change / abs(item.first):+.3g} %" if _has_size(item) else f"{change:+.3g}"


def _has_size(item: Moved) -> bool:
    """Whether the first group's mean is larger than chance and than a tenth of the change."""
    return abs(item.first) > max(item.scatter, 0.1 * abs(item.change))


def rows(drift: Drift) -> list[list[str]]:
    """One row for each parameter, in the columns `COLUMNS`."""
    return [
        [
            item.name,
            "yes" if item.moved else "no",
            f"{item.first:.6g}",
            relative(item, item.change),
            _range(item, item.change_interval),
            " and ".join(item.between),
            f"{item.p:.2g}" if item.p else "< 0.0001",
        ]
        for item in drift.parameters
    ]


def group_rows(drift: Drift) -> list[list[str]]:
    """One row for each parameter and later group, in the columns `GROUP_COLUMNS`."""
    return [
        [
            item.name,
            f"{drift.groups[d.group]} less {drift.groups[0]}",
            relative(item, d.change),
            _range(item, d.interval),
        ]
        for item in drift.parameters
        for d in item.differences
    ]


def basis_sentence(drift: Drift, torques: Sequence[str] = ()) -> str:
    """What the intervals rest on, and that sizes are compared as ratios where nothing fixes the scale."""
    if any(item.name.endswith(("/b", "*b")) and "." in item.name for item in drift.parameters):
        ratios = (
            " Sizes of effects are compared as ratios to b (`/b`; `*b` for a size per kg), because these runs do not"
            " fix the scale of torques."
        )
    else:
        ratios = ""
    driven = f"Runs driven by their {' and '.join(torques)} torques. " if torques else ""
    return (
        f"{driven}Scatter: {BASES[drift.basis]}. All intervals hold together in {1 - drift.false_alarms:.1%} of cases;"
        f" a parameter is said to have moved where one of its intervals leaves out zero.{ratios}"
    )


def save_drift(
    drift: Drift, found: Estimates, group: Sequence[int], rig: str, out: Path, torques: Sequence[str] = ()
) -> dict[str, str]:
    """Write charts and page, which says what kinds of torques drove the runs; their paths by name.

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_each({"control_chart": chart(drift, found, group)}, out)
    drawn = figures_html(figures, {"control_chart": CHART})
    sections = [
        section_html("What moved", table_html(COLUMNS, rows(drift)), paragraph_html(basis_sentence(drift, torques))),
        section_html("Run by run", drawn["control_chart"]),
        section_html("Each group less the first", table_html(GROUP_COLUMNS, group_rows(drift))),
    ]
    page = page_html(f"Double pendulum “{rig}”: what changed", sentence(drift), sections)
    return {"report": str(write_page(page, out / "drift.html")), "control_chart": str(figures["control_chart"])}


def chart(drift: Drift, found: Estimates, group: Sequence[int]) -> Figure:
    """A control chart of each parameter."""
    with style.house_style():
        figure = new_figure(0.6 + 1.1 * len(drift.parameters))  # inch, for the foot and for each chart
        panels = figure.subplots(len(drift.parameters), 1, sharex=True, squeeze=False)[:, 0]
        edges = [k + 0.5 for k in range(len(group) - 1) if group[k] != group[k + 1]]
        for axes, item, values in zip(panels, drift.parameters, found.values.T, strict=True):
            _draw(axes, item, values, drift.critical)
            for edge in edges:
                axes.axvline(edge, color="#bbbbbb", linewidth=0.6)
            if item.moved:
                axes.axvline(_last(group, item.after) + 0.5, **style.HORIZON)
        middle = [float(np.mean([k for k, g in enumerate(group) if g == i])) for i in range(len(drift.groups))]
        panels[-1].set_xticks(middle, drift.groups, fontsize=7.5)
        panels[-1].set_xlabel("runs in the order of time, by group")
        return figure


def _draw(axes: Axes, item: Moved, values: np.ndarray, critical: float) -> None:
    scale = 100 / abs(item.first) if _has_size(item) else 1.0
    reach = critical * item.scatter * scale
    axes.axhspan(-reach, reach, **style.NOISE_BAND)
    axes.plot((values - item.first) * scale, marker="o", markersize=3, **style.EVOLUTION)
    axes.set_title(f"{item.name}{f': moved {between(item)}' if item.moved else ''}")
    axes.set_ylabel("change, %" if _has_size(item) else "change")


def _range(item: Moved, interval: tuple[float, float]) -> str:
    return f"{relative(item, interval[0])} to {relative(item, interval[1])}"


def _last(group: Sequence[int], wanted: int) -> int:
    return max(k for k, g in enumerate(group) if g <= wanted)

"""Report of drift between groups of runs: verdict, tables, control charts, HTML page."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.drift.changes import Drift, ParameterChange
from dpr_lab.drift.estimates import Estimates
from dpr_lab.dynamics.base import RATIO_UNITS
from dpr_lab.effects import EFFECTS
from dpr_lab.report import style
from dpr_lab.report.digits import superscripts
from dpr_lab.report.figures import new_figure, save_each
from dpr_lab.report.pages.page import Rows, Section, page_html, page_table, pictures, write_page
from dpr_lab.shown import listed, percent

CHART = (
    "Control charts: each parameter over the runs, group by group, with mean and limits of the first group.",
    "Estimate of each run: change from the mean of the first group. Shaded band: control limits of single"
    " runs of the first group (critical value times the standard deviation of a run). Differences between"
    " poses are not removed. Dotted line: change point of a significant change.",
)
BASES = {
    "runs of one group": "from runs of the same group and pose",
    "neighbouring runs": "from successive runs, because no group has several runs",
    "the noise of each run": (
        "only from the noise of each run, because too few runs are repeated. The"
        " variation from run to run is unknown, so confirm a significant change with more runs"
    ),
}
"""Source of the standard deviation of a run, as a phrase for each value of `Drift.basis`."""


def sentence(drift: Drift) -> str:
    """State in a sentence which parameters changed significantly, and between which groups."""
    counts = f"{sum(drift.runs_of)} runs in {len(drift.groups)} groups"
    if not drift.moved:
        return f"No significant change between {listed(drift.groups)} ({counts})."
    start = f"Significant change of {len(drift.moved)} of {len(drift.parameters)} parameters"
    changes = [f"{change.name} by {relative(change, change.change)}" for change in drift.moved]
    pairs = [between(change) for change in drift.moved]
    if len(set(pairs)) == 1:
        return f"{start} {pairs[0]}: {', '.join(changes)} ({counts})."
    stated = [f"{change} {pair}" for change, pair in zip(changes, pairs, strict=True)]
    return f"{start}: {'; '.join(stated)} ({counts})."


def between(parameter: ParameterChange) -> str:
    """Name the groups that differ, for example `between 2026-11-16 and 2026-11-17`."""
    return f"between {parameter.between[0]} and {parameter.between[1]}"


def relative(parameter: ParameterChange, change: float) -> str:
    """Format a change in per cent of the mean of the first group.

    If this mean is about zero, the change is in SI units.
    """
    if not _has_size(parameter):
        return f"{change:+.3g} {unit_of(parameter.name)}".strip()
    per_cent = round(100 * change / abs(parameter.first), 6)  # equal data must not change by rounding errors
    return f"{per_cent:+.3g} %"


def unit_of(name: str) -> str:
    """Return the SI unit of a parameter, for example `1/s²` for `coulomb_joint2.torque_Nm/b`.

    The text is empty for a pure number.
    """
    effect, _, amplitude = name.rpartition(".")
    unit = RATIO_UNITS.get(name, "")
    if name in "ab":
        unit = "kg m^2"
    elif effect in EFFECTS:
        symbol, *ratio = re.split(r"[/*]", amplitude)
        parameter = next(p for p in EFFECTS[effect].parameters if p.name == symbol)
        unit = parameter.ratio_unit if ratio else parameter.unit
    return "" if unit == "1" else superscripts(unit)


def _has_size(parameter: ParameterChange) -> bool:
    """Check whether the mean of the first group exceeds the scatter of a run and a tenth of the change."""
    return abs(parameter.first) > max(parameter.scatter, 0.1 * abs(parameter.change))


@page_table("parameter", "significant", "mean of first group", "change", "simultaneous interval", "groups", "p-value")
def change_table(drift: Drift) -> Rows:
    """Return one row for each parameter."""
    return [
        [
            parameter.name,
            "yes" if parameter.moved else "no",
            f"{parameter.first:.6g} {unit_of(parameter.name)}".strip(),
            relative(parameter, parameter.change),
            _range(parameter, parameter.change_interval),
            " and ".join(parameter.between),
            f"{parameter.p:.2g}" if parameter.p else "< 0.0001",
        ]
        for parameter in drift.parameters
    ]


@page_table("parameter", "groups", "change", "simultaneous interval")
def group_table(drift: Drift) -> Rows:
    """Return one row for each parameter and each group after the first."""
    return [
        [
            parameter.name,
            f"{drift.groups[difference.group]} minus {drift.groups[0]}",
            relative(parameter, difference.change),
            _range(parameter, difference.interval),
        ]
        for parameter in drift.parameters
        for difference in parameter.differences
    ]


def basis_sentence(drift: Drift, torques: Sequence[str] = ()) -> str:
    """Describe how the intervals were computed, and the ratios if the scale is not identified."""
    ends = ("/b", "*b", "/a", "*a")
    scaled = [name for parameter in drift.parameters if "." in (name := parameter.name) and name.endswith(ends)]
    inertia = scaled[0][-1] if scaled else ""
    ratios = (
        f" Sizes of effects are compared as ratios to {inertia} (`/{inertia}`; `*{inertia}` for a size per kg), because"
        " these runs do not identify the scale of torques."
    )
    ratios = ratios if scaled else ""
    driven = f"Runs driven by their {' and '.join(torques)} torques. " if torques else ""
    return (
        f"{driven}Standard deviation of a run: {BASES[drift.basis]}. The intervals hold simultaneously with a"
        f" probability of {percent(1 - drift.false_alarms, 1)}. A change is significant if one of its intervals"
        f" excludes zero.{ratios}"
    )


def save_drift(
    drift: Drift, estimates: Estimates, group: Sequence[int], rig: str, out: Path, torques: Sequence[str] = ()
) -> dict[str, str]:
    """Write the control charts and the page, and return their paths by name.

    Args:
        drift: the result
        estimates: estimates of each run, in chronological order
        group: index of the group of each run
        rig: name of the rig
        out: folder of the files
        torques: kinds of known torques that drove the runs

    Raises:
        DprError: the folder or a file cannot be written.
    """
    figures = save_each({"control_chart": chart(drift, estimates, group)}, out)
    chart_picture = pictures(figures, {"control_chart": CHART})["control_chart"]
    sections = [
        Section("Changes", [change_table(drift), basis_sentence(drift, torques)], is_open=True),
        Section("Control charts", [chart_picture], is_open=True),
        Section("Changes from the first group", [group_table(drift)]),
    ]
    page = page_html(f"Rig “{rig}”: drift", sentence(drift), sections)
    return {"report": str(write_page(page, out / "drift.html")), "control_chart": str(figures["control_chart"])}


def chart(drift: Drift, estimates: Estimates, group: Sequence[int]) -> Figure:
    """Draw a control chart of each parameter, group by group.

    Runs of two groups may alternate in time.
    """
    order = np.argsort(group, kind="stable")
    group = [group[k] for k in order]
    with style.house_style():
        figure = new_figure(0.6 + 1.1 * len(drift.parameters))  # height in inches: axis label, then 1.1 per chart
        panels = figure.subplots(len(drift.parameters), 1, sharex=True, squeeze=False)[:, 0]
        edges = [k + 0.5 for k in range(len(group) - 1) if group[k] != group[k + 1]]
        for axes, parameter, values in zip(panels, drift.parameters, estimates.values[order].T, strict=True):
            _draw(axes, parameter, values, drift.critical)
            for edge in edges:
                axes.axvline(edge, color="#bbbbbb", linewidth=0.6)
            if parameter.moved:
                axes.axvline(_last(group, parameter.after) + 0.5, **style.HORIZON)
        centres = [float(np.mean([k for k, g in enumerate(group) if g == i])) for i in range(len(drift.groups))]
        panels[-1].set_xticks(centres, drift.groups, fontsize=7.5)
        panels[-1].set_xlabel("runs of each group, in chronological order")
        return figure


def _draw(axes: Axes, parameter: ParameterChange, values: np.ndarray, critical: float) -> None:
    scale = 100 / abs(parameter.first) if _has_size(parameter) else 1.0
    limit = critical * parameter.scatter * scale
    axes.axhspan(-limit, limit, **style.NOISE_BAND)
    axes.plot((values - parameter.first) * scale, marker="o", markersize=3, **style.EVOLUTION)
    axes.set_title(f"{parameter.name}{f': change {between(parameter)}' if parameter.moved else ''}")
    axes.set_ylabel(f"change ({'%' if _has_size(parameter) else unit_of(parameter.name) or 1})")


def _range(parameter: ParameterChange, interval: tuple[float, float]) -> str:
    return f"{relative(parameter, interval[0])} to {relative(parameter, interval[1])}"


def _last(group: Sequence[int], number: int) -> int:
    return max(k for k, g in enumerate(group) if g <= number)

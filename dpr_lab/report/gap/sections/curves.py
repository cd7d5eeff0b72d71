"""Measured and simulated angles side by side, before and after."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Curves
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import empty_figure, legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.gap.tables import run_words

RODS = ("inner rod", "outer rod")
LOOKS = {"before the effects": style.SIMULATED, "after the effects": style.RESIDUAL | {"linewidth": 1.1, "zorder": 4}}


def curves_figure(diagnosis: Diagnosis) -> Figure:
    """For each recording the angles of both rods, and below them what simulations are off."""
    shown = evidence_of(diagnosis).curves[: PAGE.most_runs]
    with style.house_style():
        if not shown:
            return empty_figure("no recording was simulated")
        figure = new_figure(0.5 + 3.0 * len(shown))
        grid = figure.subplots(2 * len(shown), 2, squeeze=False, height_ratios=(3, 2) * len(shown), sharex="col")
        for row, curves in enumerate(shown):
            for column in range(2):
                _draw_run(grid[2 * row, column], grid[2 * row + 1, column], curves, column)
            held = ", held out" if curves.held_out else ""
            grid[2 * row, 0].set_title(f"{run_words(curves.run)}{held}", parse_math=False)
        for axes in grid[-1]:
            axes.set_xlabel("time since the first reading (s)")
        figure.align_ylabels(grid)
        legend_above(figure)
        return figure


def _draw_run(angles: Axes, errors: Axes, curves: Curves, column: int) -> None:
    t = np.array(curves.t_s)
    near = t <= curves.until_s
    measured = np.array(curves.measured_rad)[:, column]
    angles.plot(t, measured, label="measured", **style.MEASURED)
    for (name, look), told in zip(LOOKS.items(), (curves.before_rad, curves.after_rad), strict=True):
        values = np.array(told)[near, column]
        angles.plot(t[near], values, label=name, **look)
        errors.plot(t[near], 1e3 * (values - measured[near]), label=name, **look)
    for axes in (angles, errors):
        axes.axvline(curves.settled_s, label="end of what the start is fitted to", **style.HORIZON)
        axes.margins(x=0.01)
    errors.axhline(0.0, color="#555555", linewidth=0.8)
    angles.set_ylabel(f"{RODS[column]}\n(rad)")
    errors.set_ylabel("simulated −\nmeasured (mrad)")


def curves_words(diagnosis: Diagnosis) -> list[str]:
    """How far off, recording by recording."""
    runs = evidence_of(diagnosis).budget.runs
    worst = max(runs, key=lambda run: run.error_before_rad, default=None)
    if worst is None:
        return ["No recording was simulated."]
    return [
        "Each simulation starts where 0.3 s of readings put it, and is not corrected after that. Where the two models"
        f" lie farthest apart, in {run_words(worst.run)}, the bare model is off by"
        f" {three(1e3 * worst.error_before_rad)} mrad rms and the"
        f" corrected one by {three(1e3 * worst.error_after_rad)} mrad."
    ]


def curves_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every fifth point."""
    return [
        (run_words(curves.run), f"{t:.2f}", *(f"{value[j]:.4f}" for j in range(2) for value in at))
        for curves in evidence_of(diagnosis).curves[: PAGE.most_runs]
        for t, *at in list(zip(curves.t_s, curves.measured_rad, curves.before_rad, curves.after_rad, strict=True))[
            :: PAGE.every
        ]
        if t <= curves.until_s
    ]


CURVES = EvidenceSection(
    name="curves",
    title="Measured and simulated",
    words=curves_words,
    figure=curves_figure,
    alternative="Line charts of the angles of both rods, measured and simulated before and after.",
    caption="Angles of the rods, 0 = upright, π = hanging: measured (broad), simulated without the named effects"
    " (dashed) and"
    " with them (thin), up to the predictability horizon. Below each, what the simulations are off, in mrad.",
    tables=(
        FoldedTable(
            "The curves in numbers",
            (
                "run",
                "t (s)",
                *(f"{rod} {what} (rad)" for rod in ("inner", "outer") for what in ("measured", "before", "after")),
            ),
            curves_rows,
        ),
    ),
)

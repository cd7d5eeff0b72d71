"""Measured and simulated angles of the bare and of the corrected model."""

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
LINES = {"bare model": style.SIMULATED, "corrected model": style.RESIDUAL | {"linewidth": 1.1, "zorder": 4}}


def curves_figure(diagnosis: Diagnosis) -> Figure:
    """Angles of both rods for each recording, with the errors of the simulations below."""
    shown = evidence_of(diagnosis).curves[: PAGE.most_runs]
    with style.house_style():
        if not shown:
            return empty_figure("No recording was simulated.")
        figure = new_figure(0.5 + 3.0 * len(shown))
        grid = figure.subplots(2 * len(shown), 2, squeeze=False, height_ratios=(3, 2) * len(shown), sharex="col")
        for row, curves in enumerate(shown):
            for column in range(2):
                _draw_run(grid[2 * row, column], grid[2 * row + 1, column], curves, column)
            grid[2 * row, 0].set_title(run_words(curves.run, curves.held_out), parse_math=False)
        for axes in grid[-1]:
            axes.set_xlabel("time since the first sample (s)")
        figure.align_ylabels(grid)
        legend_above(figure)
        return figure


def _draw_run(angles: Axes, errors: Axes, curves: Curves, column: int) -> None:
    t = np.array(curves.t_s)
    near = t <= curves.until_s
    measured = np.array(curves.measured_rad)[:, column]
    angles.plot(t, measured, label="measured", **style.MEASURED)
    for (name, line), simulated in zip(LINES.items(), (curves.before_rad, curves.after_rad), strict=True):
        values = np.array(simulated)[near, column]
        angles.plot(t[near], values, label=name, **line)
        errors.plot(t[near], 1e3 * (values - measured[near]), label=name, **line)
    for axes in (angles, errors):
        axes.axvline(curves.settled_s, label="end of the initial-state fit", **style.HORIZON)
        axes.margins(x=0.01)
    errors.axhline(0.0, color="#555555", linewidth=0.8)
    angles.set_ylabel(f"{RODS[column]}\n(rad)")
    errors.set_ylabel("simulated −\nmeasured (mrad)")


def curves_words(diagnosis: Diagnosis) -> list[str]:
    """Errors of the free runs of the recording with the largest error."""
    runs = evidence_of(diagnosis).budget.runs
    worst = max(runs, key=lambda run: run.error_before_rad, default=None)
    if worst is None:
        return ["No recording was simulated."]
    return [
        "Each free run starts from an initial state that is fitted to the first 0.3 s. The bare model has its largest"
        f" rms error, {three(1e3 * worst.error_before_rad)} mrad, in {run_words(worst.run)}; the corrected model has"
        f" {three(1e3 * worst.error_after_rad)} mrad there."
    ]


def curves_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every fifth point of the curves."""
    return [
        (run_words(curves.run), f"{t:.2f}", *(f"{angles[rod]:.4f}" for rod in range(2) for angles in models))
        for curves in evidence_of(diagnosis).curves[: PAGE.most_runs]
        for t, *models in list(zip(curves.t_s, curves.measured_rad, curves.before_rad, curves.after_rad, strict=True))[
            :: PAGE.every
        ]
        if t <= curves.until_s
    ]


CURVES = EvidenceSection(
    name="curves",
    title="Measured and simulated angles",
    words=curves_words,
    figure=curves_figure,
    alternative="Line charts of the angles of both rods: measured, bare model, corrected model.",
    caption="Angles of the rods, 0 = upright, π = hanging: measured (broad), bare model (dashed) and corrected model"
    " (thin), up to the predictability horizon. Below: error of each simulation, in mrad.",
    tables=(
        FoldedTable(
            "Curves, values",
            (
                "run",
                "time (s)",
                *(
                    f"{rod} rod, {curve} (rad)"
                    for rod in ("inner", "outer")
                    for curve in ("measured", "bare model", "corrected model")
                ),
            ),
            curves_rows,
        ),
    ),
)

"""Show measured angles, and angles that the bare and the corrected model simulate."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.arrays import Array
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Curves
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, evidence_of
from dpr_lab.report.gap.tables import run_words
from dpr_lab.report.pages.page import Rows, page_table

LINES = {"bare model": style.SIMULATED, "corrected model": style.RESIDUAL | {"linewidth": 1.1, "zorder": 4}}
CURVE_NAMES = ("measured", *LINES)

Angles = dict[str, Array]
"""Angles (n, 3) of each part (arm or rod), by name, rad. The columns are `CURVE_NAMES`."""


def angles_of(curves: Curves) -> Angles:
    """Return the angles of the mounted rods, and of the arm if it moves."""
    models = np.stack([curves.measured_rad, curves.before_rad, curves.after_rad], axis=2)
    rods = {name: models[:, rod] for rod, name in enumerate(("inner rod", "outer rod")[: curves.rods])}
    return ({"arm": np.array(curves.arm_rad)} if curves.arm_rad else {}) | rods


def curves_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw the angles of arm and rods for each recording; None if no recording was simulated.

    The errors of the simulations and the input of the arm are below the angles.
    """
    shown = evidence_of(diagnosis).curves[: PAGE.most_runs]
    if not shown:
        return None
    by_curves = [angles_of(curves) for curves in shown]
    heights = [height for curves in shown for height in ((3, 2, 1.5) if curves.input else (3, 2))]
    figure = new_figure(0.5 + 0.6 * sum(heights))
    columns = max(len(angles) for angles in by_curves)
    grid = figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights, sharex="col")
    row = 0
    for curves, angles in zip(shown, by_curves, strict=True):
        rows = grid[row : row + (3 if curves.input else 2)]
        for column in range(columns):
            _draw_part(list(rows[:2, column]), curves, [*angles.items()][column] if column < len(angles) else None)
        if curves.input:
            _draw_input(list(rows[2]), curves)
        rows[0, 0].set_title(run_words(curves.run, curves.held_out), parse_math=False)
        row += len(rows)
    for column in grid.T:
        lowest = [axes for axes in column if axes.get_visible()][-1]
        lowest.set_xlabel("time since the first sample (s)")
        lowest.tick_params(labelbottom=True)
    figure.align_ylabels(grid)
    legend_above(figure)
    return figure


def _draw_part(rows: Sequence[Axes], curves: Curves, part: tuple[str, Array] | None) -> None:
    """Draw angles and errors of one part of the rig in one column."""
    if part is None:
        for axes in rows:
            axes.set_visible(False)
        return
    (name, angles), t = part, np.array(curves.t_s)
    near = t <= curves.until_s
    rows[0].plot(t, angles[:, 0], label="measured", **style.MEASURED)
    for (label, line), values in zip(LINES.items(), angles[near, 1:].T, strict=True):
        rows[0].plot(t[near], values, label=label, **line)
        rows[1].plot(t[near], 1e3 * (values - angles[near, 0]), label=label, **line)
    for axes in rows:
        axes.axvline(curves.settled_s, label="end of the initial-state fit", **style.HORIZON)
        axes.margins(x=0.01)
    rows[1].axhline(0.0, **style.ZERO)
    rows[0].set_ylabel(f"{name}\n(rad)")
    rows[1].set_ylabel("simulated −\nmeasured (mrad)")


def _draw_input(row: Sequence[Axes], curves: Curves) -> None:
    """Draw the input of the arm below the angle of the arm."""
    row[0].step(curves.t_s, curves.input, where="post", color="#555555", linewidth=1.1)
    row[0].set_ylabel(curves.input_name.replace(" (", "\n("))
    row[0].margins(x=0.01)
    for axes in row[1:]:
        axes.set_visible(False)


def curves_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the free runs, and state the errors in the recording where the bare model has the largest error."""
    runs = evidence_of(diagnosis).budget.runs
    worst = max(runs, key=lambda run: run.error_before_rad, default=None)
    if worst is None:
        return ["No recording was simulated."]
    return [
        "Each free run starts from an initial state that is fitted to the first 0.3 s of readings. The rms errors"
        " below are those up to the predictability horizon; the errors that `dpr-lab diagnose` prints cover 2.6 s, also"
        f" beyond the horizon. The bare model has its largest rms error in {run_words(worst.run)}:"
        f" {three(1e3 * worst.error_before_rad)} mrad, compared with {three(1e3 * worst.error_after_rad)} mrad of the"
        " corrected model."
    ]


@page_table(
    "run", "time (s)", "part", *(f"{curve} (rad)" for curve in CURVE_NAMES), style="prose", title="Values of the curves"
)
def curves_table(diagnosis: Diagnosis) -> Rows:
    """Return rows with every fifth point of the curves."""
    return [
        (run_words(curves.run), f"{curves.t_s[k]:.2f}", part, *(f"{angle:.4f}" for angle in angles[k]))
        for curves in evidence_of(diagnosis).curves[: PAGE.most_runs]
        for k in range(0, len(curves.t_s), PAGE.every)
        if curves.t_s[k] <= curves.until_s
        for part, angles in angles_of(curves).items()
    ]


CURVES = EvidenceSection(
    name="curves",
    title="Measured and simulated angles",
    words=curves_words,
    figure=curves_figure,
    alternative="Line charts of the angles of rods and arm (measured, bare model, corrected model) and of its input.",
    caption="Angles of the rods, 0 = upright, π = hanging: measured (thick), bare model (dashed) and corrected model"
    " (thin), up to the predictability horizon. Below: error of each simulation (mrad), and the input of a driven arm.",
    tables=(curves_table,),
)

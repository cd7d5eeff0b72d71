"""Show by how much each named effect reduces the gap of data that were not fitted."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import EvidenceSection, evidence_of
from dpr_lab.report.gap.summary import held_out_words
from dpr_lab.report.gap.tables import per_reading
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import named
from dpr_lab.shown import percent


def closing_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw a waterfall from the gap of the bare model to the remainder; None without a named effect."""
    steps = evidence_of(diagnosis).closing
    if len(steps) < 2:
        return None
    gaps = 1e3 * np.array([step.left_rad for step in steps])
    names = ["bare model", *(named(step.effect).replace(" [", "\n[") for step in steps[1:]), "remainder"]
    figure = new_figure(1.2 + 0.42 * len(names))
    axes = figure.subplots()
    rows = np.arange(len(names))
    axes.barh(rows[[0, -1]], gaps[[0, -1]], height=0.6, label="gap", **_bar(style.SIMULATED))
    reductions = gaps[:-1] - gaps[1:]
    bars = axes.barh(rows[1:-1], reductions, left=gaps[1:], height=0.6, label="reduction", **_bar(style.MEASURED))
    axes.bar_label(bars, [three(reduction) for reduction in reductions], padding=4)
    for row, gap in zip((0, len(rows) - 1), gaps[[0, -1]].tolist(), strict=True):
        axes.annotate(three(gap), (gap, row), (4, 0), textcoords="offset points", va="center")
    for row, (_, after) in enumerate(pairwise(gaps.tolist())):
        axes.plot([after, after], [row + 0.7, row + 2.3], **style.ZERO)
    floor = 1e3 * per_reading(diagnosis.gap, "floor_rad")
    axes.axvline(floor, label="noise floor", **style.HORIZON)
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.margins(x=0.08)
    axes.set_xlabel("gap per reading (mrad rms)")
    legend_above(figure)
    return figure


def _bar(line: dict) -> dict:
    return {"color": line["color"], "edgecolor": "#222222", "linewidth": 0.6}


def closing_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the gap before and after correction, and the data of the comparison."""
    steps = evidence_of(diagnosis).closing
    if len(steps) < 2:
        return ["No effect is named, so the gap is not reduced."]
    data = {
        "one release": "each quarter of the single run, predicted from the other quarters",
        "releases left out": "each run, predicted from the other runs",
        "held-out runs": f"the {held_out_words(diagnosis)}",
    }[diagnosis.basis]
    return [
        f"The named effects reduce the gap from {three(1e3 * steps[0].left_rad)} to"
        f" {three(1e3 * steps[-1].left_rad)} mrad, by {percent(steps[-1].closed, 1)}. Data: {data}."
    ]


@page_table(
    "model",
    "gap, data not fitted (mrad)",
    "cumulative reduction",
    style="prose",
    title="Values of the gap reduction by effect",
)
def closing_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each model, with the gap and its cumulative reduction; empty without a named effect."""
    steps = evidence_of(diagnosis).closing
    return [
        (
            f"+ {named(step.effect)}" if step.effect else "bare model",
            three(1e3 * step.left_rad),
            percent(step.closed, 1),
        )
        for step in steps
        if len(steps) > 1
    ]


CLOSING = EvidenceSection(
    name="closing",
    title="Gap reduction",
    words=closing_words,
    figure=closing_figure,
    alternative="Waterfall of the gap: bare model, reduction by each named effect, remainder.",
    caption=(
        "Gap after each added effect, in the order of selection, on data that were not fitted: rms of a"
        " reading above the noise, in segments of 0.5 s with free initial states."
    ),
    tables=(closing_table,),
    symbols="Gap: σ √(χ² / dof − level). σ is the noise of a reading, and level is the value of χ² / dof due to noise"
    " alone. Reduction: 1 − gap after / gap before.",
)

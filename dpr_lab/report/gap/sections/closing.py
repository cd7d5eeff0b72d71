"""How the gap falls as one effect after the other is added, on the data that the verdict was tested on."""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report import style
from dpr_lab.report.digits import three
from dpr_lab.report.figures import empty_figure, legend_above, new_figure
from dpr_lab.report.gap.section import EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.words import named


def closing_figure(diagnosis: Diagnosis) -> Figure:
    """Waterfall from the gap of the bare model to what all effects leave."""
    steps = evidence_of(diagnosis).closing
    with style.house_style():
        if len(steps) < 2:
            return empty_figure("no effect is named: nothing closes the gap")
        left = 1e3 * np.array([item.left_rad for item in steps])
        names = ["bare model", *(named(item.effect).replace(" [", "\n[") for item in steps[1:]), "left"]
        figure = new_figure(1.2 + 0.42 * len(names))
        axes = figure.subplots()
        rows = np.arange(len(names))
        axes.barh(rows[[0, -1]], left[[0, -1]], height=0.6, label="gap", **_bar(style.SIMULATED))
        falls = left[:-1] - left[1:]
        bars = axes.barh(rows[1:-1], falls, left=left[1:], height=0.6, label="closed", **_bar(style.MEASURED))
        axes.bar_label(bars, [three(fall) for fall in falls], padding=4)
        for row, at in zip((0, len(rows) - 1), left[[0, -1]].tolist(), strict=True):
            axes.annotate(three(at), (at, row), (4, 0), textcoords="offset points", va="center")
        for row, (_, after) in enumerate(pairwise(left.tolist())):
            axes.plot([after, after], [row + 0.7, row + 2.3], color="#555555", linewidth=0.8)
        floor = 1e3 * _floor(diagnosis)
        axes.axvline(floor, label="noise of a reading", **style.HORIZON)
        axes.set_yticks(rows, names)
        axes.invert_yaxis()
        axes.margins(x=0.08)
        axes.set_xlabel("gap above the noise, rms of a reading (mrad)")
        legend_above(figure)
        return figure


def _bar(look: dict) -> dict:
    return {"color": look["color"], "edgecolor": "#222222", "linewidth": 0.6}


def _floor(diagnosis: Diagnosis) -> float:
    """Noise of a reading, rms over both joints, rad."""
    return float(np.sqrt(np.mean(np.square(list(diagnosis.gap.floor_rad.values())))))


def closing_words(diagnosis: Diagnosis) -> list[str]:
    """How much closes, and on what that was seen."""
    steps = evidence_of(diagnosis).closing
    if len(steps) < 2:
        return ["No effect is named, so the gap stays as it is."]
    on = {
        "one release": "each quarter of the one recording, foretold from the others",
        "releases left out": "each recording, foretold from the others",
        "held-out runs": "the recordings that were held out",
    }[diagnosis.basis]
    return [
        f"Readings differ from the bare simulation by {three(1e3 * steps[0].left_rad)} mrad above the noise; with all"
        f" that"
        f" is named {three(1e3 * steps[-1].left_rad)} mrad are left, {steps[-1].closed:.0%} less. That is seen on {on}."
    ]


def closing_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """What is left after each effect."""
    return [
        (f"+ {named(item.effect)}" if item.effect else "bare model", three(1e3 * item.left_rad), f"{item.closed:.1%}")
        for item in evidence_of(diagnosis).closing
    ]


CLOSING = EvidenceSection(
    name="closing",
    title="What closes the gap",
    words=closing_words,
    figure=closing_figure,
    alternative="Waterfall of the gap: the bare model, what each named effect closes, what is left.",
    caption="The gap as named effects are added one at a time, in the order in which they were found, on data that took"
    " no part in the fit: rms of a reading above the noise, segments of 0.5 s with free start states.",
    tables=(FoldedTable("The same in numbers", ("model", "gap left (mrad)", "closed so far"), closing_rows),),
    symbols="Gap: √((χ² − level · dof) / dof) · σ. Closed: 1 − gap after / gap before.",
)

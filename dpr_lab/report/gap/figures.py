"""Figures of a diagnosis: residual maps, gap reduction, gap by segment length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.gap_size import Where
from dpr_lab.report import style
from dpr_lab.report.figures import draw_with_intervals, empty_figure, legend_above, new_figure, save_each
from dpr_lab.report.gap.sections import SECTIONS
from dpr_lab.report.gap.tables import coordinate, per_reading, place_map, quantity, steps
from dpr_lab.report.words import in_words
from dpr_lab.shown import percent


def where_figure(diagnosis: Diagnosis, most: int = 4) -> Figure:
    """Draw the residual maps of the `most` locations that explain most of the excess, with 90 % intervals."""
    shown = [place for place in diagnosis.where[:most] if any(place.std)]
    if not shown:
        return empty_figure("No gap in the segments is large enough to be located.")
    figure = new_figure(2.6 * ((len(shown) + 1) // 2) + 0.4)
    grid = figure.subplots((len(shown) + 1) // 2, 2, squeeze=False)
    for axes, place in zip(grid.flat, shown, strict=False):
        _draw_place(axes, place)
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    return figure


def _draw_place(axes: Axes, place: Where) -> None:
    draw_with_intervals(axes, *place_map(place), marker="o", markersize=3, color=style.RESIDUAL["color"])
    axes.set_title(f"{in_words(place.site)} by {place.coordinate}: {percent(place.share)} of the excess")
    axes.set_xlabel(coordinate(place)[0])
    axes.set_ylabel(quantity(place)[0])


def waterfall_figure(diagnosis: Diagnosis) -> Figure:
    """Draw the gap after each added effect, and the noise floor."""
    names, gaps = zip(*((name.replace(" [", "\n["), gap) for name, gap in steps(diagnosis)), strict=True)
    heights = 1e3 * np.array(gaps)
    floor = 1e3 * per_reading(diagnosis.gap, "floor_rad")
    figure = new_figure(1.1 + 0.4 * len(names))
    axes = figure.subplots()
    bars = axes.barh(names, heights, color=style.RESIDUAL["color"], height=0.6)
    axes.bar_label(bars, [f"{height:.3g}" for height in heights], padding=4)
    axes.axvline(floor, label="noise floor", **style.HORIZON)
    axes.invert_yaxis()
    axes.set_xlabel("gap per reading, segments of 0.5 s (mrad rms)")
    legend_above(figure)
    return figure


def horizon_figure(diagnosis: Diagnosis) -> Figure:
    """Plot the gap of the bare and of the corrected model against the segment length; initial states are fitted."""
    lengths = [float(length) for length in diagnosis.gap.by_horizon]
    if not lengths:
        return empty_figure("The gap by segment length was not computed.")
    figure = new_figure(3.2)
    axes = figure.subplots()
    for name, (label, line) in style.MODELS.items():
        rms = [1e3 * max(models[name], 1e-9) for models in diagnosis.gap.by_horizon.values()]
        axes.loglog(lengths, rms, label=label, marker="o", **line)
    floor = 1e3 * per_reading(diagnosis.gap, "floor_rad")
    axes.axhline(floor, label="noise floor", **style.HORIZON)
    lowest, highest = axes.get_ylim()
    axes.set_ylim(bottom=max(lowest, min(floor, highest) / 300))
    axes.set_xticks(lengths, list(diagnosis.gap.by_horizon))
    axes.minorticks_off()
    axes.set_xlabel("segment length (s)")
    axes.set_ylabel("gap per reading (mrad rms)")
    legend_above(figure)
    return figure


def save_gap_figures(diagnosis: Diagnosis, out_dir: Path) -> dict[str, Path]:
    """Write the figures of a diagnosis as PNG.

    Returns:
        path of each file by the name of its figure: gap_horizon, where (unless there is no gap to locate), and
            waterfall or the figures of the evidence

    Raises:
        DprError: the folder or a file cannot be written.
    """
    with style.house_style():
        figures = {"gap_horizon": horizon_figure(diagnosis)}
        if diagnosis.where:
            figures["where"] = where_figure(diagnosis)
        if diagnosis.evidence is None:
            figures["waterfall"] = waterfall_figure(diagnosis)
        else:
            drawn = {section.name: section.figure(diagnosis) for section in SECTIONS if section.figure}
            figures |= {name: figure for name, figure in drawn.items() if figure}
    return save_each(figures, out_dir)

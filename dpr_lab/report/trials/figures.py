"""Draw the figures of blind trials: confusion matrix, reliability diagram, detection rate by size."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.report import style
from dpr_lab.report.figures import empty_figure, new_figure, save_each
from dpr_lab.report.trials.tables import Summary, size_range


def confusion_figure(summary: Summary) -> Figure:
    """Draw the confusion matrix.

    Rows are hidden effects. Columns are the first named effects, or the verdicts of trials without a named effect.
    """
    table: Mapping[str, Mapping[str, int]] = summary["confusion"]
    if not table:
        return empty_figure("There are no trials.")
    rows, labels = list(table), {name for counts in table.values() for name in counts}
    columns = [name for name in rows if name in labels] + sorted(labels.difference(rows))
    counts = np.array([[table[row].get(column, 0) for column in columns] for row in rows])
    figure = new_figure(2.4 + 0.21 * len(rows))  # height in inches: margins, then 0.21 per row
    axes = figure.subplots()
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", vmin=0, vmax=1.4, aspect="auto")
    axes.grid(False)
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=7)
    axes.set_yticks(range(len(rows)), rows, fontsize=7)
    axes.set_xlabel("first named effect")
    axes.set_ylabel("hidden effect")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=6.5, color="#111111")
    return figure


def reliability_figure(summary: Summary) -> Figure:
    """Draw the reliability diagram: observed frequency against stated probability.

    Each point is labelled with the number of its claims.
    """
    rows = summary["reliability"]
    if not rows:
        return empty_figure("No effect was named.")
    figure = new_figure(4.2)
    axes = figure.subplots()
    stated, true, low, high = (np.array([row[name] for row in rows]) for name in ("stated", "true", "low", "high"))
    axes.plot([0, 1], [0, 1], label="perfect calibration", **style.HORIZON)
    axes.vlines(stated, low, high, color="#888888", linewidth=1.2)
    axes.plot(stated, true, marker="o", label="trials, 90 % intervals", **style.EVOLUTION)
    for row in rows:
        axes.annotate(
            f"{row['claims']:.0f}",
            (row["stated"], row["true"]),
            xytext=(6, -11),
            textcoords="offset points",
            fontsize=7.5,
        )
    axes.set(xlim=(-0.02, 1.04), ylim=(-0.04, 1.04))
    axes.set_xlabel("stated probability")
    axes.set_ylabel("observed frequency")
    axes.legend(loc="upper left")
    return figure


def size_figure(summary: Summary) -> Figure:
    """Draw the detection rate against the size relative to the minimum detectable size."""
    rows = summary["by_size"]
    if not rows:
        return empty_figure("No effect of the library was hidden.")
    figure = new_figure(2.8)
    axes = figure.subplots()
    bars = axes.bar(
        [size_range(row) for row in rows],
        [100 * row["named"] for row in rows],
        color=style.RESIDUAL["color"],
        width=0.6,
    )
    axes.bar_label(bars, [f"of {row['effects']}" for row in rows], padding=3, fontsize=8)
    axes.set_ylim(0, 112)
    axes.set_xlabel("size / minimum detectable size")
    axes.set_ylabel("detection rate (%)")
    return figure


def save_trial_figures(summary: Summary, out_dir: Path) -> dict[str, Path]:
    """Write the figures of a campaign as PNG.

    Returns:
        path of each file by the name of its figure: by_size, confusion, reliability

    Raises:
        DprError: the folder or a file cannot be written.
    """
    with style.house_style():
        figures = {
            "by_size": size_figure(summary),
            "confusion": confusion_figure(summary),
            "reliability": reliability_figure(summary),
        }
    return save_each(figures, out_dir)

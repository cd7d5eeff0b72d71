"""Show blind trials on simulated plants that resemble the rig."""

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.trust import NOTHING
from dpr_lab.report.figures import new_figure
from dpr_lab.report.gap.section import EvidenceSection
from dpr_lab.report.gap.trust_trials import trust_table, trust_words


def trust_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw the confusion matrix of hidden and named effects; None without trials."""
    if diagnosis.trust is None or not diagnosis.trust.trials:
        return None
    cells = {(cell.true, cell.named): cell.trials for cell in diagnosis.trust.confusion}
    rows, columns = (sorted({pair[i] for pair in cells}, key=lambda name: (name == NOTHING, name)) for i in range(2))
    counts = np.array([[cells.get((true, label), 0) for label in columns] for true in rows])
    figure = new_figure(1.8 + 0.28 * len(rows))
    axes = figure.subplots()
    axes.imshow(np.ma.masked_equal(counts, 0), cmap="cividis_r", aspect="auto", vmin=0, vmax=2 * counts.max())
    for row, column in np.argwhere(counts).tolist():
        right = rows[row] == columns[column]
        text = f"{counts[row, column]}{'' if right else ' ✗'}"
        axes.text(column, row, text, ha="center", va="center", weight="bold" if right else "normal")
    axes.set_xticks(range(len(columns)), columns, rotation=40, ha="right")
    axes.set_yticks(range(len(rows)), rows)
    axes.grid(visible=False)
    axes.set(xlabel="named effect", ylabel="hidden effect")
    return figure


TRUST = EvidenceSection(
    name="trust",
    title="Blind trials on this rig",
    words=trust_words,
    figure=trust_figure,
    alternative="Confusion matrix of hidden and named effects.",
    caption="Number of trials by hidden and named effect; ✗ marks incorrect effects. A named effect is"
    " correct if the hidden effect is in its class of indistinguishable effects.",
    tables=(trust_table,),
    symbols="Intervals: Wilson score.",
)

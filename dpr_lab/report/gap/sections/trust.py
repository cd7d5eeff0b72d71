"""Blind trials on simulated plants like this rig."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.trust import NOTHING, REFUSED, TrustShare, TrustTrial
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import new_figure
from dpr_lab.report.gap.section import EvidenceSection, FoldedTable
from dpr_lab.report.words import named
from dpr_lab.shown import percent


def trust_figure(diagnosis: Diagnosis) -> Figure | None:
    """Confusion matrix of hidden and named effects; None without trials."""
    if diagnosis.trust is None or not diagnosis.trust.trials:
        return None
    cells = {(cell.true, cell.named): cell.trials for cell in diagnosis.trust.confusion}
    rows, columns = (sorted({pair[i] for pair in cells}, key=lambda name: (name == NOTHING, name)) for i in range(2))
    counts = np.array([[cells.get((true, label), 0) for label in columns] for true in rows])
    with style.house_style():
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


def trust_words(diagnosis: Diagnosis) -> list[str]:
    """Results of the blind trials, and their limits."""
    trust = diagnosis.trust
    if trust is None or not trust.trials:
        return ["No blind trials were made on plants like this rig. To make them: `dpr-lab diagnose --trust 40`."]
    return [
        f"Blind trials: {len(trust.trials)} plants with the fitted parameters were simulated with the named"
        " effects, with another effect, or with none; recorded like this rig, each with different noise; and"
        " diagnosed without access to the hidden effects. Exactly the hidden effects were named in"
        f" {_share(trust.right)}. An absent effect was named in {_share(trust.wrong)}. False alarms on plants"
        f" without an effect: {_share(trust.false_alarms)}.{_refused(trust.trials)} Time per trial:"
        f" {trust.seconds_each:.0f} s.",
        (
            "All hidden effects are in the library. A real rig can have others, so its diagnosis can only be more"
            " difficult."
        ),
    ]


def _share(share: TrustShare) -> str:
    if not share.of:
        return "0 of 0"
    low, high = share.interval90
    return f"{share.held} of {share.of} (90 % interval {percent(low)} to {percent(high)})"


def _refused(trials: Sequence[TrustTrial]) -> str:
    refused = sum(trial.verdict == REFUSED for trial in trials)
    return f" In {refused} trials the recordings were refused, and no effect was named." if refused else ""


def trial_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """One row per trial."""
    trials = diagnosis.trust.trials if diagnosis.trust else []
    return [
        (
            str(number),
            trial.kind,
            ", ".join(map(named, trial.truth)) or NOTHING,
            ", ".join(map(named, trial.named)) or NOTHING,
            trial.verdict.replace("_", " "),
            _grade(trial),
            three(trial.seconds),
        )
        for number, trial in enumerate(trials, 1)
    ]


def _grade(trial: TrustTrial) -> str:
    if trial.verdict == REFUSED:
        return REFUSED
    if not trial.truth:
        return "false alarm" if trial.named else "right"
    if trial.wrong:
        return "wrong name"
    return "right" if set(trial.right) == set(trial.truth) else "missed" if trial.named or not trial.right else NONE


TRUST = EvidenceSection(
    name="trust",
    title="Blind trials on this rig",
    words=trust_words,
    figure=trust_figure,
    alternative="Confusion matrix of hidden and named effects.",
    caption="Number of trials by hidden effect and named effect; ✗ marks wrong names. A name is right if the hidden"
    " effect is in its class of indistinguishable effects.",
    tables=(
        FoldedTable(
            "All trials",
            ("trial", "kind", "hidden effects", "named effects", "verdict", "grade", "time (s)"),
            trial_rows,
        ),
    ),
    symbols="Intervals: Wilson score.",
)

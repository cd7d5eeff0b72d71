"""How often names were right in blind trials on plants like this rig."""

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


def trust_figure(diagnosis: Diagnosis) -> Figure | None:
    """What was there against what was named; none where nothing was tried."""
    if diagnosis.trust is None or not diagnosis.trust.trials:
        return None
    cells = {(cell.true, cell.named): cell.trials for cell in diagnosis.trust.confusion}
    rows, columns = (sorted({pair[i] for pair in cells}, key=lambda name: (name == NOTHING, name)) for i in range(2))
    counts = np.array([[cells.get((true, told), 0) for told in columns] for true in rows])
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
        axes.set(xlabel="named", ylabel="what was there")
        return figure


def trust_words(diagnosis: Diagnosis) -> list[str]:
    """How far names are to be trusted on this rig."""
    tried = diagnosis.trust
    if tried is None or not tried.trials:
        return ["No blind trials were made on plants like this rig: `dpr-lab diagnose --trust 40` makes them."]
    return [
        f"{len(tried.trials)} plants at the fitted point, with what was named, with another effect, or with none, were"
        " simulated by the lab's own model, recorded as this rig was with noise of its own, and diagnosed without being"
        f" told. All that was there and nothing else was named in {_of(tried.right)}; something that was not there was"
        f" named in {_of(tried.wrong)}; of the clean plants {_of(tried.false_alarms)} raised a false alarm."
        f"{_refused(tried.trials)} A trial took {tried.seconds_each:.0f} s.",
        "The plants lack nothing that the library has no name for, so a real rig can only be harder.",
    ]


def _of(share: TrustShare) -> str:
    if not share.of:
        return "none of none"
    low, high = share.interval90
    return f"{share.held} of {share.of} (90 % interval {low:.0%} to {high:.0%})"


def _refused(trials: Sequence[TrustTrial]) -> str:
    refused = sum(item.verdict == REFUSED for item in trials)
    return f" Of {refused} the diagnosis refused the recordings, and named nothing." if refused else ""


def trial_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every trial."""
    tried = diagnosis.trust.trials if diagnosis.trust else []
    return [
        (
            str(number),
            item.kind,
            ", ".join(map(named, item.truth)) or NOTHING,
            ", ".join(map(named, item.named)) or NOTHING,
            item.verdict.replace("_", " "),
            _grade(item),
            three(item.seconds),
        )
        for number, item in enumerate(tried, 1)
    ]


def _grade(item: TrustTrial) -> str:
    if item.verdict == REFUSED:
        return REFUSED
    if not item.truth:
        return "false alarm" if item.named else "right"
    if item.wrong:
        return "wrong name"
    return "right" if set(item.right) == set(item.truth) else "missed" if item.named or not item.right else NONE


TRUST = EvidenceSection(
    name="trust",
    title="How far the names are to be trusted on this rig",
    words=trust_words,
    figure=trust_figure,
    alternative="Confusion matrix: what was there against what was named, in trials.",
    caption="Effects that were there against effects that were named, in numbers of trials; ✗ marks what is not"
    " right. A"
    " name counts as right where the effect is in its class of those that these recordings do not tell apart.",
    tables=(
        FoldedTable("Every trial", ("trial", "kind", "there was", "named", "verdict", "grade", "seconds"), trial_rows),
    ),
    symbols="Intervals: Wilson's score.",
)

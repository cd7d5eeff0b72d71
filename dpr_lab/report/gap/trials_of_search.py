"""Create the table of the trials in the model search of a diagnosis."""

from collections.abc import Sequence

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.digits import NONE
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import in_words

TRIAL_NOTE = (
    "Every trial of the model search in order. Each trial starts from the last accepted set. Criterion of"
    " the tested set: held-out chi-square plus a penalty for the parameters; a negative change is an"
    " improvement. If there is a row 'short segments', the trials above it were made with short segments."
)


@page_table("move", "change of the set", "criterion", "change", "decision", "reason", caption=TRIAL_NOTE)
def trial_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each trial of the model search."""
    return [
        (
            step.move,
            _changed(step.before, step.tried),
            NONE if step.criterion is None else f"{step.criterion:.5g}",
            NONE if step.change is None else f"{step.change:+.4g}",
            "accepted" if step.accepted else "rejected",
            in_words(step.reason),
        )
        for step in diagnosis.search
    ]


def _changed(before: Sequence[str], tried: Sequence[str]) -> str:
    """Describe the difference between two sets of effects, for example `+ Coulomb friction, joint 2`."""
    removed = [f"− {EFFECTS[name].words}" for name in before if name not in tried]
    added = [f"+ {EFFECTS[name].words}" for name in tried if name not in before]
    return "; ".join([*removed, *added]) or "same effects"

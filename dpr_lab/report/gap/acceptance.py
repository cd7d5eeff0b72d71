"""Format results of `dpr-lab accept` as tables and sentences, for the terminal and the report."""

import math

from dpr_lab.acceptance.judge import Acceptance
from dpr_lab.effects import EFFECTS
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.shown import listed

RULE = (
    "Equivalence tests at 95 %. A limit passes if the 90 % interval lies inside the limit, and fails if the"
    " interval lies outside. Otherwise it is not decidable with these recordings."
)


def answer_sentence(acceptance: Acceptance) -> str:
    """Return the overall result and the number of limits that pass, without a full stop."""
    passed = sum(limit.answer == "pass" for limit in acceptance.limits)
    return f"{acceptance.answer}: {passed} of {len(acceptance.limits)} limits pass"


@page_table("quantity", "limits", "90 % interval", "unit", "answer", "reason", style="prose")
def limit_table(acceptance: Acceptance) -> Rows:
    """Return the rows of the table, in the order of the limits file."""
    return [
        (
            limit.quantity,
            _range(limit.lower, limit.upper),
            _range(*(limit.interval90 or (None, None))),
            limit.unit,
            limit.answer,
            limit.reason,
        )
        for limit in acceptance.limits
    ]


def limit_note(acceptance: Acceptance) -> str:
    """Explain intervals of positive sizes that extend below zero; empty without such intervals."""
    positive = {
        f"{name}.{p.name}" for name, effect in EFFECTS.items() for p in effect.amplitudes if p.sign == "positive"
    }
    if not any(
        limit.interval90 and limit.interval90[0] < 0 and limit.quantity in positive for limit in acceptance.limits
    ):
        return ""
    return (
        "Limits of effects apply to absolute values. The interval of a size that cannot be negative, such as friction,"
        " extends below zero if it is that of a linear estimate without a sign: the recordings do not exclude zero."
    )


def deciding_sentence(acceptance: Acceptance) -> str:
    """Introduce the releases that should decide the remaining limits.

    The sentence is empty if there are no such releases.
    """
    if not acceptance.would_decide:
        return ""
    return f"These releases are expected to decide {listed(acceptance.would_decide)}:"


def _range(low: float | None, high: float | None) -> str:
    if low is None:
        return "none" if high is None else f"below {high:.4g}"
    if high is None:
        return f"above {low:.4g}"
    size, width = max(abs(low), abs(high)), high - low
    digits = 4 if not 0 < width < size else max(4, 2 - math.floor(math.log10(width / size)))
    return f"{low:.{digits}g} to {high:.{digits}g}"

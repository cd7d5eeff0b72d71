"""Create the tables of blind trials as rows of text."""

from collections.abc import Mapping, Sequence
from typing import Any

from dpr_lab.report.digits import NONE, three
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import named

Summary = Mapping[str, Any]


SHARES = {
    "first": "first cause correct",
    "top3": "correct cause among the first three",
    "exact": "all causes correct, no other cause named",
    "invented": "absent cause named",
    "false_alarms": "false alarms without a hidden effect",
    "unexplained_recall": "unknown cause reported",
    "wrong_name": "incorrect cause with a probability above 0.5",
    "faults_missed": "encoder fault missed",
}
NUMBERS = {
    "calibration_error": "expected calibration error",
    "brier": "Brier score",
    "size_error": "size error, median",
    "size_error_p90": "size error, 90th percentile",
    "interval_coverage": "coverage of 90 % intervals of sizes",
    "gap_closed": "gap reduction on held-out data, median",
    "seconds": "time per diagnosis on one core, median (s)",
    "seconds_p90": "time per diagnosis, 90th percentile (s)",
    "seconds_max": "time per diagnosis, maximum (s)",
}


@page_table("score", "value", "90 % interval", "basis")
def score_table(summary: Summary) -> Rows:
    """Return one row for each score; shares without trials are omitted."""
    shares = [
        (label, percent(summary[name]), _interval(summary["interval90"][name]), f"{summary['of'][name]} trials")
        for name, label in SHARES.items()
        if summary["of"][name]
    ]
    return shares + [(label, number(summary[name]), NONE, NONE) for name, label in NUMBERS.items()]


@page_table(
    "kind", "size", "trials", "first cause correct", "all causes correct", "false alarms", "unknown cause reported"
)
def kind_table(summary: Summary) -> Rows:
    """Return one row for each kind of plant."""
    shares = ("first", "exact", "false_alarms", "unexplained_recall")
    return [
        (row["kind"], row["level"], str(row["trials"]), *(percent(row[name]) for name in shares))
        for row in summary["by_kind"]
    ]


@page_table("size / minimum detectable size", "effects", "named", "first cause correct", "all causes correct")
def size_table(summary: Summary) -> Rows:
    """Return one row for each range of sizes."""
    return [
        (size_range(row), str(row["effects"]), *(percent(row[name]) for name in ("named", "first", "exact")))
        for row in summary["by_size"]
    ]


@page_table(
    "effect",
    "trials",
    "named",
    "first cause correct",
    "all causes correct",
    "size error, median",
    "size error, 90th percentile",
    "coverage of 90 % intervals",
)
def effect_table(summary: Summary) -> Rows:
    """Return one row for each hidden effect."""
    shares, errors = ("named", "first", "exact"), ("size_error", "size_error_p90")
    return [
        (
            named(row["effect"]),
            str(row["trials"]),
            *(percent(row[name]) for name in shares),
            *(percent(row[name]) for name in errors),
            percent(row["interval_coverage"]),
        )
        for row in summary["by_effect"]
    ]


@page_table("claims", "stated probability", "observed frequency", "90 % interval")
def claim_table(summary: Summary) -> Rows:
    """Return one row for each range of stated probabilities, with the observed frequency."""
    return [
        (
            f"{row['claims']:.0f}",
            percent(row["stated"]),
            percent(row["true"]),
            _interval((row["low"], row["high"])),
        )
        for row in summary["reliability"]
    ]


@page_table(
    "kind",
    "seed",
    "hidden effects",
    "named effects",
    "verdict",
    "grade",
    caption="Trials with an incorrect result; kind and seed reproduce the plant.",
    style="prose",
)
def failed_table(summary: Summary) -> Rows:
    """Return one row for each trial with an incorrect result."""
    return [
        (
            f"{row['kind']}:{row['level']}",
            str(row["seed"]),
            _names(row["truth"]),
            _names(row["named"]),
            row["verdict"].replace("_", " "),
            row["grade"],
        )
        for row in summary["astray"]
    ]


def size_range(row: Mapping[str, Any]) -> str:
    """Format a range of sizes."""
    return f"{row['from']:g} to {row['to']:g}" if row["to"] is not None else f"{row['from']:g} and more"


def percent(share: float | None) -> str:
    """Format a share in per cent, or a missing share as a dash."""
    return NONE if share is None or share != share else f"{100 * share:.3g} %"


def number(value: float | None) -> str:
    """Format a number, or a missing number as a dash."""
    return NONE if value is None else three(value)


def _interval(bounds: Sequence[float] | None) -> str:
    return NONE if bounds is None else f"{percent(bounds[0])} to {percent(bounds[1])}"


def _names(names: Sequence[str]) -> str:
    return ", ".join(map(named, names)) or "none"

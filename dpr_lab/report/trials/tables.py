"""The summary of blind trials as rows of text."""

from collections.abc import Mapping, Sequence
from typing import Any

from dpr_lab.report.digits import NONE, three
from dpr_lab.report.words import named

Summary = Mapping[str, Any]

SCORE_COLUMNS = ("what", "value", "90 % interval", "of")
KIND_COLUMNS = ("hidden", "size", "trials", "first name right", "exactly the causes", "false alarms", "admitted")
SIZE_COLUMNS = ("size over the detectable limit", "effects", "named", "first name right", "exactly the causes")
EFFECT_COLUMNS = (
    "effect",
    "trials",
    "named",
    "first name right",
    "exactly the causes",
    "size error, median",
    "90th percentile",
    "90 % intervals that hold the truth",
)
CLAIM_COLUMNS = ("claims", "probability stated", "share that held", "90 % interval")
ASTRAY_COLUMNS = ("hidden", "seed", "there was", "the diagnosis said", "verdict", "")

SHARES = {
    "first": "first name right",
    "top3": "a right name among the first three",
    "exact": "exactly the causes named",
    "invented": "a cause invented",
    "false_alarms": "false alarms where nothing was hidden",
    "unexplained_recall": "cause outside the library admitted",
    "wrong_name": "a wrong name above probability 0.5",
    "faults_missed": "an encoder fault not reported",
}
NUMBERS = {
    "calibration_error": "expected calibration error",
    "brier": "Brier score",
    "size_error": "size error, median",
    "size_error_p90": "size error, 90th percentile",
    "interval_coverage": "90 % intervals that hold the true size",
    "gap_closed": "gap closed on data not used, median",
    "seconds": "seconds a diagnosis on one core, median",
    "seconds_p90": "seconds a diagnosis, 90th percentile",
    "seconds_max": "seconds a diagnosis, longest",
}


def score_rows(summary: Summary) -> list[tuple[str, ...]]:
    """Every score of which there are trials."""
    shares = [
        (said, percent(summary[name]), _interval(summary["interval90"][name]), f"{summary['of'][name]} trials")
        for name, said in SHARES.items()
        if summary["of"][name]
    ]
    return shares + [(said, number(summary[name]), NONE, NONE) for name, said in NUMBERS.items()]


def kind_rows(summary: Summary) -> list[tuple[str, ...]]:
    """One row for each kind of plant."""
    shares = ("first", "exact", "false_alarms", "unexplained_recall")
    return [
        (row["kind"], row["level"], str(row["trials"]), *(percent(row[name]) for name in shares))
        for row in summary["by_kind"]
    ]


def size_rows(summary: Summary) -> list[tuple[str, ...]]:
    """One row for each range of sizes."""
    return [
        (size_range(row), str(row["effects"]), *(percent(row[name]) for name in ("named", "first", "exact")))
        for row in summary["by_size"]
    ]


def effect_rows(summary: Summary) -> list[tuple[str, ...]]:
    """One row for each effect that was hidden."""
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


def claim_rows(summary: Summary) -> list[tuple[str, ...]]:
    """The reliability table."""
    return [
        (
            f"{row['claims']:.0f}",
            percent(row["stated"]),
            percent(row["true"]),
            _interval((row["low"], row["high"])),
        )
        for row in summary["reliability"]
    ]


def astray_rows(summary: Summary) -> list[tuple[str, ...]]:
    """Every trial that did not go right."""
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
    """A range of sizes, in words."""
    return f"{row['from']:g} to {row['to']:g}" if row["to"] is not None else f"{row['from']:g} and more"


def percent(share: float | None) -> str:
    """A share for reading; a dash where there is none."""
    return NONE if share is None or share != share else f"{100 * share:.3g} %"


def number(value: float | None) -> str:
    """A number for reading; a dash where there is none."""
    return NONE if value is None else three(value)


def _interval(bounds: Sequence[float] | None) -> str:
    return NONE if bounds is None else f"{percent(bounds[0])} to {percent(bounds[1])}"


def _names(names: Sequence[str]) -> str:
    return ", ".join(map(named, names)) or "nothing"

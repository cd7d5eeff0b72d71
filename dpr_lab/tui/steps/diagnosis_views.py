"""Details of a diagnosis on the screen: causes, gap reduction, and next steps."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from dpr_lab.report.angles import AngleUnit
from dpr_lab.shown import percent
from dpr_lab.tui.texts import Bars, report_table, sentences, table

if TYPE_CHECKING:
    from dpr_lab.gap.result.diagnosis import Diagnosis


def which_view(diagnosis: "Diagnosis", unit: AngleUnit) -> Group:
    """Draw the named effects, their alternatives, and the sensor faults.

    Each named effect is shown with its probability and its indistinguishable effects.
    """
    from dpr_lab.report.gap import findings
    from dpr_lab.report.gap import tables as gap_tables
    from dpr_lab.report.words import in_words

    others = {name: p for name, p in diagnosis.probabilities.items() if name in ("no_gap", "unexplained")}
    shown: list[RenderableType] = [_effect(row) for row in gap_tables.effect_table(diagnosis, unit).rows] or [
        "No effect is named.\n"
    ]
    shown.append("  ".join(f"{name.replace('_', ' ')}: {percent(p)}" for name, p in others.items()))
    shown += [in_words(note) for note in diagnosis.notes]
    if common := gap_tables.common_table(diagnosis, unit):
        shown += ["", report_table("Fit of the common effects alone", common)]
    if alternatives := gap_tables.standing_table(diagnosis):
        shown += ["", report_table("Alternatives", alternatives), Text(alternatives.caption, "dim")]
    if faults := findings.finding_table(diagnosis):
        shown += ["", report_table("Sensor faults", faults)]
    return Group(*shown)


def _effect(row: Sequence[str]) -> Group:
    """Draw a named effect with probability, class, and size with 90 % intervals."""
    from dpr_lab.report.gap import tables as gap_tables

    name, twins, probability, share, parameters = row
    figures = f": probability {probability}, unique contribution {share}"
    below = [f"indistinguishable from: {twins}"] if twins != gap_tables.ALONE else []
    below.append(f"size, 90 % interval: {parameters}")
    return Group(Text(name, "bold").append(figures, "not bold"), *map(_indented, below), "")


def _indented(line: str) -> Padding:
    return Padding(Text(line), (0, 0, 0, 4))


def far_view(diagnosis: "Diagnosis", unit: AngleUnit) -> Group:
    """Draw the gap after each added effect, and its reduction on held-out data."""
    from dpr_lab.report.digits import three
    from dpr_lab.report.gap import tables as gap_tables
    from dpr_lab.report.gap.summary import repeatability_parts, repeatability_sentences

    words = gap_tables.run_words
    gap, closed, per_rad = diagnosis.gap, diagnosis.gap.closed_held_out, unit.small_per_rad
    floor = per_rad * gap_tables.per_reading(gap, "floor_rad")
    steps = [
        (name, per_rad * left, None, f"{gap}, {explained}")
        for (name, left), (_, gap, explained) in zip(
            gap_tables.steps(diagnosis), gap_tables.step_table(diagnosis, unit).rows, strict=True
        )
    ]
    shares = [
        ("all runs", closed.estimate, closed.interval90),
        *((words(run), s, None) for run, s in closed.per_run.items()),
    ]
    shares += [(words(run, held_out=True), share, None) for run, share in closed.held_out.items()]
    low, high = closed.interval90
    closing = [
        f"\nOn held-out data {percent(closed.estimate, 1)} of the gap above the noise closes (90 %"
        f" interval {percent(low, 1)} to {percent(high, 1)})",
        Bars([(name, max(share, 0.0), interval, percent(share, 1)) for name, share, interval in shares], top=1.0),
    ]
    if not gap.waterfall:
        reason = "There is no gap" if diagnosis.verdict == "no_gap" else "No effect is named"
        closing = [f"\n{reason}, so there is no gap reduction"]
    if parts := repeatability_parts(diagnosis):
        closing += [
            f"\nShares of the mean squared residual. {' '.join(repeatability_sentences(diagnosis))}",
            Bars([(label, share, None, percent(share, 1)) for label, share in parts], top=1.0),
        ]
    closed_runs = gap_tables.closed_table(diagnosis, unit)
    return Group(
        f"Gap per reading ({unit.small} rms, segments of 0.5 s) and share of the excess explained, as effects are"
        f" added. The gap is the residual above the noise floor of {three(floor)} {unit.small}",
        Bars(steps),
        *closing,
        "",
        table("Free runs from the release", unit.heads(closed_runs.columns), closed_runs.rows),
    )


def next_view(diagnosis: "Diagnosis", unit: AngleUnit, file: str = "DIAGNOSIS.json") -> Group:
    """Draw the recommendations, the checks, the minimum detectable effects, and the assumptions.

    Args:
        diagnosis: the diagnosis
        unit: unit of angles
        file: file of the diagnosis, for the command that records the result of a check
    """
    from dpr_lab.report.gap import check_tables
    from dpr_lab.report.gap import tables as gap_tables
    from dpr_lab.report.gap.next_steps import next_steps
    from dpr_lab.report.words import in_words

    checks, below = check_tables.check_table(diagnosis), list[RenderableType]()
    informative = check_tables.informative(diagnosis.checks)
    if informative:
        below.append(Text(checks.title, "bold"))
    for row in checks.rows if informative else ():  # one block per check: a table needs more than 80 columns
        cells = zip(checks.columns[1:], row[1:], strict=True)
        below += [Text(f"check {row[0]}"), *(_indented(f"{column}: {cell}") for column, cell in cells)]
    if informative:
        below += [Text(checks.caption, "dim"), Text(check_tables.how_to_record(diagnosis, file)), ""]
    return Group(
        sentences("Recommended actions", [in_words(text) for text in diagnosis.remedies]),
        sentences("Next recordings and checks", next_steps(diagnosis), numbered=True),
        *below,
        report_table("Minimum detectable effects", gap_tables.detectable_table(diagnosis, unit)),
        sentences("Assumptions", [in_words(text) for text in diagnosis.assumptions]),
    )

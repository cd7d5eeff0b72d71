"""Write the HTML report of blind trials: scores, confusion matrix, calibration and detection rates."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from dpr_lab.report.pages.page import Items, Section, page_html, pictures, write_page
from dpr_lab.report.trials import tables
from dpr_lab.report.trials.tables import Summary

FIGURES = {
    "by_size": (
        "Bar chart of the detection rate of hidden effects, by the ratio of size to minimum detectable size.",
        "Share of the hidden effects that were named, by multiples of the minimum detectable size of the diagnosis.",
    ),
    "confusion": (
        "Confusion matrix of hidden and first named effects; the list of incorrect results contains its values.",
        "Rows: hidden effect (the largest of several). Columns: first named effect, or the verdict if no"
        " effect was named. Shade: share of the row.",
    ),
    "reliability": (
        "Line chart of the observed frequency against the stated probability; the table contains its values.",
        "Share of correct claims among the claims with a stated probability. Dotted line: perfect calibration.",
    ),
}
"""Text alternative and caption of each figure."""


def write_trials_report(
    summary: Summary, setting: str, failures: Sequence[str], out_dir: Path, figures: Mapping[str, Path]
) -> Path:
    """Write `trials.html`.

    Args:
        summary: scores, as in `summary.json`
        setting: description of the campaign in one sentence
        failures: one sentence for each trial that ended with an error
        out_dir: folder of the page
        figures: figures by name, from `save_trial_figures`

    Raises:
        DprError: the page cannot be written.
    """
    drawn = pictures(figures, FIGURES)
    sections = [
        Section("Trials with errors", [Items(failures)], is_open=True),
        Section("Scores", [tables.score_table(summary)], is_open=True),
        Section("Scores by kind of plant", [tables.kind_table(summary)]),
        Section("Detection rate", [drawn["by_size"], tables.size_table(summary)]),
        Section("Confusion matrix", [drawn["confusion"], tables.failed_table(summary) or "All results were correct."]),
        Section("Calibration", [drawn["reliability"], tables.claim_table(summary)]),
        Section("Scores by effect", [tables.effect_table(summary)]),
    ]
    note = f"{setting} Every plant was sealed before it was recorded and revealed after its diagnosis."
    page = page_html("Blind trials of the diagnosis", sentence(summary), sections, lead=[note])
    return write_page(page, out_dir / "trials.html")


def sentence(summary: Summary) -> str:
    """Summarise the scores of the campaign in at most three sentences."""
    trials = f"{summary['trials']} trials."
    false_alarms = f"False alarms: {tables.percent(summary['false_alarms'])}."
    if not summary["of"]["first"]:
        return f"{trials} {false_alarms}"
    low, high = summary["interval90"]["first"]
    return (
        f"{trials} If the cause is in the library, the first named effect is correct in"
        f" {tables.percent(summary['first'])} (90 % interval {tables.percent(low)} to {tables.percent(high)}), and the"
        f" named effects are exactly the causes in {tables.percent(summary['exact'])}. {false_alarms}"
    )

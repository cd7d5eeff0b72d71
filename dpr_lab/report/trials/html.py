"""One HTML page of blind trials: scores, what was taken for what, what a probability and an interval are worth."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dpr_lab.report.page import (
    figures_html,
    list_html,
    page_html,
    paragraph_html,
    section_html,
    table_html,
    write_page,
)
from dpr_lab.report.trials import tables

Summary = Mapping[str, Any]

FIGURES = {
    "by_size": (
        "Bar chart of the share of hidden effects that were named, by size over the detectable limit.",
        "How often an effect is named, by how many times the least size that the diagnosis says it could see.",
    ),
    "confusion": (
        "Matrix of what was hidden against what was named first; its numbers stand in the list of trials astray.",
        "Rows: what was hidden, the largest effect where there were several. Columns: what was named first, or the "
        "verdict where nothing was. Shade: share of the row.",
    ),
    "reliability": (
        "Line chart of the share of claims that held over the probability stated; its numbers stand in the table.",
        "Of all claims made with a probability, how many held. On the dotted line a probability says what it means.",
    ),
}


def write_trials_report(
    summary: Summary, setting: str, failures: Sequence[str], out_dir: Path, figures: Mapping[str, Path]
) -> Path:
    """Write `trials.html`.

    Args:
        summary: scores, as `summary.json` holds them
        setting: what was tried, in a sentence
        failures: trials that ended in an error, a sentence each
        out_dir: folder of the page
        figures: what `save_trial_figures` returned

    Raises:
        DprError: the page cannot be written.
    """
    drawn = figures_html(figures, FIGURES)
    sections = [
        paragraph_html(f"{setting} Every plant was sealed before it was recorded and opened after its diagnosis."),
        section_html("Trials that ended in an error", list_html(failures)) if failures else "",
        section_html("Scores", table_html(tables.SCORE_COLUMNS, tables.score_rows(summary))),
        section_html("By what was hidden", table_html(tables.KIND_COLUMNS, tables.kind_rows(summary))),
        section_html("How small", drawn["by_size"], table_html(tables.SIZE_COLUMNS, tables.size_rows(summary))),
        section_html("What was taken for what", drawn["confusion"], _astray(summary)),
        section_html(
            "What a probability is worth",
            drawn["reliability"],
            table_html(tables.CLAIM_COLUMNS, tables.claim_rows(summary)),
        ),
        section_html("By effect", table_html(tables.EFFECT_COLUMNS, tables.effect_rows(summary))),
    ]
    page = page_html("Blind trials of the diagnosis", sentence(summary), sections)
    return write_page(page, out_dir / "trials.html")


def sentence(summary: Summary) -> str:
    """The campaign in a sentence."""
    counted = f"{summary['trials']} trials"
    if not summary["of"]["first"]:
        return f"{counted}; false alarms: {tables.percent(summary['false_alarms'])}."
    low, high = summary["interval90"]["first"]
    return (
        f"{counted}: where the library holds the cause, the first name is right in {tables.percent(summary['first'])}"
        f" (90 % interval {tables.percent(low)} to {tables.percent(high)}), all causes and nothing else are named in"
        f" {tables.percent(summary['exact'])}; false alarms: {tables.percent(summary['false_alarms'])}."
    )


def _astray(summary: Summary) -> str:
    if not summary["astray"]:
        return paragraph_html("No trial went astray.")
    caption = "Every trial that did not go right; kind and seed draw it again."
    return table_html(tables.ASTRAY_COLUMNS, tables.astray_rows(summary), caption, style="prose")

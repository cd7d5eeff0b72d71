"""One HTML page of blind trials: scores, what was taken for what, what a probability and an interval are worth."""

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from dpr_lab.report import trials_tables as tables
from dpr_lab.report.figures import write_to
from dpr_lab.report.html import figure_html, table_html

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
    path = out_dir / "trials.html"
    page = _page(summary, setting, failures, figures)
    write_to(path, lambda file: file.write_bytes(page.encode("utf-8", "replace")))
    return path


def _page(summary: Summary, setting: str, failures: Sequence[str], figures: Mapping[str, Path]) -> str:
    title = "Blind trials of the diagnosis"
    template = files("dpr_lab.report").joinpath("template.html").read_text(encoding="utf-8")
    drawn = {name: figure_html(name, path, *FIGURES[name]) for name, path in figures.items()}
    sections = [
        f'<header>\n<h1>{title}</h1>\n<p class="summary">{escape(sentence(summary))}</p>\n</header>\n<main>',
        f"<p>{escape(setting)} Every plant was sealed before it was recorded and opened after its diagnosis.</p>",
        _section("Trials that ended in an error", _list(failures)) if failures else "",
        _section("Scores", table_html(tables.SCORE_COLUMNS, tables.score_rows(summary))),
        _section("By what was hidden", table_html(tables.KIND_COLUMNS, tables.kind_rows(summary))),
        _section("How small", drawn["by_size"] + table_html(tables.SIZE_COLUMNS, tables.size_rows(summary))),
        _section("What was taken for what", drawn["confusion"] + _astray(summary)),
        _section(
            "What a probability is worth",
            drawn["reliability"] + table_html(tables.CLAIM_COLUMNS, tables.claim_rows(summary)),
        ),
        _section("By effect", table_html(tables.EFFECT_COLUMNS, tables.effect_rows(summary))),
    ]
    head = template.split("<body>")[0].replace("$title", title)
    return head + "<body>\n" + "\n".join(sections) + "\n</main>\n</body>\n</html>\n"


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
        return "<p>No trial went astray.</p>"
    caption = "Every trial that did not go right; kind and seed draw it again."
    return table_html(tables.ASTRAY_COLUMNS, tables.astray_rows(summary), caption, style="prose")


def _section(title: str, body: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}\n</section>"


def _list(sentences: Sequence[str]) -> str:
    return "<ul>\n" + "\n".join(f"<li>{escape(item)}</li>" for item in sentences) + "\n</ul>"

"""One HTML page of a diagnosis: verdict, where, which, how sure, how far, what next, and every assumption."""

from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.report import gap_tables
from dpr_lab.report.figures import write_to
from dpr_lab.report.html import figure_html, table_html

FIGURES = {
    "where": (
        "Line charts of torque or encoder error over joint angle, speed, time or load.",
        "Torque or encoder error that would explain the gap, 90 % intervals, ratios and start states projected out.",
    ),
    "waterfall": (
        "Bar chart of the gap left after each named effect.",
        "The gap above the noise as effects are added one at a time, the most telling first.",
    ),
    "gap_horizon": (
        "Line chart of the gap before and after over the horizon.",
        "The gap above the noise against how long a segment with a free start state runs.",
    ),
}


def write_gap_report(diagnosis: Diagnosis, title: str, out_dir: Path, figures: Mapping[str, Path]) -> Path:
    """Write `diagnosis.html`.

    Args:
        diagnosis: the result
        title: heading of the page
        out_dir: folder of the page
        figures: what `save_gap_figures` returned

    Raises:
        DprError: the page cannot be written.
    """
    path = out_dir / "diagnosis.html"
    page = _page(diagnosis, title, figures)
    write_to(path, lambda file: file.write_bytes(page.encode("utf-8", "replace")))
    return path


def _page(diagnosis: Diagnosis, title: str, figures: Mapping[str, Path]) -> str:
    template = files("dpr_lab.report").joinpath("template.html").read_text(encoding="utf-8")
    head = template.split("<body>")[0].replace("$title", escape(title))
    drawn = {name: figure_html(name, path, *FIGURES[name]) for name, path in figures.items()}
    sections = [
        f'<header>\n<h1>{escape(title)}</h1>\n<p class="summary">{escape(diagnosis.sentence)}</p>\n</header>\n<main>',
        _section("Which effects", _effects(diagnosis)),
        _section("Where", f"<p>{escape(diagnosis.where_sentence)}</p>{_places(diagnosis)}{drawn.get('where', '')}"),
        _section(
            "How far the gap closes", _closed(diagnosis) + drawn.get("waterfall", "") + drawn.get("gap_horizon", "")
        ),
        _section("What to do next", _list(diagnosis.advice) or "<p>Nothing is open.</p>"),
        _section(
            "Sensors", _rows(gap_tables.FINDING_COLUMNS, gap_tables.finding_rows(diagnosis), "No fault was found.")
        ),
        _section(
            "What these recordings would show",
            table_html(gap_tables.DETECTABLE_COLUMNS, gap_tables.detectable_rows(diagnosis), style="prose"),
        ),
        _section("Assumptions", _list(diagnosis.assumptions)),
    ]
    return head + "<body>\n" + "\n".join(sections) + "\n</main>\n</body>\n</html>\n"


def _section(title: str, body: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}\n</section>"


def _list(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    return "<ul>\n" + "\n".join(f"<li>{escape(sentence)}</li>" for sentence in sentences) + "\n</ul>"


def _rows(columns: Sequence[str], rows: Sequence[Sequence[str]], nothing: str) -> str:
    return table_html(columns, rows, style="prose") if rows else f"<p>{escape(nothing)}</p>"


def _effects(diagnosis: Diagnosis) -> str:
    named = _rows(gap_tables.EFFECT_COLUMNS, gap_tables.effect_rows(diagnosis), "No effect is named.")
    return named + _rows(gap_tables.RIVAL_COLUMNS, gap_tables.rival_rows(diagnosis), "There is no rival.")


def _places(diagnosis: Diagnosis) -> str:
    return _rows(gap_tables.PLACE_COLUMNS, gap_tables.place_rows(diagnosis), "")


def _closed(diagnosis: Diagnosis) -> str:
    share = diagnosis.gap.closed_held_out
    low, high = share.interval90
    said = (
        f"<p>On releases that took no part in the fit {share.estimate:.1%} of the gap above the noise closes"
        f" (90 % interval {low:.1%} to {high:.1%}).</p>"
    )
    return said + _rows(gap_tables.CLOSED_COLUMNS, gap_tables.closed_rows(diagnosis), "")

"""One HTML page of a diagnosis: verdict, which, how sure, what next, how far, where, and every assumption."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap import tables
from dpr_lab.report.gap.section import evidence_html, evidence_parts
from dpr_lab.report.gap.sections import SECTIONS
from dpr_lab.report.gap.sections.closing import CLOSING
from dpr_lab.report.gap.sizes import scale_note
from dpr_lab.report.page import (
    details_html,
    figures_html,
    list_html,
    page_html,
    paragraph_html,
    section_html,
    table_html,
    write_page,
)
from dpr_lab.report.words import in_words

FIGURES = {
    "where": (
        "Line charts of torque or encoder error over joint angle, speed, time or load.",
        "Torque or encoder error that would explain the gap, 90 % intervals, ratios and start states projected out. A"
        " map that is one number, the same everywhere, is not drawn.",
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

_WHERE = (
    "Where the bare model would need a torque or an error of a reading, before anything was named. What a sensor does"
    " wrong looks like a torque there, and several places can make up for one cause: a place is a hint, and what is"
    " named above is the finding."
)
_LEFT_OUT = (
    "What was found of the readings before any physics. Outliers and repeated samples took no part in any fit; all of"
    " them stand in diagnosis.json."
)
_NONE_NAMED = paragraph_html("No effect is named.")


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
    drawn = figures_html(figures, FIGURES | {s.name: (s.alternative, s.caption) for s in SECTIONS})
    told = {section.name: evidence_html(section, diagnosis, drawn) for section in SECTIONS}
    closed = evidence_parts(CLOSING, diagnosis, drawn) if diagnosis.evidence else [drawn["waterfall"]]
    first = ("curves",)
    sections = [
        section_html("What to do", *_to_do(diagnosis)),
        section_html("Which effects", *_which(diagnosis)),
        *(told[name] for name in first),
        section_html("Checks that were done", *_done(diagnosis)) if diagnosis.checks_done else "",
        section_html(
            "How far the gap closes", *_closed(diagnosis), *closed, drawn["gap_horizon"], _horizons(diagnosis)
        ),
        section_html(
            "Where",
            paragraph_html(_WHERE),
            paragraph_html(in_words(diagnosis.where_sentence)),
            _places(diagnosis),
            drawn["where"],
            _folded("The maps in numbers", tables.MAP_COLUMNS, tables.map_rows(diagnosis)),
        ),
        section_html(
            "Sensors",
            _rows(tables.FINDING_COLUMNS, tables.finding_rows(diagnosis), _LEFT_OUT) or "<p>No fault was found.</p>",
        ),
        *(page for name, page in told.items() if name not in (*first, CLOSING.name)),
        section_html(
            "What these recordings would show",
            table_html(
                tables.DETECTABLE_COLUMNS, tables.detectable_rows(diagnosis), scale_note(diagnosis), style="prose"
            ),
        ),
        section_html("Assumptions", list_html([in_words(text) for text in diagnosis.assumptions])),
    ]
    return write_page(page_html(title, tables.sentence(diagnosis), sections), out_dir / "diagnosis.html")


def _to_do(diagnosis: Diagnosis) -> Iterator[str]:
    """What to do about what was named, then what is still to be decided."""
    if diagnosis.remedies:
        yield list_html([in_words(text) for text in diagnosis.remedies])
        yield "<h3>What to record or to check next</h3>"
    yield list_html(tables.next_steps(diagnosis), numbered=True)


def _which(diagnosis: Diagnosis) -> Iterator[str]:
    """The effects, how the gap falls with them, and what else each can be."""
    yield (
        _rows(
            tables.EFFECT_COLUMNS,
            tables.effect_rows(diagnosis),
            f"{tables.EFFECT_NOTE} {scale_note(diagnosis)}".strip(),
        )
        or _NONE_NAMED
    )
    if diagnosis.gap.waterfall:
        yield _rows(tables.STEP_COLUMNS, tables.step_rows(diagnosis), tables.STEP_NOTE)
    yield _rows(tables.STANDING_COLUMNS, tables.standing_rows(diagnosis), tables.STANDING_NOTE)


def _done(diagnosis: Diagnosis) -> Iterator[str]:
    """Probabilities before and after each check."""
    for done in diagnosis.checks_done:
        yield paragraph_html(f"{done.check.id}: {in_words(done.check.text)} {done.result}")
        yield _rows(tables.MOVED_COLUMNS, tables.moved_rows(done), tables.MOVED_NOTE)


def _closed(diagnosis: Diagnosis) -> Iterator[str]:
    yield paragraph_html(tables.closed_sentence(diagnosis))
    yield _rows(tables.CLOSED_COLUMNS, tables.closed_rows(diagnosis), tables.CLOSED_NOTE)


def _horizons(diagnosis: Diagnosis) -> str:
    return _folded("The horizons in numbers", tables.HORIZON_COLUMNS, tables.horizon_rows(diagnosis))


def _folded(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The numbers behind a figure; nothing where there are none."""
    return details_html(title, table_html(columns, rows)) if rows else ""


def _places(diagnosis: Diagnosis) -> str:
    return _rows(tables.PLACE_COLUMNS, tables.place_rows(diagnosis))


def _rows(columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> str:
    """A table of prose; nothing where it would be empty."""
    return table_html(columns, rows, note, style="prose") if rows else ""

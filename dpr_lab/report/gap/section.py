"""A section of the page: plain words, a figure with its table folded away behind it, and the symbols last."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.report.page import details_html, paragraph_html, section_html, table_html

Rows = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class PageSettings:
    """What of the evidence is drawn, and when it counts."""

    most_runs: int = 4
    """Whose curves are drawn; the figures of all stand in the tables of the budget."""
    every: int = 5
    """Of the points of a curve, that the table behind it holds."""
    rows_of: int = 2
    """Cells of a map that one row of its table holds, of 15 degrees each."""
    sharp: int = 8
    """Points along the edge of a cell of a map, by which its outline has corners."""
    least_mrad: float = 1e-4
    """Where the scale of the budget begins at the latest: nobody asks for less."""
    coverage_factor: float = 2.0
    """Of an expanded uncertainty of about 95 % (GUM, 6.2)."""
    sure: float = 0.95
    """Confidence from which an effect counts as excluded."""
    white95: float = 1.96
    """Standard deviations within which 95 % of what is normal lie."""


PAGE = PageSettings()


@dataclass(frozen=True, slots=True)
class FoldedTable:
    """A table behind a figure."""

    title: str
    columns: tuple[str, ...]
    rows: Callable[[Diagnosis], Rows]
    note: str = ""
    style: str = "prose"


@dataclass(frozen=True, slots=True)
class EvidenceSection:
    """What a diagnosis with evidence says on one matter; every function is given one that has some."""

    name: str
    """Of its figure and of its place on the page."""
    title: str
    words: Callable[[Diagnosis], Sequence[str]]
    """Sentences for everybody."""
    tables: tuple[FoldedTable, ...]
    figure: Callable[[Diagnosis], Figure | None] | None = None
    alternative: str = ""
    """For readers who do not see the figure."""
    caption: str = ""
    symbols: str = ""
    """The same as the literature writes it, with the source."""


def evidence_of(diagnosis: Diagnosis) -> Evidence:
    """What a diagnosis rests on, where a section is made of it.

    Raises:
        ValueError: a diagnosis of an older version, without any.
    """
    if diagnosis.evidence is None:
        raise ValueError("this diagnosis holds no evidence")
    return diagnosis.evidence


def evidence_html(section: EvidenceSection, diagnosis: Diagnosis, drawn: Mapping[str, str]) -> str:
    """The section; nothing where the diagnosis has no evidence.

    Args:
        section: which
        diagnosis: the result
        drawn: figures by name
    """
    if diagnosis.evidence is None:
        return ""
    return section_html(section.title, *evidence_parts(section, diagnosis, drawn))


def evidence_parts(section: EvidenceSection, diagnosis: Diagnosis, drawn: Mapping[str, str]) -> list[str]:
    """Its parts, for a page that has more to say under the same heading."""
    behind = [
        details_html(table.title, table_html(table.columns, rows, table.note, style=table.style))
        for table in section.tables
        if (rows := table.rows(diagnosis))
    ]
    return [
        *map(paragraph_html, section.words(diagnosis)),
        drawn.get(section.name, ""),
        *behind,
        paragraph_html(section.symbols, style="soft"),
    ]

"""A section of the report that shows evidence: sentences, a figure with its folded table, and the equations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.report.pages.page import Block, PageTable, Paragraph, Picture

Rows = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class PageSettings:
    """Sizes of figures and tables, and thresholds of statements."""

    most_runs: int = 4
    """Maximum number of runs in the figure of curves; the table of the budget lists all."""
    every: int = 5
    """Interval of the points of a curve in its table."""
    rows_of: int = 2
    """Cells of a map, 15 degrees each, per row of its table."""
    sharp: int = 8
    """Points along the edge of a map cell, so that its outline has corners."""
    least_mrad: float = 1e-4
    """Upper limit of the lower end of the budget's logarithmic scale, mrad."""
    coverage_factor: float = 2.0
    """Coverage factor of an expanded uncertainty of about 95 % (GUM, 6.2)."""
    white95: float = 1.96
    """Standard deviations that contain 95 % of a normal distribution."""


PAGE = PageSettings()


@dataclass(frozen=True, slots=True)
class FoldedTable:
    """Values of a figure, as a folded table."""

    title: str
    columns: tuple[str, ...]
    rows: Callable[[Diagnosis], Rows]
    note: str = ""
    style: str = "prose"


@dataclass(frozen=True, slots=True)
class EvidenceSection:
    """One topic of a diagnosis; all functions require a diagnosis with evidence."""

    name: str
    """Name of its figure."""
    title: str
    """Heading of the section."""
    words: Callable[[Diagnosis], Sequence[str]]
    """Sentences of the section."""
    tables: tuple[FoldedTable, ...]
    """Folded tables."""
    figure: Callable[[Diagnosis], Figure | None] | None = None
    """Draws the figure; None: the section has none."""
    alternative: str = ""
    """Text alternative of the figure."""
    caption: str = ""
    """Caption of the figure."""
    symbols: str = ""
    """Equations with their source."""


def evidence_of(diagnosis: Diagnosis) -> Evidence:
    """Return the evidence of a diagnosis.

    Raises:
        ValueError: the diagnosis is of an older version, without evidence.
    """
    if diagnosis.evidence is None:
        raise ValueError("this diagnosis contains no evidence")
    return diagnosis.evidence


def evidence_blocks(section: EvidenceSection, diagnosis: Diagnosis, drawn: Mapping[str, Picture]) -> list[Block | None]:
    """Blocks of a section: sentences, figure, folded tables, equations.

    Args:
        section: the section
        diagnosis: a diagnosis with evidence
        drawn: figures by name
    """
    tables = [
        PageTable(evidence.columns, evidence.rows(diagnosis), evidence.note, evidence.style, evidence.title)
        for evidence in section.tables
    ]
    has_symbols = section.symbols and any(table.rows for table in tables)
    return [
        *section.words(diagnosis),
        drawn.get(section.name),
        *tables,
        Paragraph(section.symbols, "soft") if has_symbols else None,
    ]

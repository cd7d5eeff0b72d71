"""Define report sections that show the evidence.

A section contains sentences, a figure, folded tables and equations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence
from dpr_lab.report.pages.page import Block, PageTable, Paragraph, Picture


@dataclass(frozen=True, slots=True)
class PageSettings:
    """Sizes of figures and tables of the evidence, and thresholds of the sentences."""

    most_runs: int = 4
    """Maximum number of runs in the figure of curves. The table of the budget contains all runs."""
    every: int = 5
    """Step between the points of a curve that its table contains."""
    rows_of: int = 2
    """Number of cells of a map, 15 degrees each, per row of its table."""
    sharp: int = 8
    """Number of points along the edge of a map cell; enough for sharp corners of its outline."""
    least_mrad: float = 1e-4
    """Minimum value at which the logarithmic axis of the budget begins, mrad."""
    white95: float = 1.96
    """Half width of the interval that contains 95 % of a normal distribution, in standard deviations."""


PAGE = PageSettings()


@dataclass(frozen=True, slots=True)
class EvidenceSection:
    """Report section on one topic of a diagnosis.

    All functions of a section require a diagnosis with evidence.
    """

    name: str
    """Name of the section and of its figure."""
    title: str
    """Heading of the section."""
    words: Callable[[Diagnosis], Sequence[str]]
    """Sentences of the section."""
    tables: tuple[Callable[[Diagnosis], PageTable], ...]
    """Folded tables of the section."""
    figure: Callable[[Diagnosis], Figure | None] | None = None
    """Function that draws the figure, or returns None if nothing can be drawn; None if the section has no figure."""
    alternative: str = ""
    """Text alternative of the figure."""
    caption: str = ""
    """Caption of the figure."""
    symbols: str = ""
    """Equations below the tables, with their source."""


def evidence_of(diagnosis: Diagnosis) -> Evidence:
    """Return the evidence of a diagnosis.

    Raises:
        ValueError: the diagnosis was written by an older version, without evidence.
    """
    if diagnosis.evidence is None:
        raise ValueError("this diagnosis contains no evidence sections")
    return diagnosis.evidence


def evidence_blocks(section: EvidenceSection, diagnosis: Diagnosis, drawn: Mapping[str, Picture]) -> list[Block | None]:
    """Return the blocks of a section: sentences, figure, folded tables, symbols.

    Args:
        section: the section
        diagnosis: a diagnosis with evidence
        drawn: figures by name
    """
    tables = [table(diagnosis) for table in section.tables]
    return [
        *section.words(diagnosis),
        drawn.get(section.name),
        *tables,
        Paragraph(section.symbols, "soft") if section.symbols and any(tables) else None,
    ]

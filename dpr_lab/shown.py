"""Results that a person reads at a prompt: a heading and a table, as text and as a notebook's HTML."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from html import escape

Row = Sequence[str]

FIXED_BY = {"data": "the recordings", "measured": "a measured value", "bound": "only its bounds"}
"""What fixed a number: as files say it, and as people read it."""


class Shown(ABC):
    """A result that prints itself as a heading and a table."""

    __slots__ = ()

    @abstractmethod
    def _heading(self) -> str:
        """One line."""

    def _rows(self) -> Sequence[Row]:
        """The table, its first row the names of the columns; [] for none."""
        return []

    def __repr__(self) -> str:
        rows = [[str(cell) for cell in row] for row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
        return "\n".join([self._heading(), *(f"  {line}" for line in lines)])

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        rows = self._rows()
        head, body = rows[:1], rows[1:]
        table = "".join(_row(row, "th") for row in head) + "".join(_row(row, "td") for row in body)
        return f"<p>{escape(self._heading())}</p><table>{table}</table>"


def listed(names: Sequence[str]) -> str:
    """`a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _row(cells: Row, tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

"""Display of results at a prompt: a heading and a table, as text and as HTML in a notebook."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from html import escape

Row = Sequence[str]

FIXED_BY = {"data": "the recordings", "measured": "a measured value", "bound": "only its bounds"}
"""Origin of a number: key in files and text for readers."""


class Shown(ABC):
    """A result that is displayed as a heading and a table."""

    __slots__ = ()

    @abstractmethod
    def _heading(self) -> str:
        """Heading, one line."""

    def _rows(self) -> Sequence[Row]:
        """The table; its first row contains the column names; [] for none."""
        return []

    def __repr__(self) -> str:
        rows = [[str(cell) for cell in row] for row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
        return "\n".join([self._heading(), *(f"  {line}" for line in lines)])

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        rows = self._rows()
        head, body = rows[:1], rows[1:]
        table = "".join(_row(row, "th") for row in head) + "".join(_row(row, "td") for row in body)
        return f"<p>{escape(self._heading())}</p><table>{table}</table>"


def listed(names: Sequence[str]) -> str:
    """Text of a list: `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _row(cells: Row, tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

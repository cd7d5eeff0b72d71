"""Line breaks on the screen.

A number and its unit stay on one line, and continuation lines are indented to the start of the text.
"""

import re
from dataclasses import dataclass

from rich import _wrap
from textual.content import Content
from textual.css.styles import RulesMap
from textual.strip import Strip
from textual.style import Style
from textual.visual import RenderOptions, Visual

_ATOM = r"(?:[kMmµc]?(?:rad|Hz|Nm?|m|s|g|B)(?:[²³]|\^\d)?)"
_UNIT = rf"(?:[°%]|ppm|{_ATOM})(?:[ /]{_ATOM})*(?!\w)"
_WORD = re.compile(rf"\s*(?:\S*\d\)? {_UNIT}\S*|\S+)\s*")

_BEFORE = re.compile(r"(?: +|[a-z][a-z ]*? {2,})?(?:[•✔✘?■□] |\d+\. )?")
"""Pattern of the part of a line before its text: blanks, or a label in a column, and a mark or a number."""

NARROWEST = 16
"""Minimum width of the text, columns. If a label leaves less, continuation lines start at the left edge."""


def keep_units_whole() -> None:
    """Make Rich and Textual keep number and unit, such as `0.80 mN m`, together."""
    _wrap.re_word = _WORD


@dataclass(frozen=True, slots=True)
class Hanging(Visual):
    """Text whose continuation lines are indented to the start of the first line's text."""

    content: Content

    def __str__(self) -> str:
        return self.content.plain

    def render_strips(self, width: int, height: int | None, style: Style, options: RenderOptions) -> list[Strip]:
        """Render the wrapped text; required by the `Visual` interface of Textual."""
        return self._broken(width).render_strips(width, height, style, options)

    def get_optimal_width(self, rules: RulesMap, container_width: int) -> int:
        """Return the preferred width; required by the `Visual` interface of Textual."""
        return self.content.get_optimal_width(rules, container_width)

    def get_minimal_width(self, rules: RulesMap) -> int:
        """Return the minimum width; required by the `Visual` interface of Textual."""
        return self.content.get_minimal_width(rules)

    def get_height(self, rules: RulesMap, width: int) -> int:
        """Return the height of the text at a width (Textual interface `Visual`)."""
        return self._broken(width).get_height(rules, width)

    def _broken(self, width: int) -> Content:
        lines = self.content.split("\n", allow_blank=True)
        return Content("\n").join(part for line in lines for part in _hung(line, width))


def _hung(line: Content, width: int) -> list[Content]:
    """Wrap a line to a width, with indented continuation lines."""
    marker = _BEFORE.match(line.plain)
    indent = marker.end() if marker is not None else 0
    if line.cell_length <= width or width - indent < NARROWEST:
        return [line]
    first, *more = line[indent:].wrap(width - indent)
    return [line[:indent] + first, *(Content(" " * indent) + part for part in more)]

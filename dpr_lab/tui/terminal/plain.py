"""Removal of control characters from the output, so that no text can control the terminal."""

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from dpr_lab.errors import printable


class Plain(LineFilter):
    """Filter that replaces control characters by visible text and cuts the line to its width."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:
        """Remove the control characters of a line."""
        if all(text.isprintable() or printable(text) == text for text, _, _ in segments):
            return segments
        spelled = [Segment(printable(text), style, control) for text, style, control in segments]
        return Segment.adjust_line_length(spelled, sum(segment.cell_length for segment in segments), pad=False)

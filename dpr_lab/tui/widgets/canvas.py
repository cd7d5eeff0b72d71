"""A canvas of dots that can be drawn without colours too."""

from rich.segment import Segment
from rich.style import Style
from textual.strip import Strip
from textual_hires_canvas import Canvas


class PlainCanvas(Canvas):
    """A canvas whose every segment has a style, as Textual's filter for NO_COLOR asks for."""

    def render_line(self, y: int) -> Strip:
        """Render one line; without a layout only its style."""
        strip = super().render_line(y)
        return Strip([Segment(part.text, part.style or Style.null(), part.control) for part in strip])

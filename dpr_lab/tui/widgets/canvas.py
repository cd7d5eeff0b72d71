"""Canvas of dots, which can also be drawn without colours."""

from rich.segment import Segment
from rich.style import Style
from textual.geometry import Size
from textual.strip import Strip
from textual_hires_canvas import Canvas


class PlainCanvas(Canvas):
    """Canvas with a style in every segment, as Textual's filter for NO_COLOR requires."""

    def clear(self) -> None:
        """Remove all dots and set the size to that of the widget.

        The size must be set here, because a second layout sends no resize event.
        """
        self.reset(Size(max(1, self.size.width), max(1, self.size.height)), refresh=False)

    def render_line(self, y: int) -> Strip:
        """Render one line; before the first layout, render only the style of the line."""
        strip = super().render_line(y)
        return Strip([Segment(part.text, part.style or Style.null(), part.control) for part in strip])

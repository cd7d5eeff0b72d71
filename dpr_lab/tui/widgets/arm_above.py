"""Drawing of the arm seen from above, in Braille dots."""

import math

from textual import on
from textual.geometry import Size

from dpr_lab.tui.widgets.canvas import PlainCanvas

Limits = tuple[float, float]
"""Angles between which the arm can turn, rad."""


class ArmAbove(PlainCanvas):
    """View from above: the arm turns about the centre, angle 0 points to the right, positive counterclockwise.

    Dots mark the circle of its tip, between its limits where the rig file states them.
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(1, 1, id=id)
        self._theta0: float | None = None
        self._limits: Limits | None = None
        self._old = False

    def show(self, theta0: float | None, limits: Limits | None, *, old: bool = False) -> None:
        """Draw the arm at theta0, rad; None: the circle alone; `old`: drawn in grey."""
        moved = theta0 is None or self._theta0 is None or abs(theta0 - self._theta0) > 3e-3
        if moved or (limits, old) != (self._limits, self._old):
            self._theta0, self._limits, self._old = theta0, limits, old
            self._draw()

    @on(PlainCanvas.Resize)
    def _fit(self, event: PlainCanvas.Resize) -> None:
        event.stop()
        self.reset(Size(max(1, event.size.width), max(1, event.size.height)), refresh=False)
        self._draw()

    def _draw(self) -> None:
        colours = self.app.theme_variables
        grey = f"dim {colours['foreground']}" if self._old else ""
        with self.batch_refresh():
            self.reset()
            begin, end = self._limits or (-math.pi, math.pi)
            count = max(8, 4 * self.size.width)
            circle = [self._point(begin + (end - begin) * k / count) for k in range(count + 1)]
            self.set_hires_pixels(circle, style=colours["secondary"])
            if self._theta0 is not None:
                centre, tip = (self.size.width / 2, self.size.height / 2), self._point(self._theta0)
                self.draw_hires_lines([(*centre, *tip)], style=grey or colours["primary"])
                for (x, y), mark in ((centre, "◆"), (tip, "●")):
                    self.set_pixel(int(x), int(y), mark, grey or colours["foreground"])

    def _point(self, angle: float) -> tuple[float, float]:
        """Tip of the arm, in columns and rows; a row is as high as two columns are wide."""
        reach = 0.9 * min(self.size.width / 2, self.size.height)
        return (
            self.size.width / 2 + reach * math.cos(angle),
            self.size.height / 2 - reach * math.sin(angle) / 2,
        )

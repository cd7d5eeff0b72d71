"""Draw the arm and the rods with Braille dots."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from textual import on

from dpr_lab.tui.widgets.canvas import PlainCanvas

Angles = Sequence[float]
"""theta0, theta1, theta2: absolute angles, 0 = upright, pi = hanging, rad."""


@dataclass(frozen=True, slots=True)
class Lengths:
    """Lengths of arm and rods in the drawing, m."""

    arm: float = 0.3
    inner: float = 0.4
    outer: float = 0.4


class _Drawing(PlainCanvas):
    """Drawing that adapts to its size; outdated parts are grey."""

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(1, 1, id=id)
        self._old = False

    @on(PlainCanvas.Resize)
    def _fit(self, event: PlainCanvas.Resize) -> None:
        event.stop()
        self._draw()

    @abstractmethod
    def _draw(self) -> None:
        """Redraw the whole picture in the current size."""

    def _colour(self, name: str) -> str:
        """Return a colour of the theme; the colour is grey if the angles are outdated."""
        colours = self.app.theme_variables
        return f"dim {colours['foreground']}" if self._old else colours[name]


class Pendulum(_Drawing):
    """View from the end of the arm onto the plane of the rods.

    The rotation of the arm is shown in perspective. Lines show the rods, and dots show the requested pose.
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._lengths = Lengths()
        self._theta: Angles | None = None
        self._wanted: Angles | None = None

    def show(self, theta: Angles | None, wanted: Angles | None, lengths: Lengths, *, old: bool = False) -> None:
        """Draw the rods and, behind them, the requested pose.

        Args:
            theta: angles of arm and rods; None: no rods
            wanted: angles of the requested pose; None: no pose
            lengths: lengths of arm and rods
            old: whether the rods are drawn in grey
        """
        unchanged = (self._wanted, self._lengths, self._old) == (wanted, lengths, old)
        if not unchanged or not _alike(theta, self._theta):
            self._theta, self._wanted, self._lengths, self._old = theta, wanted, lengths, old
            self._draw()

    def _draw(self) -> None:
        with self.batch_refresh():
            self.clear()
            if self._wanted is not None:
                self._dots(self._wanted, self.app.theme_variables["secondary"])
            if self._theta is not None:
                self._rods(self._theta, self._colour("primary"), self._colour("foreground"))

    def _rods(self, theta: Angles, rod: str, joint: str) -> None:
        hub, elbow, tip = self._points(theta)
        shoulder = (hub[0] - self._scale * self._lengths.arm * math.sin(theta[0]), hub[1])
        self.draw_hires_lines([(*shoulder, *hub), (*hub, *elbow), (*elbow, *tip)], style=rod)
        for (x, y), mark in ((hub, "◆"), (elbow, "●"), (tip, "○")):
            self.set_pixel(int(x), int(y), mark, joint)

    def _dots(self, theta: Angles, style: str) -> None:
        points = self._points(theta)
        for (x0, y0), (x1, y1) in pairwise(points):
            steps = max(2, int(2 * max(abs(x1 - x0), 2 * abs(y1 - y0)) / 3))
            ends = ((x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps) for i in range(steps + 1))
            self.set_hires_pixels(ends, style=style)

    @property
    def _scale(self) -> float:
        """Scale of the drawing, columns per metre.

        The rods reach nearly to the edge. A row is as high as two columns are wide.
        """
        reach = max(self._lengths.inner + self._lengths.outer, 1e-9)
        return 0.95 * min(self.size.width / 2, self.size.height) / reach

    def _points(self, theta: Angles) -> list[tuple[float, float]]:
        """Return the positions of hub, elbow and tip, in columns and rows."""
        points = [(self.size.width / 2, self.size.height / 2)]
        for angle, length in zip(theta[1:], (self._lengths.inner, self._lengths.outer), strict=True):
            x, y = points[-1]
            points.append((x + self._scale * length * math.sin(angle), y - self._scale * length * math.cos(angle) / 2))
        return points


ArmLimits = tuple[float, float]
"""Angles between which the arm can turn, rad."""


class ArmAbove(_Drawing):
    """View of the arm from above.

    The arm turns about the centre; angle 0 points to the right, positive angles are counterclockwise. Dots mark the
    circle on which the tip of the arm moves. If the rig file states limits of the arm, only the part between these
    limits is marked.
    """

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._theta0: float | None = None
        self._limits: ArmLimits | None = None

    def show(self, theta0: float | None, limits: ArmLimits | None, *, old: bool = False) -> None:
        """Draw the arm at the angle theta0, rad.

        Args:
            theta0: angle of the arm, rad; None draws only the circle
            limits: limits of the arm, or None
            old: whether the reading is outdated; the arm is then grey
        """
        moved = theta0 is None or self._theta0 is None or abs(theta0 - self._theta0) > 3e-3
        if moved or (limits, old) != (self._limits, self._old):
            self._theta0, self._limits, self._old = theta0, limits, old
            self._draw()

    def _draw(self) -> None:
        with self.batch_refresh():
            self.clear()
            begin, end = self._limits or (-math.pi, math.pi)
            count = max(8, 4 * self.size.width)
            circle = [self._point(begin + (end - begin) * k / count) for k in range(count + 1)]
            self.set_hires_pixels(circle, style=self.app.theme_variables["secondary"])
            if self._theta0 is not None:
                centre, tip = (self.size.width / 2, self.size.height / 2), self._point(self._theta0)
                self.draw_hires_lines([(*centre, *tip)], style=self._colour("primary"))
                for (x, y), mark in ((centre, "◆"), (tip, "●")):
                    self.set_pixel(int(x), int(y), mark, self._colour("foreground"))

    def _point(self, angle: float) -> tuple[float, float]:
        """Return the position of the tip of the arm, in columns and rows.

        A row is as high as two columns are wide.
        """
        reach = 0.9 * min(self.size.width / 2, self.size.height)
        return (
            self.size.width / 2 + reach * math.cos(angle),
            self.size.height / 2 - reach * math.sin(angle) / 2,
        )


def _alike(old: Angles | None, new: Angles | None) -> bool:
    """Return whether two sets of angles give the same picture.

    Encoder noise therefore causes no redrawing.
    """
    if old is None or new is None:
        return old is new
    return all(abs(a - b) < 3e-3 for a, b in zip(old, new, strict=True))

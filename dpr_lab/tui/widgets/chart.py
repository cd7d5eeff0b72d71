"""Line chart for the terminal, with a noise band and marks.

The chart can be zoomed and panned by keys and by the mouse.
"""

import asyncio
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.color import Color, ColorParseError
from textual.containers import Grid, Vertical
from textual.events import Resize
from textual.widgets import Static
from textual_plot import HiResMode, PlotWidget
from textual_plot.plot_widget import Legend

from dpr_lab.arrays import Array
from dpr_lab.tui import FRAMES_PER_S
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.widgets.canvas import PlainCanvas
from dpr_lab.tui.widgets.chart_scale import Range, even_ticks, moved, pieces, range_of, visible, zoomed
from dpr_lab.tui.widgets.cursors import Cursors, first_cursors, readings

Tone = Literal["primary", "secondary", "accent", "foreground", "success", "warning", "error"]


@dataclass(frozen=True, slots=True)
class ChartSettings:
    """Appearance of a chart."""

    tick_columns: int = 11
    """Width of a number on the x axis including its gap, columns."""
    tick_rows: float = 1.5
    """Minimum distance of numbers on the y axis, rows."""
    end_label: int = 9
    """Maximum length of a name at the end of a line, characters. A longer name is shown only above the chart."""
    margin: float = 0.05
    """Space above and below the lines, as a share of their range."""


SETTINGS = ChartSettings()


@dataclass(frozen=True, slots=True)
class Series:
    """One line, distinguished by the name at its end and by its colour."""

    label: str
    x: Array
    """(n,) increasing x values."""
    y: Array
    """(n,) values; NaN breaks the line."""
    tone: Tone = "primary"
    on_top: bool = False
    """Whether the line is drawn on top of lines that coincide with it."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A vertical line with a name."""

    x: float
    label: str
    tone: Tone = "warning"


@dataclass(frozen=True, slots=True)
class Band:
    """Two dotted horizontal lines with a name."""

    low: float
    high: float
    label: str
    tone: Tone = "foreground"


@dataclass(frozen=True, slots=True)
class _Content:
    series: tuple[Series, ...] = ()
    x_label: str = ""
    y_label: str = ""
    marks: tuple[Mark, ...] = ()
    band: Band | None = None
    x_range: Range | None = None
    y_range: Range | None = None


@dataclass(frozen=True, slots=True)
class _EndLabel:
    x: float
    y: float
    text: str
    colour: str


class _Plot(PlotWidget, can_focus=False):
    """The plot below the head of a chart."""

    end_labels: Sequence[_EndLabel] = ()
    """Labels at the ends of the lines."""

    def _render_plot(self) -> None:
        super()._render_plot()
        canvas, taken = self.query_one("#plot", PlainCanvas), set[int]()
        if canvas._canvas_size is None:
            return
        for label in self.end_labels:
            x, y = self.get_pixel_from_coordinate(label.x, label.y)
            y = min(max(y, 1), max(canvas.size.height - 2, 1))
            y = next((row for row in (y, y - 1, y + 1) if row not in taken), y)
            taken.add(y)
            canvas.write_text(x + 1, y, f"[{label.colour}]{label.text}")

    def compose(self) -> ComposeResult:
        """Build the canvases of the plot, and the legend that `PlotWidget` requires."""
        with Grid():
            for name in ("margin-top", "margin-left", "plot", "margin-bottom"):
                yield PlainCanvas(1, 1, id=name)
        yield Legend(id="legend")


class Chart(Vertical, can_focus=True):
    """Line chart.

    `show` may be called at any time and rate.
    """

    DEFAULT_CSS = """
    Chart { height: 1fr; min-height: 6; }
    Chart > Static { height: 1; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }
    Chart > .readings { height: auto; display: none; }
    Chart:focus > Static { text-style: bold underline; }
    Chart > PlotWidget { height: 1fr; }
    Chart > PlotWidget > .plot--axis { color: $foreground 60%; }
    Chart > PlotWidget > .plot--tick { color: $foreground; text-style: none; }
    Chart:focus > PlotWidget > .plot--axis { color: $primary; }
    """
    BINDINGS = bindings("chart")

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self._head = Static()
        self._readings = Static(classes="readings")
        self._cursors: Cursors | None = None
        self._plot = _Plot()
        self._content = _Content()
        self._x_view: Range | None = None
        self._y_view: Range | None = None
        self._drawn_at = 0.0
        self._pending: asyncio.TimerHandle | None = None

    def show(
        self,
        series: Sequence[Series],
        *,
        x_label: str,
        y_label: str,
        marks: Sequence[Mark] = (),
        band: Band | None = None,
        x_range: Range | None = None,
        y_range: Range | None = None,
    ) -> None:
        """Replace the content, but keep a view that the operator has zoomed or panned.

        Args:
            series: lines to draw
            x_label: quantity on the x axis with unit
            y_label: quantity on the y axis with unit
            marks: vertical lines
            band: horizontal band, such as the noise floor
            x_range: initial range of x; by default the range of all lines
            y_range: initial range of y; by default the range of the visible lines
        """
        content = _Content(tuple(series), x_label, y_label, tuple(marks), band, x_range, y_range)
        if not _same(content, self._content):
            self._content = content
            self._draw_soon()

    @property
    def view(self) -> tuple[Range, Range]:
        """Displayed ranges of x and y."""
        x_view = self._x_view or self._content.x_range or range_of(s.x for s in self._content.series)
        return x_view, self._y_view or self._content.y_range or self._y_fitting(x_view)

    def compose(self) -> ComposeResult:
        """Build the legend, the values at the cursors, and the plot."""
        yield self._head
        yield self._readings
        yield self._plot

    def on_mount(self) -> None:
        """Draw the content that was set before, and redraw on a change of theme."""
        self._plot.margin_top, self._plot.margin_bottom, self._plot.margin_left = 0, 1, 8
        self.app.theme_changed_signal.subscribe(self, lambda _: self._draw_soon())
        self._draw_soon()

    @on(Resize)
    def _redraw_for_size(self) -> None:
        self._draw_soon()

    def action_zoom(self, direction: int) -> None:
        """Zoom the x axis around its middle."""
        self._x_view = zoomed(self.view[0], direction)
        self._draw_soon()

    def action_zoom_y(self, direction: int) -> None:
        """Zoom the y axis around its middle."""
        self._y_view = zoomed(self.view[1], direction)
        self._draw_soon()

    def action_pan(self, right: int, up: int) -> None:
        """Pan by a tenth of the view."""
        x_view, y_view = self.view
        if right:
            self._x_view = moved(x_view, right)
        if up:
            self._y_view = moved(y_view, up)
        self._draw_soon()

    def action_whole(self) -> None:
        """Reset the view."""
        self._x_view = self._y_view = None
        self._draw_soon()

    def action_cursors(self) -> None:
        """Switch to the next state of the cursors: first cursor active, second cursor active, hidden."""
        cursors = self._cursors
        self._cursors = (
            first_cursors(self.view[0]) if cursors is None else cursors.second() if cursors.moving == 0 else None
        )
        self._draw_soon()

    def action_cursor(self, columns: int) -> None:
        """Move the active cursor by a number of columns."""
        if self._cursors is not None:
            low, high = self.view[0]
            self._cursors = self._cursors.moved(columns * (high - low) / self._columns)
            self._draw_soon()

    @on(PlotWidget.ScaleChanged)
    def _follow_mouse(self, event: PlotWidget.ScaleChanged) -> None:
        event.stop()
        low, high = event.x_min, event.x_max
        self._x_view = (low, high - self._share_for_labels() / (1 + self._share_for_labels()) * (high - low))
        self._y_view = (event.y_min, event.y_max)
        self._draw_soon()

    def _draw_soon(self) -> None:
        if self._pending is None and self._can_draw():
            wait = self._drawn_at + 1 / FRAMES_PER_S - time.monotonic()
            # If the machine was busy for a whole interval, a timer of Textual never fires.
            self._pending = asyncio.get_running_loop().call_later(wait, self.call_later, self._draw)

    def _can_draw(self) -> bool:
        return self.is_running and self.is_attached and self._plot.is_mounted and self._plot.is_running

    def _draw(self) -> None:
        self._pending = None
        if not self._can_draw():
            return
        self._drawn_at = time.monotonic()
        x_view, y_view = self.view
        columns = self._columns
        rows = max(self._plot.size.height - self._plot.margin_bottom - 2, 2)
        self._head.update(self._legend())
        self._plot.clear()
        self._plot.end_labels = [*self._end_labels(x_view)]
        for series in sorted(self._content.series, key=lambda series: series.on_top):
            self._draw_series(series, x_view, columns)
        if self._content.band is not None:
            self._draw_band(self._content.band, x_view, columns)
        for mark in self._content.marks:
            if x_view[0] < mark.x < x_view[1]:
                self._plot.add_v_line(mark.x, self._colour(mark.tone))
        self._draw_cursors(x_view)
        drawn = any(len(series.x) for series in self._content.series)
        self._plot.set_xticks(even_ticks(*x_view, columns // SETTINGS.tick_columns) if drawn else [])
        self._plot.set_yticks(even_ticks(*y_view, int(rows / SETTINGS.tick_rows)) if drawn else [])
        room = self._share_for_labels() * (x_view[1] - x_view[0])
        self._plot.set_xlimits(x_view[0], x_view[1] + room)
        self._plot.set_ylimits(*y_view)

    @property
    def _columns(self) -> int:
        """Width of the plotted range, columns."""
        return max(self._plot.size.width - self._plot.margin_left - 2, 8)

    def _share_for_labels(self) -> float:
        """Return the width of the line labels relative to that of the plotted range."""
        longest = max((len(s.label) for s in self._content.series if len(s.label) <= SETTINGS.end_label), default=0)
        several = len(self._content.series) > 1 and 4 * longest < self._columns
        return (longest + 1) / (self._columns - longest - 1) if several else 0.0

    def _end_labels(self, x_view: Range) -> Iterator[_EndLabel]:
        if self._share_for_labels() == 0.0:
            return
        for series in self._content.series:
            visible = np.flatnonzero((series.x >= x_view[0]) & (series.x <= x_view[1]) & np.isfinite(series.y))
            if 0 < len(series.label) <= SETTINGS.end_label and len(visible):
                x, y = float(series.x[visible[-1]]), float(series.y[visible[-1]])
                yield _EndLabel(x, y, series.label, self._colour(series.tone))

    def _draw_series(self, series: Series, x_view: Range, columns: int) -> None:
        x, y = visible(series.x, series.y, x_view, columns)
        for piece in pieces(y):
            self._plot.plot(x[piece], y[piece], line_style=self._colour(series.tone), hires_mode=HiResMode.BRAILLE)

    def _draw_band(self, band: Band, x_view: Range, columns: int) -> None:
        """Draw the edges of a band as dots at every second cell.

        Each dot is in the quarter of the row that contains the edge.
        """
        x = x_view[0] + (np.arange(0, columns, 2) + 0.5) * (x_view[1] - x_view[0]) / columns
        for edge in (band.low, band.high):
            style, y = self._colour(band.tone), np.full(len(x), edge)
            self._plot.scatter(x, y, marker_style=style, hires_mode=HiResMode.BRAILLE)

    def _draw_cursors(self, x_view: Range) -> None:
        self._readings.display = self._cursors is not None
        if self._cursors is None:
            return
        tones = [self._colour(tone) for tone in ("accent", "success")]
        for x, tone in zip(self._cursors.at, tones, strict=True):
            if x_view[0] < x < x_view[1]:
                self._plot.add_v_line(x, tone)
        lines = [(series.label, series.x, series.y) for series in self._content.series if series.label]
        self._readings.update(readings(self._cursors, self._content.x_label, lines, tones))

    def _legend(self) -> Text:
        content = self._content
        text = Text(f"{content.y_label} / {content.x_label}" if content.y_label else "")
        for series in content.series:
            if series.label:
                text.append("   ━━ ", self._colour(series.tone)).append(series.label)
        if content.band is not None:
            text.append("   ⠂⠂ ", self._colour(content.band.tone)).append(content.band.label)
        for mark in content.marks:
            text.append("   │ ", self._colour(mark.tone)).append(mark.label)
        return text

    def _colour(self, tone: Tone) -> str:
        """Return a colour of the theme in the notation of Rich.

        If the theme does not define the colour, return the terminal's default colour.
        """
        try:
            return Color.parse(self.app.theme_variables[tone]).hex6
        except (KeyError, ColorParseError):
            return "default"

    def _y_fitting(self, x_view: Range) -> Range:
        """Return the range of y within a view of x, extended by a margin."""
        inside = [s.y[(s.x >= x_view[0]) & (s.x <= x_view[1])] for s in self._content.series]
        band = self._content.band
        low, high = range_of([*inside, *([np.array([band.low, band.high])] if band else [])])
        room = SETTINGS.margin * (high - low)
        return low - room, high + room


def _same(old: _Content, new: _Content) -> bool:
    """Return whether two contents give the same picture."""
    if len(old.series) != len(new.series) or replace(old, series=()) != replace(new, series=()):
        return False
    return all(
        (a.label, a.tone) == (b.label, b.tone) and np.array_equal(a.x, b.x) and np.array_equal(a.y, b.y, equal_nan=True)
        for a, b in zip(old.series, new.series, strict=True)
    )

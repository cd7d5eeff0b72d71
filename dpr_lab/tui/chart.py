"""A line chart for the terminal: series, a noise band, marks; zoom and pan by keyboard or mouse."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.color import Color, ColorParseError
from textual.containers import Grid, Vertical
from textual.events import Resize
from textual.timer import Timer
from textual.widgets import Static
from textual_plot import HiResMode, PlotWidget
from textual_plot.plot_widget import Legend

from dpr_lab.report.envelope import trace
from dpr_lab.tui.canvas import PlainCanvas

Array = NDArray[np.float64]
Tone = Literal["primary", "secondary", "accent", "foreground", "success", "warning", "error"]

FRAMES_PER_S = 12
"""Most redraws a second, however often `show` is called."""

ZOOM, PAN = 1.5, 0.1
DASH_COLUMNS = 3
MARGIN = 0.05
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True)
class Series:
    """One line: told apart by dashes as well as by the theme's colour."""

    label: str
    x: Array
    """(n,) increasing."""
    y: Array
    """(n,) values; NaN breaks the line."""
    tone: Tone = "primary"
    dashed: bool = False


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
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None


class _Plot(PlotWidget, can_focus=False):
    """The plot below a chart's head."""

    def compose(self) -> ComposeResult:
        """The canvases where `PlotWidget` looks for them."""
        with Grid():
            for name in ("margin-top", "margin-left", "plot", "margin-bottom"):
                yield PlainCanvas(1, 1, id=name)
        yield Legend(id="legend")


class Chart(Vertical, can_focus=True):
    """A line chart; `show` may be called at any rate, before it is mounted, and while it is taken down."""

    DEFAULT_CSS = """
    Chart { height: 1fr; min-height: 6; }
    Chart > Static { height: 1; padding: 0 1; text-wrap: nowrap; text-overflow: ellipsis; }
    Chart:focus > Static { text-style: bold underline; }
    Chart > PlotWidget { height: 1fr; }
    Chart > PlotWidget > .plot--axis { color: $foreground 60%; }
    Chart > PlotWidget > .plot--tick { color: $foreground; text-style: none; }
    Chart:focus > PlotWidget > .plot--axis { color: $primary; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("plus,equals_sign", "zoom(1)", "Zoom in", id="chart.zoom_in", key_display="+"),
        Binding("minus", "zoom(-1)", "Zoom out", id="chart.zoom_out", key_display="-"),
        Binding("left", "pan(-1,0)", "Earlier", id="chart.pan_left", show=False),
        Binding("right", "pan(1,0)", "Later", id="chart.pan_right", show=False),
        Binding("up", "pan(0,1)", "Up", id="chart.pan_up", show=False),
        Binding("down", "pan(0,-1)", "Down", id="chart.pan_down", show=False),
        Binding("shift+up", "zoom_y(1)", "Taller", id="chart.zoom_y_in", show=False),
        Binding("shift+down", "zoom_y(-1)", "Flatter", id="chart.zoom_y_out", show=False),
        Binding("0", "whole", "Whole", id="chart.whole"),
    ]

    def __init__(self, *, id: str | None = None, classes: str | None = None) -> None:
        super().__init__(id=id, classes=classes)
        self._head = Static()
        self._plot = _Plot()
        self._content = _Content()
        self._x_view: tuple[float, float] | None = None
        self._y_view: tuple[float, float] | None = None
        self._drawn_at = 0.0
        self._pending: Timer | None = None

    def show(
        self,
        series: Sequence[Series],
        *,
        x_label: str,
        y_label: str,
        marks: Sequence[Mark] = (),
        band: Band | None = None,
        x_range: tuple[float, float] | None = None,
        y_range: tuple[float, float] | None = None,
    ) -> None:
        """Draw these instead of what was drawn; a view that was zoomed or panned stays where it is.

        Args:
            series: lines to draw
            x_label: what lies along x, with its unit
            y_label: what lies along y, with its unit
            marks: vertical lines
            band: horizontal band, such as the noise floor
            x_range: what to show of x until it is zoomed; all by default
            y_range: what to show of y until it is zoomed; by default what the lines in view fill
        """
        self._content = _Content(tuple(series), x_label, y_label, tuple(marks), band, x_range, y_range)
        self._draw_soon()

    @property
    def view(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """What is shown of x and of y."""
        x_view = self._x_view or self._content.x_range or _range(s.x for s in self._content.series)
        return x_view, self._y_view or self._content.y_range or self._y_fitting(x_view)

    def compose(self) -> ComposeResult:
        """What the lines are, above the lines."""
        yield self._head
        yield self._plot

    def on_mount(self) -> None:
        """Draw what was to be shown before, and again in other colours with every theme."""
        self._plot.margin_top, self._plot.margin_bottom, self._plot.margin_left = 0, 1, 8
        self.app.theme_changed_signal.subscribe(self, lambda _: self._draw_soon())
        self._draw_soon()

    @on(Resize)
    def _redraw_for_size(self) -> None:
        self._draw_soon()

    def action_zoom(self, direction: int) -> None:
        """Shorten or lengthen what is shown of x, around its middle."""
        self._x_view = _zoomed(self.view[0], direction)
        self._draw_soon()

    def action_zoom_y(self, direction: int) -> None:
        """Shorten or lengthen what is shown of y, around its middle."""
        self._y_view = _zoomed(self.view[1], direction)
        self._draw_soon()

    def action_pan(self, right: int, up: int) -> None:
        """Move what is shown by a tenth of it."""
        x_view, y_view = self.view
        if right:
            self._x_view = _moved(x_view, right)
        if up:
            self._y_view = _moved(y_view, up)
        self._draw_soon()

    def action_whole(self) -> None:
        """Show everything again."""
        self._x_view = self._y_view = None
        self._draw_soon()

    @on(PlotWidget.ScaleChanged)
    def _follow_mouse(self, event: PlotWidget.ScaleChanged) -> None:
        event.stop()
        self._x_view, self._y_view = (event.x_min, event.x_max), (event.y_min, event.y_max)
        self._draw_soon()

    def _draw_soon(self) -> None:
        if self._pending is None and self._can_draw():
            wait = self._drawn_at + 1 / FRAMES_PER_S - time.monotonic()
            self._pending = self.set_timer(max(wait, 0.001), self._draw)

    def _can_draw(self) -> bool:
        return self.is_running and self.is_attached and self._plot.is_mounted and self._plot.is_running

    def _draw(self) -> None:
        self._pending = None
        if not self._can_draw():
            return
        self._drawn_at = time.monotonic()
        x_view, y_view = self.view
        columns = max(self._plot.size.width - self._plot.margin_left - 2, 8)
        self._head.update(self._legend())
        self._plot.clear()
        for series in self._content.series:
            self._draw_series(series, x_view, columns)
        if self._content.band is not None:
            self._draw_band(self._content.band, x_view, columns)
        for mark in self._content.marks:
            if x_view[0] < mark.x < x_view[1]:
                self._plot.add_v_line(mark.x, self._colour(mark.tone))
        ticks = None if self._content.series else []
        self._plot.set_xticks(ticks)
        self._plot.set_yticks(ticks)
        self._plot.set_xlimits(*x_view)
        self._plot.set_ylimits(*y_view)

    def _draw_series(self, series: Series, x_view: tuple[float, float], columns: int) -> None:
        x, y = _visible(series, x_view, columns)
        if series.dashed and len(x):
            x, y = _dashed(x, y, x_view, columns)
        for piece in _pieces(y):
            self._plot.plot(x[piece], y[piece], line_style=self._colour(series.tone), hires_mode=HiResMode.BRAILLE)

    def _draw_band(self, band: Band, x_view: tuple[float, float], columns: int) -> None:
        x = x_view[0] + (np.arange(0, columns, 2) + 0.5) * (x_view[1] - x_view[0]) / columns
        for edge in (band.low, band.high):
            self._plot.scatter(x, np.full(len(x), edge), marker="╌", marker_style=self._colour(band.tone))

    def _legend(self) -> Text:
        content = self._content
        text = Text(f"{content.y_label} / {content.x_label}" if content.y_label else "")
        for series in content.series:
            if series.label:
                text.append("   " + ("╍╍ " if series.dashed else "━━ "), self._colour(series.tone)).append(series.label)
        if content.band is not None:
            text.append("   ╌╌ ", self._colour(content.band.tone)).append(content.band.label)
        for mark in content.marks:
            text.append("   │ ", self._colour(mark.tone)).append(mark.label)
        return text

    def _colour(self, tone: Tone) -> str:
        """The theme's colour as Rich names it; the terminal's own where the theme leaves it to the terminal."""
        try:
            return Color.parse(self.app.theme_variables[tone]).hex6
        except (KeyError, ColorParseError):
            return "default"

    def _y_fitting(self, x_view: tuple[float, float]) -> tuple[float, float]:
        """All of y that lies inside an x view, with some room."""
        inside = [s.y[(s.x >= x_view[0]) & (s.x <= x_view[1])] for s in self._content.series]
        band = self._content.band
        low, high = _range([*inside, *([np.array([band.low, band.high])] if band else [])])
        room = MARGIN * (high - low)
        return low - room, high + room


def _range(values: Iterator[Array] | Sequence[Array]) -> tuple[float, float]:
    """Smallest and largest finite value, apart from each other; 0 and 1 of nothing."""
    finite = [kept for array in values if len(kept := array[np.isfinite(array)])]
    if not finite:
        return 0.0, 1.0
    low, high = min(float(a.min()) for a in finite), max(float(a.max()) for a in finite)
    return (low, high) if high - low > _smallest(low, high) else (low - 0.5, high + 0.5)


def _smallest(low: float, high: float) -> float:
    """The narrowest view whose ticks can still be told apart in floating point."""
    return _SMALLEST * max(abs(low), abs(high), _SMALLEST)


def _zoomed(view: tuple[float, float], direction: int) -> tuple[float, float]:
    middle, half = (view[0] + view[1]) / 2, (view[1] - view[0]) / 2 * ZOOM**-direction
    return (middle - half, middle + half) if half > _smallest(*view) else view


def _moved(view: tuple[float, float], direction: int) -> tuple[float, float]:
    step = direction * PAN * (view[1] - view[0])
    return view[0] + step, view[1] + step


def _visible(series: Series, x_view: tuple[float, float], columns: int) -> tuple[Array, Array]:
    """What a view shows of a series: at most two points a column, the extremes, NaN where the line breaks."""
    first, last = np.searchsorted(series.x, x_view)
    shown = slice(max(int(first) - 1, 0), int(last) + 1)
    return trace(series.x[shown], series.y[shown], points=2 * columns)


def _dashed(x: Array, y: Array, x_view: tuple[float, float], columns: int) -> tuple[Array, Array]:
    """The same line with NaN in every other stretch of `DASH_COLUMNS` columns."""
    grid = np.linspace(*x_view, 2 * columns + 1)
    inside = grid[(grid > x[0]) & (grid < x[-1])]
    every = np.union1d(x, inside)
    column = (every - x_view[0]) / (x_view[1] - x_view[0]) * columns
    return every, np.where(column // DASH_COLUMNS % 2 == 0, np.interp(every, x, y), np.nan)


def _pieces(y: Array) -> Iterator[slice]:
    """Stretches without NaN."""
    edges = np.flatnonzero(np.diff(np.isfinite(y), prepend=False, append=False))
    return (slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))

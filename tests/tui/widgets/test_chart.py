"""Line chart: drawing, zooming, panning, and calls before and after its existence."""

from itertools import count

import numpy as np
import pytest
from textual.app import App, ComposeResult
from textual_hires_canvas import Canvas
from textual_plot import PlotWidget

from dpr_lab.tui.widgets.chart import Band, Chart, Mark, Series
from dpr_lab.tui.widgets.chart_scale import even_ticks
from tests.thinned import thinned

T = np.arange(20_000) / 1000
WAVE = np.sin(T)


class Charted(App[None]):
    def compose(self) -> ComposeResult:
        chart = Chart(id="chart")
        chart.show([Series("wave", T, WAVE)], x_label="time (s)", y_label="angle (rad)")  # before it is mounted
        yield chart


def drawn(app: App[None]) -> str:
    """Picture as text, without its frame."""
    canvas = app.query_one("#plot", Canvas)
    return "\n".join("".join(row[1:-1]) for row in canvas._buffer[1:-1])


def legend(app: App[None]) -> str:
    return str(app.query_one(Chart)._head.render())


async def test_data_set_before_mounting_are_drawn(settled) -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        await settled(pilot)
        (x_view, y_view) = pilot.app.query_one(Chart).view
        assert x_view == (0.0, T[-1])
        assert y_view[0] < -1 < 1 < y_view[1]
        assert any("\u2800" < mark <= "\u28ff" for mark in drawn(pilot.app))
        assert "angle (rad) / time (s)" in legend(pilot.app)
        assert "wave" in legend(pilot.app)


async def test_on_a_busy_machine_the_last_data_are_drawn_too(settled, monkeypatch) -> None:
    # Busy for a millisecond at the wrong time, a chart stayed for good as it was: a swing of 10 s ended at 3 s.
    late = (0.01 * number for number in count())
    monkeypatch.setattr("textual.timer._time.get_time", lambda: next(late))
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        for last in (3.0, 10.0):
            chart.show([Series("ramp", T, T * last / T[-1])], x_label="", y_label="")
            await settled(pilot)
        assert max(line.y.max() for line in pilot.app.query_one(PlotWidget)._datasets) == 10.0


async def test_a_long_record_is_drawn_by_two_points_a_column_and_no_peak_is_lost(settled) -> None:
    spike = WAVE.copy()
    spike[12_345] = 9.0
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show([Series("spike", T, spike)], x_label="", y_label="")
        await settled(pilot)
        plotted = [line for line in pilot.app.query_one(PlotWidget)._datasets]
        assert sum(len(line.x) for line in plotted) <= 2 * 80
        assert max(line.y.max() for line in plotted) == 9.0


async def test_zoom_shows_less_and_fits_the_height_to_it() -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show([Series("ramp", T, T)], x_label="", y_label="")
        chart.focus()
        await pilot.press("plus", "plus")
        (low, high), (bottom, top) = chart.view
        assert high - low == pytest.approx(T[-1] / 1.5**2)
        assert (bottom, top) == (pytest.approx(low, abs=0.6), pytest.approx(high, abs=0.6))
        await pilot.press("minus", "minus")
        assert chart.view[0] == pytest.approx((0.0, T[-1]))


async def test_pan_moves_and_zero_shows_everything_again() -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.focus()
        await pilot.press("right", "right", "up", "shift+up")
        assert chart.view[0] == pytest.approx((0.2 * T[-1], 1.2 * T[-1]))
        await pilot.press("0")
        assert chart.view[0] == (0.0, T[-1])


async def test_new_data_leaves_the_view_that_the_operator_chose() -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.focus()
        await pilot.press("plus")
        chosen = chart.view[0]
        chart.show([Series("longer", np.append(T, 99.0), np.append(WAVE, 0.0))], x_label="", y_label="")
        assert chart.view[0] == chosen


async def test_a_gap_breaks_the_line(settled) -> None:
    gap = WAVE.copy()
    gap[5_000:15_000] = np.nan
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show([Series("gap", T, gap)], x_label="", y_label="")
        await settled(pilot)
        middle = [row[len(row) // 2] for row in drawn(pilot.app).splitlines()]
        assert set(middle) == {" "}


async def test_lines_are_solid_and_named_at_their_ends(settled) -> None:
    # Dashes were so coarse that the peaks of a swing fell into their gaps.
    ends = np.array([0.0, 1.0])
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show([Series("up", ends, ends), Series("down", ends, -ends, "secondary")], x_label="", y_label="")
        await settled(pilot)
        rows = drawn(pilot.app).splitlines()
        filled = [any(mark != " " for mark in column) for column in zip(*rows, strict=True)]
        assert all(filled[: -len("down") - 2])
        assert any(row.rstrip().endswith("up") for row in rows[:2])
        assert any(row.rstrip().endswith("down") for row in rows[-2:])


@pytest.mark.parametrize(
    ("low", "high", "most"), [(0.0, 1.0, 4), (-1.3, 7.1, 6), (37.0, 311.0, 3), (-1e-6, 2e-6, 5), (0.999, 1.001, 8)]
)
def test_ticks_are_even_and_round(low: float, high: float, most: int) -> None:
    ticks = even_ticks(low, high, most)
    assert 2 <= len(ticks) <= most
    assert all(low <= tick <= high for tick in ticks)
    steps = np.diff(ticks)
    assert steps == pytest.approx(np.full(len(steps), steps[0]), rel=1e-6)
    assert f"{steps[0]:.6e}"[0] in "125"


@pytest.mark.parametrize("height", thinned(range(10, 30), 5))
async def test_no_tick_falls_onto_another(height: int, settled) -> None:
    async with Charted().run_test(size=(80, height)) as pilot:
        await settled(pilot)
        margin = pilot.app.query_one("#margin-left", Canvas)
        labels = [text for row in margin._buffer if (text := "".join(row).strip())]
        values = [float(label) for label in labels]
        assert np.diff(values) == pytest.approx(np.full(len(values) - 1, values[1] - values[0]))


async def test_band_and_marks_are_drawn_and_named(settled) -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show(
            [Series("wave", T, WAVE)],
            x_label="t",
            y_label="y",
            marks=[Mark(10.0, "horizon"), Mark(1e9, "outside")],
            band=Band(-0.5, 0.5, "noise"),
        )
        await settled(pilot)
        picture = drawn(pilot.app)
        assert all("│" in row for row in picture.splitlines())
        assert "noise" in legend(pilot.app)
        assert "horizon" in legend(pilot.app)


async def test_a_band_lies_where_its_value_is_and_not_on_the_next_row_of_text(settled) -> None:
    # Half a row of text was half of the band.
    seen = set()
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        for edge in (0.50, 0.52, 0.54, 0.56):
            flat = Series("", T, np.zeros(len(T)))
            chart.show([flat], x_label="", y_label="", band=Band(-edge, edge, "noise"), y_range=(-1.0, 1.0))
            await settled(pilot)
            seen.add(drawn(pilot.app))
    assert len(seen) >= 3


@pytest.mark.parametrize(
    "series",
    [
        [],
        [Series("empty", np.empty(0), np.empty(0))],
        [Series("one", np.zeros(1), np.zeros(1))],
        [Series("flat", T, np.full(len(T), 3e12))],
        [Series("nothing known", T, np.full(len(T), np.nan))],
        [Series("not finite", T, np.where(T < 1, np.inf, 0.0))],
    ],
    ids=lambda series: series[0].label if series else "none",
)
async def test_any_series_is_drawn(settled, series: list[Series]) -> None:
    async with Charted().run_test(size=(60, 12)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show(series, x_label="x", y_label="y")
        chart.focus()
        await pilot.press("plus", "left", "up", "shift+down", "minus", "0")
        await settled(pilot)


async def test_it_draws_at_most_twelve_times_a_second_however_often_data_arrive(
    settled, monkeypatch: pytest.MonkeyPatch
) -> None:
    clears = 0
    cleared = PlotWidget.clear

    def clear(self: PlotWidget) -> None:
        nonlocal clears
        clears += 1
        cleared(self)

    async with Charted().run_test(size=(80, 24)) as pilot:
        await settled(pilot)
        monkeypatch.setattr(PlotWidget, "clear", clear)
        chart = pilot.app.query_one(Chart)
        for shift in range(200):
            chart.show([Series("wave", T, WAVE + shift)], x_label="", y_label="")
        await settled(pilot)
        assert clears <= 2


async def test_calls_while_it_is_taken_down_do_nothing() -> None:
    async with Charted().run_test(size=(80, 24)) as pilot:
        chart = pilot.app.query_one(Chart)
        chart.show([Series("wave", T, WAVE)], x_label="", y_label="")
        removing = chart.remove()
        chart.show([Series("wave", T, -WAVE)], x_label="", y_label="")
        await removing
        chart.show([Series("wave", T, WAVE)], x_label="", y_label="")
        await pilot.pause()


async def test_without_colours_it_is_drawn_too(settled, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with Charted().run_test(size=(80, 24)) as pilot:
        await settled(pilot)
        assert any("\u2800" < mark <= "\u28ff" for mark in drawn(pilot.app))

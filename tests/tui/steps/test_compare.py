"""Step 5: measured and simulated angles, the noise band, and free runs."""

import json
from pathlib import Path

import numpy as np
import pytest
from textual.app import App
from textual.widgets import Select, Static

from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import load_model
from dpr_lab.tui.steps.compare import CompareStep
from dpr_lab.tui.steps.second_curve import SecondCurve
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.stepper import Stepper


def step(app: App[None]) -> CompareStep:
    return app.query_one(CompareStep)


def figures(app: App[None]) -> str:
    return str(app.query_one("#figures", Static).content)


def series(app: App[None], chart: str) -> dict[str, np.ndarray]:
    return {series.label: series.y for series in app.query_one(chart, Chart)._content.series}


def swing(name: str, horizon_s: float, held_out: bool = False) -> Comparison:
    """Comparison in which the segments are at the noise floor and the free run diverges."""
    noise = np.array([2e-4, 3e-4])
    t = np.arange(5000) / 1000
    tracked = np.pi + np.stack([0.5 * np.cos(5 * t), 2 * np.cos(4 * t)], axis=1)
    measured = tracked + noise * np.random.default_rng(1).standard_normal((5000, 2))
    return Comparison(
        run=name,
        pose="X1",
        held_out=held_out,
        t=t,
        measured=measured,
        free_run=tracked + 1e-4 * np.expm1(2 * t)[:, None],
        tracked=tracked,
        horizon_s=horizon_s,
        noise_rad=noise,
        segments=10,
        segment_rms_rad=noise,
        free_run_rms_rad=20 * noise,
    )


@pytest.mark.slow
async def test_runs_are_compared_as_the_command_does(lab, until, recorded: list[Path], modelled: Path) -> None:
    async with lab(CompareStep, runs=recorded, model=modelled) as pilot:
        await until(pilot, lambda: "saved in" in figures(pilot.app))
        report = pilot.app.workspace.out / "report"
        saved = json.loads((report / "comparison.json").read_text())
        assert [run["run"] for run in saved["runs"]] == [run.stem for run in recorded]
        assert (report / "report.html").is_file()
        assert all(Path(figure).read_bytes().startswith(b"\x89PNG") for figure in saved["figures"].values())
        assert step(pilot.app).outcome() == "3 runs"
        assert step(pilot.app).at_stake() == ""
        assert figures(pilot.app).startswith("fitted, 6 segments")
        await until(pilot, lambda: step(pilot.app).job is None)


@pytest.mark.long
async def test_another_model_makes_a_comparison_stale_and_a_key_repeats_it(
    lab, until, recorded: list[Path], modelled: Path, tmp_path: Path
) -> None:
    async with lab(CompareStep, runs=recorded[:1], model=modelled) as pilot:
        await until(pilot, lambda: "saved in" in figures(pilot.app))
        other = tmp_path / "other.json"
        load_model(modelled).model_copy(update={"runs": []}).save(other)
        pilot.app.workspace.model = other
        pilot.app.action_go(1)
        await pilot.pause()
        assert "STALE, model, runs or torques changed; s: run again" in str(pilot.app.query_one(Stepper).render())
        assert "fitted" in figures(pilot.app)  # what was compared stays readable
        await pilot.press("s")
        await until(pilot, lambda: figures(pilot.app).startswith("held out"))
        await until(pilot, lambda: "STALE" not in str(pilot.app.query_one(Stepper).render()))


@pytest.mark.long
async def test_a_run_that_cannot_be_read_is_named_and_the_others_are_compared(
    lab, until, notices_text, recorded: list[Path], modelled: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(recorded[0].read_bytes()[:3000])
    async with lab(CompareStep, runs=[recorded[0], broken, recorded[1]], model=modelled) as pilot:
        await until(pilot, lambda: "saved in" in figures(pilot.app))
        assert figures(pilot.app).endswith("skipped: broken")
        assert str(broken) in notices_text(pilot.app)
        saved = json.loads((pilot.app.workspace.out / "report" / "comparison.json").read_text())
        assert [run["run"] for run in saved["runs"]] == [run.stem for run in recorded[:2]]
        assert step(pilot.app).outcome() == "2 runs"


@pytest.mark.long
async def test_with_no_run_left_nothing_is_compared(lab, until, notices_text, fixed_model: Path) -> None:
    async with lab(CompareStep, runs=[Path("gone.mcap")], model=fixed_model) as pilot:
        await until(pilot, lambda: step(pilot.app).job is None)
        assert figures(pilot.app) == "no run can be compared (skipped: gone): choose other runs (b)"
        assert "gone.mcap: no such file" in notices_text(pilot.app)


async def test_without_a_model_the_screen_states_how_to_obtain_one(lab) -> None:
    async with lab(CompareStep, runs=[Path("X1.mcap")]) as pilot:
        assert "identify one in step 4" in step(pilot.app).missing()
        assert figures(pilot.app) == step(pilot.app).missing()
        assert step(pilot.app).job is None


@pytest.mark.slow
async def test_axis_view_and_run_are_picked_by_keys(lab) -> None:
    async with lab(CompareStep) as pilot:
        step(pilot.app).show([swing("first", 3.2), swing("second", 9.0, held_out=True)])
        await pilot.pause()
        assert "held out" not in figures(pilot.app)
        assert series(pilot.app, "#angle")["measured"].max() > 280  # outer rod, degrees
        await pilot.press("j")
        assert series(pilot.app, "#angle")["measured"].max() < 230
        assert figures(pilot.app).endswith("up to 3.20 s")
        await pilot.press("o")
        assert figures(pilot.app).startswith("held out")
        assert figures(pilot.app).endswith("to the end of the record")  # it said "up to ≥ 5.00 s"
        await pilot.press("v", "v")
        await pilot.pause()
        assert not pilot.app.query_one("#angle", Chart).display
        assert np.abs(series(pilot.app, "#error")["residual"]).max() < 0.1  # degrees
        await pilot.press("v")
        assert pilot.app.query_one("#view", Select).value == "angle"


@pytest.mark.slow
async def test_the_error_of_a_free_run_is_shown_up_to_the_horizon(lab) -> None:
    async with lab(CompareStep) as pilot:
        shown = swing("first", 3.2)
        step(pilot.app).show([shown])
        await pilot.press("v")
        await pilot.pause()
        error = pilot.app.query_one("#error", Chart)._content
        assert error.series[0].x.max() <= 3.2
        assert [mark.x for mark in error.marks] == [3.2]
        assert error.band is not None
        assert error.band.high == pytest.approx(np.degrees(6e-4))
        assert error.series[0].y[-1] == pytest.approx(np.degrees((shown.measured - shown.free_run)[3200, 1]))


@pytest.mark.slow
async def test_the_unit_of_angles_is_one_key_away(lab) -> None:
    async with lab(CompareStep) as pilot:
        step(pilot.app).show([swing("first", 3.2)])
        await pilot.pause()
        chart = pilot.app.query_one("#angle", Chart)
        assert "(°)" in chart._content.y_label
        assert "rms residual 0.0115, 0.0172 °" in figures(pilot.app)
        await pilot.press("g")
        await pilot.pause()
        assert "(rad)" in chart._content.y_label
        assert series(pilot.app, "#angle")["measured"].max() < 6
        step(pilot.app)._draw()
        assert "mrad" in pilot.app.query_one("#error", Chart)._content.y_label


@pytest.mark.slow
async def test_a_tall_screen_shows_angle_and_error(lab) -> None:
    async with lab(CompareStep, size=(160, 60)) as pilot:
        step(pilot.app).show([swing("first", 3.2)])
        await pilot.pause()
        assert all(chart.display for chart in pilot.app.query(Chart))


@pytest.mark.slow
async def test_its_snapshot_is_unchanged(lab, snapshot) -> None:
    async with lab(CompareStep) as pilot:
        step(pilot.app).show([swing("first", 3.2), swing("second", 9.0, held_out=True)])
        for view in ("angle", "free-run-error"):
            await snapshot(pilot, f"compare-{view}")
            await pilot.press("v")


@pytest.mark.slow
async def test_two_runs_stand_in_one_plot(lab) -> None:
    async with lab(CompareStep) as pilot:
        first, second = swing("first", 3.2), swing("second", 9.0, held_out=True)
        step(pilot.app).show([first, second])
        await pilot.pause()
        assert set(series(pilot.app, "#angle")) == {"measured", "free run"}
        await pilot.press("O")
        await pilot.pause()
        drawn = series(pilot.app, "#angle")
        assert np.allclose(drawn["other run"], np.degrees(second.measured[:, 1]))
        assert "second: held out" in figures(pilot.app)
        await pilot.press("v")
        await pilot.pause()
        assert set(series(pilot.app, "#error")) == {"residual", "other run"}
        await pilot.press("O")
        await pilot.pause()
        assert set(series(pilot.app, "#error")) == {"residual"}
        assert "second:" not in figures(pilot.app)


@pytest.mark.slow
async def test_the_same_run_by_two_models_stands_in_one_plot(lab) -> None:
    async with lab(CompareStep) as pilot:
        shown, by_other = swing("first", 3.2), swing("first", 4.0)
        step(pilot.app).show([shown])
        await pilot.pause()
        second = pilot.app.query_one(SecondCurve)
        second._model = {"first": by_other}
        step(pilot.app)._offer_second()
        await pilot.press("O")
        await pilot.pause()
        assert np.allclose(series(pilot.app, "#angle")["2nd model"], np.degrees(by_other.free_run[:, 1]))


@pytest.mark.long
async def test_another_models_file_is_simulated_as_second_curve(
    lab, until, recorded: list[Path], modelled: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.json"
    other.write_text(modelled.read_text())
    async with lab(CompareStep, runs=recorded[:1], model=modelled) as pilot:
        await until(pilot, lambda: "saved in" in figures(pilot.app))
        before = (pilot.app.workspace.out / "report" / "report.html").stat().st_mtime_ns
        await pilot.press("i", *str(other), "enter")
        await until(pilot, lambda: "2nd model" in series(pilot.app, "#angle"))
        drawn = series(pilot.app, "#angle")
        assert np.allclose(drawn["2nd model"], drawn["free run"])
        assert (pilot.app.workspace.out / "report" / "report.html").stat().st_mtime_ns == before
        await pilot.press("escape", "i", *["backspace"] * len(str(other)), *"gone.json", "enter")
        await until(pilot, lambda: any("gone.json" in notice.message for notice in pilot.app.notices))


@pytest.mark.slow
async def test_two_cursors_read_off_values_and_differences(lab, settled) -> None:
    async with lab(CompareStep, size=(120, 40)) as pilot:
        shown = swing("first", 3.2)
        step(pilot.app).show([shown])
        await pilot.press("j", "j")
        chart = pilot.app.query_one("#angle", Chart)
        chart.focus()
        await pilot.press("M")
        await settled(pilot)
        a, b = chart._cursors.at
        await pilot.press("full_stop", "full_stop", "M", "less_than_sign")
        await settled(pilot)
        moved_a, moved_b = chart._cursors.at
        assert moved_a > a
        assert moved_b < b
        result = str(chart.query_one(".readings", Static).render())
        expected = np.interp([moved_a, moved_b], shown.t, np.degrees(shown.measured[:, 1]))
        assert f"measured: A {expected[0]:.4g}  B {expected[1]:.4g}  B−A {expected[1] - expected[0]:+.4g}" in result
        assert f"B−A {moved_b - moved_a:+.4g}   time (s)" in result
        assert "free run − measured: A " in result
        await pilot.press("M")
        await settled(pilot)
        assert chart._cursors is None
        assert not chart.query_one(".readings").display

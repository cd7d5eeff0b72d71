"""Step 6: verdict, causes, location, gap reduction and next steps; saved as by the command."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from textual.app import App
from textual.widgets import DataTable, Input, Static, TabbedContent

from dpr_lab.gap.result.diagnosis import load_diagnosis
from dpr_lab.gap.where.locate import where_sentence
from dpr_lab.kernel_cache import COMPILING
from dpr_lab.progress import StageBegan
from dpr_lab.report.angles import RADIANS
from dpr_lab.report.envelope import signal_scale
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.report.gap.tables import sentence
from dpr_lab.report.run_names import run_name
from dpr_lab.report.words import in_words, named
from dpr_lab.shown import percent
from dpr_lab.tui.jobs.job_events import JobCompiling, JobEvent, JobProgress
from dpr_lab.tui.jobs.job_process import JobHeard, JobProcess
from dpr_lab.tui.steps.diagnose import DiagnoseStep
from dpr_lab.tui.steps.diagnosis_views import far_view
from dpr_lab.tui.texts import Bars
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.stepper import Stepper
from tests.a_diagnosis import made


def step(app: App[None]) -> DiagnoseStep:
    return app.query_one(DiagnoseStep)


def text(app: App[None], widget: str) -> str:
    console = Console(width=100, color_system=None, markup=False)
    with console.capture() as captured:
        console.print(app.query_one(widget, Static).content)
    return captured.get()


@pytest.mark.slow
async def test_from_runs_to_a_saved_diagnosis(lab, until, recorded: list[Path], modelled: Path) -> None:
    async with lab(DiagnoseStep, runs=recorded, model=modelled) as pilot:
        await pilot.press("h")
        await until(pilot, lambda: pilot.app.screen.query(DataTable))
        await pilot.press("down", "down", "space", "enter")
        assert pilot.app.workspace.held_out == recorded[2:]
        await pilot.press("s")
        await until(pilot, lambda: "step" in text(pilot.app, "#state"))
        assert step(pilot.app).at_stake() == "The current diagnosis ends without a result."
        await until(pilot, lambda: step(pilot.app).job is None)
        folder = pilot.app.workspace.out / "diagnosis"
        assert pilot.app.workspace.diagnosis == folder / "diagnosis.json"
        saved = json.loads(pilot.app.workspace.diagnosis.read_text())
        assert set(saved["gap"]["closed_held_out"]["per_run"]) == {run.stem for run in recorded[:2]}
        assert set(saved["gap"]["closed_held_out"]["held_out"]) == {recorded[2].stem}
        assert all(Path(file).is_file() for file in saved["files"].values())
        assert (folder / "diagnosis.html").is_file()
        assert (folder / "gap_horizon.png").read_bytes().startswith(b"\x89PNG")
        assert (folder / "where.png").exists() == bool(saved["where"])
        assert load_diagnosis(pilot.app.workspace.diagnosis).verdict == saved["verdict"]
        assert step(pilot.app).outcome() in (saved["verdict"].replace("_", " "), "1 effect named")
        diagnosis = load_diagnosis(pilot.app.workspace.diagnosis)
        assert " ".join(text(pilot.app, "#state").split()) == sentence(diagnosis)


@pytest.mark.slow
async def test_cancelling_leaves_nothing_half_written(lab, until, recorded: list[Path]) -> None:
    async with lab(DiagnoseStep, runs=recorded) as pilot:
        await pilot.press("s")
        await until(pilot, lambda: "step" in text(pilot.app, "#state"))
        assert "Diagnose: running" in str(pilot.app.query_one(Stepper).render())  # it said "to be done"
        await pilot.press("X")
        await until(pilot, lambda: step(pilot.app).job is None)
        assert "Diagnose: to be done" in str(pilot.app.query_one(Stepper).render())
        assert "cancelled" in text(pilot.app, "#state")
        assert pilot.app.workspace.diagnosis is None
        assert not (pilot.app.workspace.out / "diagnosis" / "diagnosis.json").exists()


async def test_a_diagnosis_is_resumed_with_its_complete_content(lab, fixed_diagnosis: Path) -> None:
    diagnosis = load_diagnosis(fixed_diagnosis)
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        assert " ".join(text(pilot.app, "#state").split()) == sentence(diagnosis)
        which = " ".join(text(pilot.app, "#which-text").split())
        assert "latency, joint 2 [latency_joint2]" in which
        assert "delay 0.500 ms (0.498 to 0.502)" in which
        for effect in diagnosis.effects:
            assert f"{named(effect.name)}: probability {percent(effect.probability)}" in which
            assert f"+ {named(effect.name)}" in text(pilot.app, "#far-text")
        low, high = diagnosis.gap.closed_held_out.interval90
        result = " ".join(text(pilot.app, "#far-text").split())
        assert f"90 % interval {percent(low, 1)} to {percent(high, 1)}" in result
        assert "The gap is the residual above the noise floor of" in result
        for number, advice in enumerate(next_steps(diagnosis), 1):
            assert f"{number}. {advice}" in " ".join(text(pilot.app, "#next-text").split())
        assert step(pilot.app).outcome() == "2 effects named"


def test_each_bar_is_as_long_as_the_gap_that_it_states() -> None:
    """The noise is already subtracted from the gap, so a gap below the noise floor has a bar."""
    group = far_view(made(), RADIANS)
    (bars,) = (part for part in group.renderables if isinstance(part, Bars) and part.top is None)
    assert [value for _, value, *_ in bars.rows] == pytest.approx([1.0])  # mrad, the size of the noise floor


class Silent(JobProcess):
    """Job that sends no events by itself."""

    def __init__(self) -> None:
        """Start no process."""

    def cancel(self) -> None:
        """Do nothing, because no job runs."""


async def test_the_first_start_reports_the_compilation_and_then_the_remaining_time(
    lab, recorded: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpr_lab.tui.steps.job_step.start_job", lambda *_, **__: Silent())
    async with lab(DiagnoseStep, runs=recorded) as pilot:
        shown = step(pilot.app)

        async def heard(event: JobEvent) -> None:
            assert shown.job is not None
            shown.post_message(JobHeard(shown.job, event))
            await pilot.pause()

        await pilot.press("s")
        await heard(JobCompiling())
        await heard(JobCompiling())
        assert " ".join(text(pilot.app, "#state").split()) == f"{COMPILING} (kernel 2)"
        assert shown.work.endswith("s, compiling")
        await heard(JobProgress(StageBegan(4, 9, "which")))
        (left,) = re.findall(r", about (\d+) s left$", shown.work)
        assert 0 < int(left) <= round(len(recorded) * DiagnoseStep.TYPICAL_S)
        assert "compiling" not in text(pilot.app, "#state")


async def test_without_a_gap_there_is_no_empty_picture_of_where(lab, fixed_diagnosis: Path, tmp_path: Path) -> None:
    result = json.loads(fixed_diagnosis.read_text())
    none = {"verdict": "no_gap", "effects": [], "where": [], "where_sentence": where_sentence(())}
    (tmp_path / "diagnosis.json").write_text(json.dumps(result | none | {"gap": result["gap"] | {"waterfall": []}}))
    async with lab(DiagnoseStep) as pilot:
        shown = step(pilot.app)
        for record, drawn in ((fixed_diagnosis, True), (tmp_path / "diagnosis.json", False)):
            shown.show(load_diagnosis(record))
            assert [shown.query_one(name).display for name in ("#place", "#place-map")] == [drawn] * 2
        assert "No gap in the segments is large enough to be located." in text(pilot.app, "#place-text")
        assert "There is no gap, so there is no gap reduction" in text(pilot.app, "#far-text")
        assert "90 % interval" not in text(pilot.app, "#far-text")
        await pilot.press("v")
        assert pilot.app.focused is shown  # a picture that is not shown takes no keys


async def test_runs_stand_by_pose_and_time_and_no_list_is_empty(lab, fixed_diagnosis: Path, tmp_path: Path) -> None:
    result = json.loads(fixed_diagnosis.read_text())
    shares = result["gap"]["closed_held_out"]
    shares["per_run"] = {"20261121T101500Z_X1_00000001": shares["per_run"]["X1"]}
    (tmp_path / "diagnosis.json").write_text(json.dumps(result))
    async with lab(DiagnoseStep, diagnosis=tmp_path / "diagnosis.json") as pilot:
        far, which = (text(pilot.app, name) for name in ("#far-text", "#which-text"))
        assert "X1 (2026-11-21 " in far
        assert "20261121T101500Z" not in far
        assert "indistinguishable from: –" not in which
        assert which.count("indistinguishable from:") == sum(
            len(e.members) > 1 for e in load_diagnosis(tmp_path / "diagnosis.json").effects
        )


async def test_every_alternative_states_how_to_distinguish_it(lab, fixed_diagnosis: Path, tmp_path: Path) -> None:
    outcome = json.loads(fixed_diagnosis.read_text())
    outcome["verdict"] = "partly_explained"
    outcome["checks"] = [
        {
            "id": "1-ab", "kind": "recording", "text": "Raise the rods higher.", "about": "coulomb_joint1",
            "splits": ["coulomb_joint1", "stribeck_joint1"], "expected_bits": 0.6,
        }
    ]  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(outcome))
    async with lab(DiagnoseStep, diagnosis=tmp_path / "diagnosis.json") as pilot:
        lines = [line.split() for line in text(pilot.app, "#which-text").splitlines()]
        rival = named("stribeck_joint1").split()
        assert any(line[:2] == rival[:2] and line[-5:] == ["0.7", "%", "1.0000", "check", "1-ab"] for line in lines)
        assert sum(line[:2] == ["a", "cause"] for line in lines) == 2
        result = " ".join(text(pilot.app, "#next-text").split())
        assert "1. Raise the rods higher" in result
        assert "2. The remainder is smaller than the noise" in result


@pytest.mark.slow
async def test_a_map_ends_where_the_recordings_end(lab, settled, fixed_diagnosis: Path, tmp_path: Path) -> None:
    result = json.loads(fixed_diagnosis.read_text())
    result["where"][0]["std"][-1] = 1.7e305
    (tmp_path / "diagnosis.json").write_text(json.dumps(result))
    async with lab(DiagnoseStep, diagnosis=tmp_path / "diagnosis.json") as pilot:
        await pilot.press("o", *"o" * (len(result["where"]) - 1))
        await settled(pilot)
        chart = pilot.app.query_one("#place-map", Chart)
        _, *lines = chart._content.series
        assert [np.flatnonzero(np.isnan(line.y)).tolist() for line in lines] == [[9]] * 3
        assert np.abs(chart.view[1]).max() < 10


@pytest.mark.slow
async def test_a_result_that_no_longer_fits_is_marked_stale_and_stays_readable(
    lab, fixed_diagnosis: Path, recorded
) -> None:
    # It kept its check mark after rig, selection or hold-outs had changed.
    async with lab(DiagnoseStep, runs=recorded[:2], diagnosis=fixed_diagnosis) as pilot:
        app = pilot.app
        app.workspace.made_from["Diagnose"] = app.workspace.basis()
        app.redraw()
        assert "STALE" not in str(app.query_one(Stepper).render())
        for change in ({"rig": "multiarm"}, {"runs": recorded}, {"held_out": recorded[:1]}):
            before = {name: getattr(app.workspace, name) for name in change}
            for name, value in change.items():
                setattr(app.workspace, name, value)
            app.redraw()
            row = str(app.query_one(Stepper).render())
            assert "STALE, the " in row
            assert "s: run again" in row
            assert sentence(load_diagnosis(fixed_diagnosis)) in " ".join(text(app, "#state").split())
            for name, value in before.items():
                setattr(app.workspace, name, value)


async def test_cancelled_work_keeps_the_verdict_from_before(lab, fixed_diagnosis: Path) -> None:
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        step(pilot.app).ended("cancelled")
        result = " ".join(text(pilot.app, "#state").split())
        assert "Ended without a new diagnosis: cancelled; the previous one is shown." in result
        assert sentence(load_diagnosis(fixed_diagnosis)) in result


async def test_a_new_unit_does_not_hide_that_the_work_was_cancelled(lab, fixed_diagnosis: Path) -> None:
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        pilot.app.workspace.angles = RADIANS.name  # during the work
        step(pilot.app).ended("cancelled")
        step(pilot.app).enter()
        assert "Ended without a new diagnosis: cancelled" in " ".join(text(pilot.app, "#state").split())


def test_an_interval_that_opens_at_the_edges_does_not_flatten_the_curve() -> None:
    value = np.array([0.0, 1.0, -1.0, 0.5, 0.0])
    (low, high), clipped = signal_scale(value, np.array([300.0, 0.1, 0.1, 0.1, np.nan]))
    assert -1.5 < low < -1.1
    assert 1.1 < high < 1.5
    assert clipped
    assert not signal_scale(value, np.full(5, 0.1))[1]
    (low, high), clipped = signal_scale(value, np.full(5, 300.0))  # wide everywhere
    assert clipped
    assert np.ptp(value) > 0.2 * (high - low)


def test_without_a_remainder_no_bar_is_drawn() -> None:
    # The bar was full at the noise floor.
    rows = [("before", 3.0, None, ""), ("nothing left", 0.0, None, ""), ("hardly", 0.001, None, "")]
    page = io.StringIO()
    Console(width=60, file=page).print(Bars(rows))
    drawn = page.getvalue().splitlines()
    assert drawn[0].count("█") > 30
    assert drawn[1].count("█") == drawn[2].count("█") == 0


@pytest.mark.slow
async def test_the_map_of_every_place_is_one_key_away(lab, settled, fixed_diagnosis: Path) -> None:
    diagnosis = load_diagnosis(fixed_diagnosis)
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        for place in [*diagnosis.where[1:], diagnosis.where[0]]:
            await pilot.press("o")
            await settled(pilot)
            assert pilot.app.query_one(TabbedContent).active == "where"
            assert in_words(place.sentence) in " ".join(text(pilot.app, "#place-text").split())
            drawn = pilot.app.query_one("#place-map", Chart)._content
            factor = 180 / np.pi if place.coordinate in ("angle", "speed") else 1.0
            assert drawn.series[-1].x.tolist() == (factor * np.array(place.knots)).tolist()
            assert (place.coordinate == "time") == ("time" in drawn.x_label)


@pytest.mark.slow
async def test_sizes_and_maps_follow_the_unit_of_angles(lab, settled, fixed_diagnosis: Path) -> None:
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        chart = pilot.app.query_one("#place-map", Chart)
        await settled(pilot)
        assert (chart._content.x_label, chart._content.y_label) == ("joint speed (°/s)", "encoder error (°)")
        assert "Gap per reading (° rms" in text(pilot.app, "#far-text")
        await pilot.press("g")
        await settled(pilot)
        assert (chart._content.x_label, chart._content.y_label) == ("joint speed (rad/s)", "encoder error (mrad)")
        assert "Gap per reading (mrad rms" in text(pilot.app, "#far-text")


@pytest.mark.slow
async def test_several_runs_are_held_out(lab, until, recorded: list[Path]) -> None:
    async with lab(DiagnoseStep, runs=recorded) as pilot:
        assert "none" in text(pilot.app, "#held-out")
        await pilot.press("h")
        await until(pilot, lambda: pilot.app.screen.query(DataTable))
        await pilot.press("space", "space", "enter")
        assert pilot.app.workspace.held_out == recorded[:2]
        assert pilot.app.workspace.runs == recorded
        assert f"2 runs: {run_name(recorded[0])}, {run_name(recorded[1])}" in " ".join(
            str(pilot.app.query_one("#held-out", Static).content).split()
        )
        await pilot.press("h", "asterisk", "escape")
        assert pilot.app.workspace.held_out == recorded[:2]
        assert json.loads((pilot.app.folder / "bench.json").read_text())["held_out"] == [str(r) for r in recorded[:2]]


async def test_not_every_run_can_be_held_out(lab) -> None:
    runs = [Path("X1.mcap"), Path("X2.mcap")]
    async with lab(DiagnoseStep, runs=runs, held_out=runs) as pilot:
        await pilot.press("s")
        assert step(pilot.app).job is None
        (notice,) = pilot.app.notices
        assert "hold out fewer" in notice.message


@pytest.mark.long
async def test_a_model_of_another_rig_is_refused(
    lab, until, recorded: list[Path], fixed_model: Path, tmp_path: Path
) -> None:
    other = json.loads(fixed_model.read_text())
    other["rig"]["name"] = "other"
    (tmp_path / "other.json").write_text(json.dumps(other))
    async with lab(DiagnoseStep, runs=recorded, model=tmp_path / "other.json") as pilot:
        await pilot.press("s")
        await until(pilot, lambda: step(pilot.app).job is None)
        (notice,) = pilot.app.notices
        assert "the model belongs to rig other" in notice.message
        assert pilot.app.workspace.diagnosis is None


@pytest.mark.long
async def test_a_recording_cannot_be_held_out_from_itself(lab, until, recorded: list[Path], tmp_path: Path) -> None:
    copy = Path(shutil.copy(recorded[0], tmp_path / "copy.mcap"))
    async with lab(DiagnoseStep, runs=recorded, held_out=[copy]) as pilot:
        await pilot.press("s")
        await until(pilot, lambda: step(pilot.app).job is None)
        (notice,) = pilot.app.notices
        assert f"{copy}: is the same recording as {recorded[0]}" in notice.message


@pytest.mark.slow
async def test_numbers_out_of_range_are_refused(lab) -> None:
    async with lab(DiagnoseStep, runs=[Path("X1.mcap")]) as pilot:
        for field, value in (("max-effects", "9"), ("max-effects", ""), ("seed", "-3")):
            entry = pilot.app.query_one(f"#{field}", Input)
            before, entry.value = entry.value, value
            await pilot.press("s")
            assert step(pilot.app).job is None
            (notice,) = pilot.app.notices
            assert f"{field} = {value!r}" in notice.message
            pilot.app.clear_notifications()
            entry.value = before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "reason"),
    [("{", "is not a diagnosis"), ("[1]", "is not a diagnosis"), ('{"verdict": "named"}', "sentence: is missing")],
)
async def test_a_damaged_diagnosis_is_reported_and_the_step_continues(
    lab, tmp_path: Path, content: str, reason: str
) -> None:
    broken = tmp_path / "diagnosis.json"
    broken.write_text(content)
    async with lab(DiagnoseStep, diagnosis=broken) as pilot:
        (notice,) = pilot.app.notices
        assert reason in notice.message
        assert step(pilot.app).outcome() == ""


@pytest.mark.slow
async def test_its_snapshot_is_unchanged(lab, snapshot, fixed_diagnosis: Path) -> None:
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        for view in ("which", "where", "far"):
            await snapshot(pilot, f"diagnose-{view}")
            await pilot.press("v")

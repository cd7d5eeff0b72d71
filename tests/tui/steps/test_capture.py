"""Guided release with simulated key presses and a simulated device on a real link."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

from dataclasses import replace

import pytest
from textual.widgets import Static

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.report.run_names import run_name
from dpr_lab.storage.inspect import info, recover, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.widgets.dialogs import Question
from dpr_lab.tui.workspace import load
from tests.tui.steps.releases import SECOND, SIM, connect, headline, in_phase, recorded, to_judged, to_ready

pytestmark = pytest.mark.usefixtures("quick_countdown")


@pytest.mark.long
async def test_three_releases_are_kept_one_for_each_pose(app: DprApp, until, monkeypatch: pytest.MonkeyPatch) -> None:
    rung: list[bool] = []
    monkeypatch.setattr(app, "bell", lambda: rung.append(True))
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        for done in range(1, 4):
            await to_judged(pilot, until, step)
            assert "good" in headline(app)
            await pilot.press("k")
            await until(pilot, lambda done=done: step.outcome() == f"{done} run{'s' if done > 1 else ''}")
        assert app.workspace.runs == recorded(app)
        assert headline(app).startswith("X3: all poses are recorded: n shows the next step.")
    runs = [load_run(file) for file in app.workspace.runs]
    assert [run.pose for run in runs] == ["X1", "X2", "X3"]
    assert len(rung) == 6, "at each go-ahead and at each release, since eyes are on the rods"
    assert all(run.complete and run.t[-1] == 1.0 and not sum(run.lost.values()) for run in runs)
    assert all(verify(file).ok for file in app.workspace.runs)


@pytest.mark.long
async def test_repeat_keeps_the_recording_aside_and_begins_again(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        first = await to_judged(pilot, until, step)
        await pilot.press("a")
        await until(pilot, in_phase(step, Phase.READY))
        assert step.attempt.name == "X1"
        await pilot.press("r")
        await until(pilot, in_phase(step, Phase.JUDGED))
        await pilot.press("k")
        await pilot.pause()
        assert first not in app.workspace.runs
        assert len(app.workspace.runs) == 1
    assert not first.exists()
    assert verify(first.parent / "aside" / first.name).ok


@pytest.mark.long
async def test_a_degraded_recording_states_the_reason(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM + "&fault=drop=0.02")
        await to_judged(pilot, until, step)
        assert "degraded" in headline(app)
        assert "lost samples" in str(app.query_one("#readout", Static).render())
        await pilot.press("k")
        await until(pilot, lambda: app.workspace.runs)


@pytest.mark.long
async def test_remarks_without_a_failed_check_are_shown_too(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM, replace(SECOND, until_rest=True, max_duration=1.0))
        await to_judged(pilot, until, step)
        assert "good" in headline(app)
        assert "the rods were still moving" in str(app.query_one("#readout", Static).render())


@pytest.mark.long
async def test_a_cable_pulled_while_recording_costs_the_rest_of_the_swing_only(
    app: DprApp, until, notices_text, cable
) -> None:
    port = cable()
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, port.url, CaptureOptions(duration=60.0, pose_timeout=600, rest_timeout=60))
        await to_ready(pilot, until, step)
        await pilot.press("r")
        await until(pilot, lambda: step.attempt.recorded is not None and step.attempt.recorded.t > 0.5)
        assert step.at_stake() == "The current recording ends now; the data recorded so far are kept."
        await pilot.press("1", "z")
        await until(pilot, lambda: "A capture is under way: end it first" in notices_text(app))
        await pilot.press("3")
        seen = step.attempt.recorded.samples
        port.pull()
        await until(pilot, lambda: step.attempt is None)
        await until(pilot, lambda: "the data recorded so far are kept in" in notices_text(app))
        assert step.missing().startswith("Capture needs a device")
        (partial,) = recorded(app)
        assert not info(partial).complete
        assert info(partial).samples >= seen
        whole = partial.with_name("whole.mcap")
        assert recover(partial, whole) >= seen
        assert load_run(whole).pose == "X1"

        port.plug()
        step.options = SECOND
        await pilot.press("c")
        await until(pilot, lambda: app.device.connected)
        await to_judged(pilot, until, step)
        await pilot.press("k")
        await until(pilot, lambda: len(app.workspace.runs) == 1)
    assert partial.exists()


@pytest.mark.slow
async def test_quitting_before_a_swing_is_kept_asks_and_the_next_start_offers_it(app: DprApp, until, tmp_path) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        run = await to_judged(pilot, until, step)
        await pilot.press("ctrl+q")
        assert isinstance(app.screen, Question)
        assert f"the file of {run_name(run)} is kept, and the next session asks again (k in Capture keeps it)" in str(
            app.screen.query_one(Static).render()
        )
        await pilot.press("y")
    workspace, notices = load(tmp_path / "state")
    assert workspace.runs == []
    again = DprApp(workspace, tmp_path / "state", notices=notices)
    async with again.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: again.current.NAME == "Capture")
        assert f"{run_name(run)}: not decided yet. k: keep it" in headline(again)
        await pilot.press("k")
        await pilot.pause()
        assert again.workspace.runs == [run]
        assert again.workspace.undecided is None

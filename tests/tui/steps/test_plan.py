"""Step 7: a ranked list of releases, and a proposal that becomes the next pose of Capture, released by the operator."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console
from textual.app import App
from textual.widgets import DataTable, Input, Static

from dpr_lab.planning.result import Plan
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.storage.reader import load_run
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.steps.plan import PlanStep
from dpr_lab.tui.steps.rig import RigStep
from dpr_lab.tui.workspace import Workspace
from dpr_lab.workflows.planned_rigs import planned_rigs
from tests.tui.conftest import Watched
from tests.tui.steps.releases import connected

SHORT = "[recording]\nshortest_s = 2.0\nlongest_s = 2.0\n"


def paper_text() -> str:
    path = load_rig("paper").path
    assert path is not None
    return path.read_text()


def text(app: App[None], widget: str) -> str:
    console = Console(width=100, color_system=None, markup=False)
    with console.capture() as captured:
        console.print(app.query_one(widget, Static).content)
    return " ".join(captured.get().split())


def step(app: App[None]) -> PlanStep:
    return app.query_one(PlanStep)


async def planned(pilot, until, folder: Path, limits: str = SHORT, budget: str = "") -> None:
    """Plan with a limits file."""
    file = folder / "limits.toml"
    file.write_text(limits)
    step(pilot.app).query_one("#limits", Input).value = str(file)
    step(pilot.app).query_one("#budget", Input).value = budget
    step(pilot.app).focus()
    await pilot.press("s")
    await until(pilot, lambda: step(pilot.app).job is None)


@pytest.mark.slow
async def test_a_first_plan_is_a_list_with_reasons_and_a_release_of_it_becomes_the_next_pose(
    lab, until, tmp_path: Path
) -> None:
    async with lab(RigStep, CaptureStep, PlanStep, step="Plan") as pilot:
        app = pilot.app
        limit = '[friction.joint1]\nmax = 0.01\nspeed_rad_s = 3.0\nunit = "N m"\n'
        await planned(pilot, until, tmp_path, SHORT + limit)
        made = json.loads((app.workspace.out / "plan" / "plan.json").read_text())
        assert " ".join(text(app, "#state").split()) == made["sentence"]
        releases = app.query_one(DataTable)
        assert releases.row_count == len(made["releases"]) == 3
        assert "P(decided)" not in [str(column.label) for column in releases.columns.values()]
        whole = Plan.model_validate({name: value for name, value in made.items() if name != "files"})
        result = step(app).result
        assert result is not None
        step(app).show(replace(result, plan=whole.model_copy(update={"releases": []})))
        assert not releases.display  # no header of an empty list
        step(app).show(result)
        assert releases.display
        await pilot.press("down")
        second = made["releases"][1]
        assert f"reason: {second['reason']}" in text(app, "#details")
        assert "friction of joint1 up to 3 rad/s" in text(app, "#details")
        await pilot.press("A")
        await pilot.pause()
        assert "P2 for 2 s is the next release of Capture: press 3" in text(app, "#state")
        await pilot.press("2")
        capture = app.query_one(CaptureStep)
        assert (capture._pose, capture.options.duration, capture.attempt) == ("P2", 2.0, None)
        assert app.workspace.next_pose == ""
        assert load_rig(app.workspace.rig).poses["P2"].theta1 == pytest.approx(second["theta1_rad"], abs=1e-4)
        await pilot.press("1")
        assert app.query_one("#rig_file", Input).value == app.workspace.rig


@pytest.mark.long
async def test_a_release_of_one_rod_has_one_start_angle(lab, until, tmp_path: Path) -> None:
    one_rod = tmp_path / "one_rod.toml"
    one_rod.write_text(paper_text() + '\n[rods]\nmounted = "inner"\n')
    async with lab(PlanStep) as pilot:
        pilot.app.workspace.rig = str(one_rod)
        await planned(pilot, until, tmp_path, budget="40s")
        row = [str(cell) for cell in pilot.app.query_one(DataTable).get_row_at(0)]
        assert row[1].count("°") == 1


@pytest.mark.slow
async def test_a_release_is_recorded_under_the_rig_file_that_describes_its_mass(
    lab, until, notices_text, tmp_path: Path
) -> None:
    with_mass = tmp_path / "loaded.toml"
    with_mass.write_text(paper_text() + '\n[added_mass]\nrod = "outer"\nmass = 0.1\nposition = 0.2\n')
    async with lab(PlanStep) as pilot:
        await planned(pilot, until, tmp_path, budget="40s")
        before, pilot.app.workspace.rig = pilot.app.workspace.rig, str(with_mass)
        await pilot.press("A")
        await pilot.pause()
        assert "the rig file describes other rods or masses" in notices_text(pilot.app)
        assert (pilot.app.workspace.rig, pilot.app.workspace.next_pose) == (str(with_mass), "")
        pilot.app.workspace.rig = before
        planner = step(pilot.app)
        made = planner.result
        assert made is not None
        first = made.plan.releases[0]
        mass = AddedMass(rod="outer", mass=0.1, position=0.2)
        loaded = first.model_copy(update={"added_mass": mass, "text": "with 100 g on the outer rod"})
        files = planned_rigs({"P1": loaded}, load_rig("paper"), tmp_path / "rig.toml")
        loaded = loaded.model_copy(update={"rig": str(files["P1"])})
        planner.show(replace(made, plan=made.plan.model_copy(update={"releases": [loaded]})))
        await pilot.press("A")
        await pilot.pause()
        assert load_rig(pilot.app.workspace.rig).added_mass == mass
        assert pilot.app.workspace.next_pose == "P1"
        assert "100 g on the outer rod" in text(pilot.app, "#state")


async def test_wrong_limits_and_budgets_are_refused_in_words(lab, until, notices_text, tmp_path: Path) -> None:
    async with lab(PlanStep) as pilot:
        for limits, budget, words in (
            ("[recrding]\n", "", "recrding: unknown key; nearest of 11: recording"),
            (SHORT, "1s", "is too small: one release takes"),
            (SHORT, "soon", "give one such as 10min"),
        ):
            await planned(pilot, until, tmp_path, limits, budget)
            assert words in notices_text(pilot.app)
            pilot.app.clear_notifications()
        assert step(pilot.app).outcome() == ""


@pytest.mark.parametrize(
    ("state", "count", "outcome"),
    [
        ("enough", 0, "enough"),
        ("enough", 1, "enough, 1 optional"),
        ("bench check", 1, "bench check, 1 optional"),
        ("record", 3, "3 to record"),
    ],
)
def test_the_outcome_of_a_plan_names_optional_releases(state: str, count: int, outcome: str) -> None:
    result: Any = SimpleNamespace(plan=SimpleNamespace(state=state, releases=[None] * count))
    page: Any = SimpleNamespace(result=result)
    assert PlanStep.outcome(page) == outcome


def test_new_poses_leave_results_valid_and_another_rod_does_not(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text(paper_text())
    before = Workspace(rig=str(rig)).basis()["the rig"]
    more = tmp_path / "more.toml"
    more.write_text(rig.read_text() + "\n[poses.P1]\ntheta1 = 1.0\ntheta2 = 2.0\n")
    assert Workspace(rig=str(more)).basis()["the rig"] == before == Workspace(rig="paper").basis()["the rig"]
    more.write_text(rig.read_text().replace("L1 = 0.4", "L1 = 0.41"))
    assert more.read_text() != rig.read_text()
    assert Workspace(rig=str(more)).basis()["the rig"] != before


@pytest.mark.slow
@pytest.mark.usefixtures("quick_countdown")
async def test_the_taken_release_is_recorded_only_by_the_release_key(until, tmp_path: Path) -> None:
    bench = Workspace(out=tmp_path / "bench", link="sim://?seed=1")
    app = DprApp(bench, tmp_path / "state", steps=(CaptureStep, PlanStep), sight=Watched())
    async with app.run_test(size=(100, 30)) as pilot:
        await app.services.connect()
        await connected(pilot, until)
        await pilot.press("2")
        await planned(pilot, until, tmp_path, SHORT, "40s")
        await pilot.press("A")
        await until(pilot, lambda: app.device.connected and app.workspace.next_pose == "P1")
        await pilot.press("1")
        capture = app.query_one(CaptureStep)
        capture.options = replace(capture.options, pose_timeout=600.0, rest_timeout=60.0)
        assert (capture.attempt, app.device.ordered) == (None, None)
        await pilot.press("s")
        await until(pilot, lambda: capture.attempt is not None and capture.attempt.phase is Phase.READY)
        assert capture.attempt is not None
        assert capture.attempt.name == "P1"
        await pilot.press("r")
        await until(pilot, lambda: capture.attempt is not None and capture.attempt.phase is Phase.JUDGED)
        await pilot.press("k")
        await until(pilot, lambda: app.workspace.runs)
    run = load_run(app.workspace.runs[0])
    assert run.pose == "P1"
    assert run.t[-1] == pytest.approx(2.0, abs=0.01)

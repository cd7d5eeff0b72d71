"""Step 4: from selected runs to a saved model, with stop, cancel, and error messages."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from textual.app import App
from textual.widgets import Input, Select, Static, TabbedContent

from dpr_lab.identification.model import Model, load_model
from dpr_lab.rig import Rig
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.writer import RunWriter
from dpr_lab.tui.steps.compare import CompareStep
from dpr_lab.tui.steps.identify import IdentifyStep


def text(app: App[None], widget: str) -> str:
    console = Console(width=100, color_system=None)
    with console.capture() as captured:
        console.print(app.query_one(widget, Static).content)
    return captured.get()


def step(app: App[None]) -> IdentifyStep:
    return app.query_one(IdentifyStep)


def test_the_help_holds_for_every_rig_and_explains_its_symbols() -> None:
    words = " ".join(IdentifyStep.HELP.split())
    titles = "*Nine parameters* (*Parameters* for a single rod, *Absolute values* with a free or driven arm)"
    assert titles in words  # the three titles of the tab
    assert "squared errors of all angles and speeds, which the publication calls E(Z)" in words


@pytest.mark.slow
async def test_from_runs_to_a_saved_model(lab, until, recorded: list[Path]) -> None:
    async with lab(IdentifyStep, runs=recorded) as pilot:
        await pilot.press("s")
        assert step(pilot.app).at_stake() == "The current identification ends without a result."
        await until(pilot, lambda: step(pilot.app).job is None)
        bench = pilot.app.workspace
        assert bench.model == bench.out / "model.json"
        model = load_model(bench.model)
        assert [Path(run.file) for run in model.runs] == recorded
        assert model.fit.chi2_per_dof < 1.3
        assert "The residual is at the noise floor" in text(pilot.app, "#state")
        assert all(name in text(pilot.app, "#ratios-text") for name in model.ratios)
        assert "only its bounds" in text(pilot.app, "#nine-text")
        assert "The recordings determine 5 of 9 combinations of parameters" in text(pilot.app, "#seen-text")
        assert "Additional measurements on the bench" in text(pilot.app, "#seen-text")
        assert step(pilot.app).outcome() == "model of 3 runs"
        assert step(pilot.app).at_stake() == ""
        assert json.loads((pilot.app.folder / "bench.json").read_text())["model"] == str(bench.model)


@pytest.mark.slow
async def test_a_stopped_search_keeps_its_best(lab, until, recorded: list[Path]) -> None:
    async with lab(IdentifyStep, runs=recorded[:1]) as pilot:
        pilot.app.query_one("#objective", Select).value = "paper"
        await pilot.press("s")
        await until(pilot, lambda: len(step(pilot.app)._history) >= 3)
        await pilot.press("x")
        await until(pilot, lambda: step(pilot.app).job is None)
        model = step(pilot.app).result
        assert isinstance(model, Model)
        assert model.search.generations < 1000
        assert model.search.objective == "paper"
        assert pilot.app.workspace.model.is_file()


@pytest.mark.long
async def test_a_model_that_appears_meanwhile_is_reported_and_loaded(lab, until, recorded: list[Path]) -> None:
    async with lab(IdentifyStep, CompareStep, runs=recorded) as pilot:
        await pilot.press("s", "n")
        compare = pilot.app.query_one(CompareStep)
        assert "identify one in step 4" in compare.missing()
        await until(pilot, lambda: pilot.app.notices)
        (notice,) = pilot.app.notices
        assert notice.message == "Identify is done: model of 3 runs"
        await until(pilot, compare.outcome)


@pytest.mark.slow
async def test_cancelling_keeps_the_model_from_before(lab, until, recorded: list[Path], fixed_model: Path) -> None:
    async with lab(IdentifyStep, runs=recorded, model=fixed_model) as pilot:
        pilot.app.query_one("#objective", Select).value = "paper"
        await pilot.press("s")
        await until(pilot, lambda: len(step(pilot.app)._history) >= 1)
        await pilot.press("X")
        await until(pilot, lambda: step(pilot.app).job is None)
        assert "cancelled" in text(pilot.app, "#state")
        assert pilot.app.workspace.model == fixed_model
        assert not (pilot.app.workspace.out / "model.json").exists()


@pytest.mark.long
async def test_a_run_that_cannot_be_read_is_named(lab, until, recorded: list[Path], tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(recorded[0].read_bytes()[:3000])
    async with lab(IdentifyStep, runs=[broken]) as pilot:
        await pilot.press("s")
        await until(pilot, lambda: step(pilot.app).job is None)
        (notice,) = pilot.app.notices
        assert str(broken) in notice.message
        assert str(broken) in text(pilot.app, "#state")


@pytest.mark.long
async def test_a_recording_chosen_twice_is_refused(lab, until, recorded: list[Path], tmp_path: Path) -> None:
    copy = Path(shutil.copy(recorded[0], tmp_path / "copy.mcap"))
    async with lab(IdentifyStep, runs=[*recorded, copy]) as pilot:
        await pilot.press("s")
        await until(pilot, lambda: step(pilot.app).job is None)
        (notice,) = pilot.app.notices
        assert f"{copy}: is the same recording as {recorded[0]}" in notice.message
        assert pilot.app.workspace.model is None


async def test_without_runs_the_screen_names_the_step_that_comes_first(lab) -> None:
    async with lab(IdentifyStep) as pilot:
        assert "No runs selected" in step(pilot.app).missing()
        await pilot.press("s")
        assert step(pilot.app).job is None
        (notice,) = pilot.app.notices
        assert "No runs selected" in notice.message


async def test_an_invalid_seed_is_refused(lab) -> None:
    async with lab(IdentifyStep, runs=[Path("X1.mcap")]) as pilot:
        pilot.app.query_one("#seed", Input).value = "-1"
        await pilot.press("s")
        assert step(pilot.app).job is None
        (notice,) = pilot.app.notices
        assert "seed = '-1'" in notice.message


@pytest.mark.slow
async def test_the_bench_is_resumed_with_its_model(lab, fixed_model: Path) -> None:
    async with lab(IdentifyStep, runs=[Path("X1.mcap")], model=fixed_model) as pilot:
        assert step(pilot.app).outcome() == "model of 3 runs"
        assert "used other runs than those selected" in text(pilot.app, "#state")
        await pilot.press("v")
        assert pilot.app.query_one(TabbedContent).active == "ratios"
        pilot.app.query_one(TabbedContent).active = "convergence"  # as a start does: what had the focus is gone
        step(pilot.app).call_after_refresh(step(pilot.app).take_keys)
        await pilot.pause()
        assert {"s", "v"} <= pilot.app.screen.active_bindings.keys()


async def test_search_and_objective_stand_in_words_before_their_identifiers(lab, tmp_path: Path) -> None:
    async with lab(IdentifyStep) as pilot:
        shown = [str(pilot.app.query_one(f"#{name} Static#label", Static).render()) for name in ("objective", "search")]
        assert shown == ["short segments, insensitive to chaos [segments]", "improved genetic algorithm [iga]"]
        assert pilot.app.query_one("#search", Select).value == "iga"


async def test_a_damaged_model_is_reported_and_the_step_continues(lab, tmp_path: Path) -> None:
    broken = tmp_path / "model.json"
    broken.write_text("{}")
    async with lab(IdentifyStep, model=broken) as pilot:
        (notice,) = pilot.app.notices
        assert "is not a model of dpr-lab" in notice.message
        assert step(pilot.app).job is None


@pytest.mark.slow
async def test_its_snapshot_is_unchanged(lab, snapshot, fixed_model: Path) -> None:
    async with lab(IdentifyStep, model=fixed_model) as pilot:
        for view in ("convergence", "ratios", "nine"):
            await snapshot(pilot, f"identify-{view}")
            await pilot.press("v")


async def test_torques_are_chosen_where_runs_hold_both_kinds(
    lab, recorded: list[Path], paper: Rig, tmp_path: Path
) -> None:
    with RunWriter(
        tmp_path / "both.mcap", RunMetadata(paper, None, 100.0, extra={"torque_kind": "measured"})
    ) as writer:
        writer.samples(np.arange(9), np.full((9, 3), 8192), np.ones((2, 9, 2)))
        writer.finish(RunSummary(release_tick=0))
    async with lab(IdentifyStep, runs=[tmp_path / "both.mcap"]) as pilot:
        await pilot.press("T")
        assert "selected: commanded torques for runs that contain both kinds; s: run again" in text(pilot.app, "#state")
        bench = pilot.app.workspace
        assert (bench.driven_by, bench.basis()["the torques"]) == ("commanded", "commanded")
        assert json.loads((pilot.app.folder / "bench.json").read_text())["torque"] == "commanded"
        bench.runs = recorded[:1]
        assert bench.driven_by is None
        assert not step(pilot.app).check_action("torque", ())

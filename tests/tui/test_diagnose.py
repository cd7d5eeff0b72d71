"""Step 6: the verdict first, then which, where, how far, and what next; saved as the command saves it."""

import json
from pathlib import Path

import pytest
from rich.console import Console
from textual.app import App
from textual.widgets import Input, Select, Static, TabbedContent

from dpr_lab.tui.chart import Chart
from dpr_lab.tui.diagnose import DiagnoseStep, load_diagnosis


def step(app: App[None]) -> DiagnoseStep:
    return app.query_one(DiagnoseStep)


def text(app: App[None], widget: str) -> str:
    console = Console(width=100, color_system=None)
    with console.capture() as captured:
        console.print(app.query_one(widget, Static).content)
    return captured.get()


@pytest.mark.slow
async def test_from_runs_to_a_saved_diagnosis(lab, until, recorded: list[Path], modelled: Path) -> None:
    async with lab(DiagnoseStep, runs=recorded, model=modelled) as pilot:
        pilot.app.query_one("#held-out", Select).value = 2
        await pilot.press("s")
        await until(pilot, lambda: "step" in text(pilot.app, "#state"))
        assert step(pilot.app).at_stake() == "the diagnosis that is running"
        await until(pilot, lambda: step(pilot.app).job is None)
        folder = pilot.app.bench.out / "diagnosis"
        assert pilot.app.bench.diagnosis == folder / "diagnosis.json"
        saved = json.loads(pilot.app.bench.diagnosis.read_text())
        assert set(saved["gap"]["closed_held_out"]["per_run"]) == {run.stem for run in recorded[:2]}
        assert set(saved["gap"]["closed_held_out"]["held_out"]) == {recorded[2].stem}
        assert all(Path(file).is_file() for file in saved["files"].values())
        assert (folder / "diagnosis.html").is_file()
        assert (folder / "where.png").read_bytes().startswith(b"\x89PNG")
        assert load_diagnosis(pilot.app.bench.diagnosis).verdict == saved["verdict"]
        assert step(pilot.app).outcome() == saved["verdict"].replace("_", " ")
        assert " ".join(text(pilot.app, "#state").split()) == saved["sentence"]


@pytest.mark.slow
async def test_cancelling_leaves_nothing_half_written(lab, until, recorded: list[Path]) -> None:
    async with lab(DiagnoseStep, runs=recorded) as pilot:
        await pilot.press("s")
        await until(pilot, lambda: "step" in text(pilot.app, "#state"))
        await pilot.press("c")
        await until(pilot, lambda: step(pilot.app).job is None)
        assert "cancelled" in text(pilot.app, "#state")
        assert pilot.app.bench.diagnosis is None
        assert not (pilot.app.bench.out / "diagnosis" / "diagnosis.json").exists()


async def test_a_diagnosis_is_resumed_with_all_that_it_says(lab, fixed_diagnosis: Path) -> None:
    found = load_diagnosis(fixed_diagnosis)
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        assert " ".join(text(pilot.app, "#state").split()) == found.sentence
        for effect in found.effects:
            assert f"{effect.name}: probability {effect.probability:.0%}" in text(pilot.app, "#which-text")
            assert f"+ {effect.name}" in text(pilot.app, "#far-text")
        low, high = found.gap.closed_held_out.interval90
        said = " ".join(text(pilot.app, "#far-text").split())
        assert f"90 % interval {low:.1%} to {high:.1%}" in said
        assert "┊ is the noise floor" in said
        for advice in found.advice:
            assert advice in " ".join(text(pilot.app, "#next-text").split())
        assert step(pilot.app).outcome() == "named"


async def test_the_map_of_every_place_is_one_key_away(lab, settled, fixed_diagnosis: Path) -> None:
    found = load_diagnosis(fixed_diagnosis)
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis) as pilot:
        for place in [*found.where[1:], found.where[0]]:
            await pilot.press("o")
            await settled(pilot)
            assert pilot.app.query_one(TabbedContent).active == "where"
            assert place.sentence in " ".join(text(pilot.app, "#place-said").split())
            drawn = pilot.app.query_one("#place-map", Chart)._content
            assert drawn.series[-1].x.tolist() == place.knots
            assert (place.coordinate == "time") == ("time" in drawn.x_label)


async def test_the_only_run_cannot_be_held_out(lab) -> None:
    async with lab(DiagnoseStep, runs=[Path("X1.mcap")]) as pilot:
        pilot.app.query_one("#held-out", Select).value = 0
        await pilot.press("s")
        assert step(pilot.app).job is None
        (notice,) = pilot.app._notifications
        assert "hold out none" in notice.message


@pytest.mark.parametrize(("field", "value"), [("max-effects", "9"), ("max-effects", ""), ("seed", "-3")])
async def test_numbers_out_of_range_are_refused(lab, field: str, value: str) -> None:
    async with lab(DiagnoseStep, runs=[Path("X1.mcap")]) as pilot:
        pilot.app.query_one(f"#{field}", Input).value = value
        await pilot.press("s")
        assert step(pilot.app).job is None
        (notice,) = pilot.app._notifications
        assert f"{field} = {value!r}" in notice.message


@pytest.mark.parametrize(
    ("content", "said"),
    [("{", "is not a diagnosis"), ("[1]", "is not a diagnosis"), ('{"verdict": "named"}', "sentence: Field required")],
)
async def test_a_damaged_diagnosis_is_told_and_the_step_lives_on(lab, tmp_path: Path, content: str, said: str) -> None:
    broken = tmp_path / "diagnosis.json"
    broken.write_text(content)
    async with lab(DiagnoseStep, diagnosis=broken) as pilot:
        (notice,) = pilot.app._notifications
        assert said in notice.message
        assert step(pilot.app).outcome() == ""


@pytest.mark.parametrize(("theme", "views"), [("dpr-dark", ("which", "where", "far")), ("dpr-light", ("which",))])
async def test_its_looks(lab, settled, snapshot, theme: str, views: tuple[str, ...], fixed_diagnosis: Path) -> None:
    async with lab(DiagnoseStep, diagnosis=fixed_diagnosis, theme=theme) as pilot:
        for view in views:
            await settled(pilot)
            snapshot(pilot.app, f"diagnose-{view}-{theme}")
            await pilot.press("v")

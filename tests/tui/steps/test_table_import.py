"""Import of a recording of another logger: options, preview, and confirmation of warnings."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Static

from dpr_lab.errors import RunError
from dpr_lab.storage.csv_import import ImportOptions
from dpr_lab.storage.reader import load_run
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.steps.rig import RigStep
from dpr_lab.tui.steps.table_import import TableImport
from dpr_lab.tui.steps.table_options import option_list, parse_options
from dpr_lab.tui.widgets.dialogs import Question
from dpr_lab.tui.widgets.run_browser import RunBrowser


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "swing.csv"
    t = np.arange(600) * 0.005
    theta = np.degrees([0.4 * np.cos(5 * t), 0.55 * np.cos(5 * t)])  # a small swing about hanging
    rows = [f"{now:.3f},{inner:.6f},{outer:.6f}\n" for now, inner, outer in zip(t, *theta, strict=True)]
    file.write_text("t,theta1,theta2\n" + "".join(rows))
    return file


def understood(pilot: Pilot[None]) -> str:
    return str(pilot.app.screen.query_one("#understood", Static).content)


async def preview(pilot: Pilot[None], until, file: Path, options: str) -> None:
    pilot.app.screen.query_one("#table", Input).value = str(file)
    pilot.app.screen.query_one("#options", Input).value = options
    await pilot.press("enter")
    await until(pilot, lambda: "rows in" in understood(pilot) or "rows," in understood(pilot))


def test_every_field_of_the_import_is_an_option_of_the_screen() -> None:
    flags = [text.split()[0] for text in option_list()]
    assert flags[: len(fields(ImportOptions))] == [f"--{f.name.replace('_', '-')}" for f in fields(ImportOptions)]
    assert flags[-2:] == ["--rods", "--elbow"]


def test_options_are_read_as_the_command_reads_them() -> None:
    options, _ = parse_options(
        "--angles relative --unit deg --columns 't=my time,theta1=a' --scale -1 --offset theta2=90"
    )
    assert options == ImportOptions(
        angles="relative",
        unit="deg",
        time_unit=None,
        columns={"t": "my time", "theta1": "a"},
        scale={"theta1": -1.0, "theta2": -1.0},
        offset={"theta2": 90.0},
    )
    assert parse_options("--rods inner --torque none") == (ImportOptions(torque="none"), {"rods": "inner"})


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("backwards", "no such option: backwards"),
        ("--unit kg", "--unit: invalid choice: 'kg'"),
        ("--columns a", "columns must be name=column pairs, .* not 'a'"),
        ("--scale x", "scale must be a number or theta1=-1,theta2=0.5, not 'x'"),
        ("--rate-hz 0", "rate_hz must be above 0 and finite, not 0"),
        ("--columns 't", "a quotation mark is missing"),
    ],
)
def test_an_option_that_there_is_not_is_a_sentence(text: str, why: str) -> None:
    with pytest.raises(RunError, match=why):
        parse_options(text)


@pytest.mark.slow
async def test_a_warning_is_confirmed_before_the_run_is_used(lab, until, table: Path) -> None:
    # 170 degrees were imported as 170 rad and selected for identification.
    async with lab(CaptureStep) as pilot:
        app: DprApp = pilot.app
        assert "f5 imports a table" in app.steps[0].missing()
        await pilot.press("f5")
        assert isinstance(app.screen, TableImport)
        await pilot.press("ctrl+s")
        await until(pilot, lambda: "no table is given" in understood(pilot))
        await preview(pilot, until, table, "--unit deg --scale 1")
        assert "deg, absolute, upright is 0" in understood(pilot)
        assert "warning: " in understood(pilot)
        await pilot.press("ctrl+s")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("n")
        await until(pilot, lambda: isinstance(app.screen, TableImport))
        assert app.workspace.runs == []
        assert not list(app.workspace.out.rglob("*.mcap"))
        await pilot.press("ctrl+s")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await until(pilot, lambda: len(app.workspace.runs) == 1)


@pytest.mark.slow
async def test_nothing_is_imported_that_the_preview_did_not_show(lab, until, table: Path, notices_text) -> None:
    async with lab(RigStep) as pilot:
        app: DprApp = pilot.app
        app.query_one("#rig_file", Input).value = str(table)
        await pilot.press("u")
        await until(pilot, lambda: isinstance(app.screen, TableImport))
        await until(pilot, lambda: "rad, absolute, upright is 0" in understood(pilot))
        assert app.query_one("#rig_file", Input).value == app.workspace.rig
        app.screen.query_one("#options", Input).value = "--zero hanging --unit deg"
        await pilot.press("ctrl+s")
        await until(pilot, lambda: "deg, absolute, hanging is 0" in understood(pilot))
        assert "check it, then import" in notices_text(app)
        assert app.workspace.runs == []
        await pilot.press("ctrl+s")
        await until(pilot, lambda: isinstance(app.screen, Question) or app.workspace.runs)
        if isinstance(app.screen, Question):
            await pilot.press("y")
        await until(pilot, lambda: len(app.workspace.runs) == 1)
        assert "selected for identification" in notices_text(app)
        run = load_run(app.workspace.runs[-1])
        assert run.theta[0, 1] == pytest.approx(3.1415926 + 0.4, abs=1e-4)


@pytest.mark.slow
async def test_the_run_browser_and_the_palette_have_an_entry_for_it(lab, until) -> None:
    async with lab(RigStep) as pilot:
        app: DprApp = pilot.app
        commands = {command.title: command.help for command in app.get_system_commands(app.screen)}
        assert commands["dpr-lab: import a table"] == "key f5"
        await pilot.press("b")
        assert isinstance(app.screen, RunBrowser)
        await pilot.press("f5")
        await until(pilot, lambda: isinstance(app.screen, TableImport))
        await pilot.press("escape")
        await until(pilot, lambda: len(app.screen_stack) == 1)


@pytest.mark.slow
async def test_enter_after_the_path_leads_to_the_options(lab, until, table: Path) -> None:
    async with lab(RigStep) as pilot:
        app: DprApp = pilot.app
        await pilot.press("f5")
        await until(pilot, lambda: isinstance(app.screen, TableImport))
        app.screen.query_one("#table", Input).value = "/no/such/table.csv"
        await pilot.press("enter")
        await until(pilot, lambda: "/no/such/table.csv" in understood(pilot))
        assert app.screen.focused is app.screen.query_one("#table", Input)
        app.screen.query_one("#table", Input).value = str(table)
        await pilot.press("enter")
        await until(pilot, lambda: "rad, absolute, upright is 0" in understood(pilot))
        await pilot.press(*"--unit deg", "enter")
        await until(pilot, lambda: "deg, absolute, upright is 0" in understood(pilot))

"""App around the steps: navigation, help, quitting, errors, themes."""

import os
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import pytest
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.screen import Screen
from textual.widgets import Input, Static

from dpr_lab.errors import LinkError
from dpr_lab.tui.app import STEPS, DprApp
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.widgets.dialogs import HelpScreen, Question
from dpr_lab.tui.widgets.stepper import Stepper
from dpr_lab.tui.workspace import Workspace
from tests.thinned import thinned


class Faulty(Step):
    NAME = "Faulty"
    HELP = "It *fails*."
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("w", "wrong", "Wrong", id="faulty.wrong"),
        Binding("y", "bug", "Bug", id="faulty.bug"),
        Binding("z", "handler", "Handler", id="faulty.handler"),
    ]
    stake = ""

    class Asked(Step.Done):
        """Message for a handler that fails."""

    def compose(self) -> ComposeResult:
        yield Static("content")
        yield Input()

    def action_wrong(self) -> None:
        raise LinkError("[red]no cable[/red]: plug it in")

    def action_bug(self) -> None:
        raise ZeroDivisionError("sums")

    def action_handler(self) -> None:
        self.post_message(self.Asked())

    def on_faulty_asked(self) -> None:
        raise KeyError("handler")

    def at_stake(self) -> str:
        return self.stake


def faulty(tmp_path: Path) -> DprApp:
    return DprApp(Workspace(out=tmp_path), tmp_path / "state", steps=(Faulty,))


def stepper(app: DprApp) -> str:
    return str(app.query_one(Stepper).render())


@pytest.mark.slow
@pytest.mark.parametrize("size", [(80, 24), pytest.param((160, 48), marks=pytest.mark.long)], ids=str)
async def test_every_step_is_reached_by_number_and_by_next(tmp_path: Path, size: tuple[int, int]) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=size) as pilot:
        for number, step in enumerate(STEPS, 1):
            await pilot.press(str(number))
            assert app.current.NAME == step.NAME
            assert f"▶{number} {step.NAME}" in stepper(app)
        await pilot.press("p", "ctrl+left")
        assert app.current.NAME == "Compare"
        await pilot.press("n")
        assert app.current.NAME == "Diagnose"
        for _ in range(3):
            await pilot.press("n")
        assert app.current.NAME == "Plan"


@pytest.mark.slow
async def test_a_step_never_shows_without_its_own_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # On a busy machine RELEASE stood at the foot of Identify for a second.
    drawn: list[list[str]] = []

    def display(app: DprApp, screen: Screen[object], renderable: object) -> None:
        drawn.append([strip.text for strip in screen._compositor.render_strips()])

    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        monkeypatch.setattr(DprApp, "_display", display)
        await pilot.press("3", "4", "6", "1")
    for step, keys in {"▶3": "s Start r RELEASE", "▶4": "s Start v View", "▶6": "s Start h Hold", "▶1": "c Co"}.items():
        frames = [rows[-1] for rows in drawn[1:] if step in rows[0]]
        assert frames
        assert all(row.startswith(keys) for row in frames), (step, frames)


@pytest.mark.long
async def test_a_click_on_the_stepper_goes_there(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.click(Stepper, offset=(16, 0))
        await pilot.pause()
        assert app.current.NAME == "Rig"


async def test_the_stepper_names_what_is_missing(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        await pilot.pause()
        assert "Capture needs a device: press 1 and connect one" in stepper(app)
        assert "✔2 Rig" in stepper(app)


async def test_an_unreadable_rig_file_is_reported_without_a_crash(app: DprApp, notices_text) -> None:
    app.workspace.rig = "no_such_rig.toml"
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2")
        assert "no_such_rig.toml: is neither a file nor the name" in str(app.query_one("#description", Static).render())
        await pilot.press("3")
        assert app.current.NAME == "Capture"
        assert "no_such_rig.toml: is neither a file nor the name" in notices_text(app)
        assert app.current.missing() == "Capture needs a rig file that can be read: press 2 and choose one"


async def test_errors_become_notices_and_the_app_continues(tmp_path: Path, notices_text) -> None:
    app = faulty(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("w")
        assert "[red]no cable[/red]: plug it in" in notices_text(app)
        await pilot.press("escape")
        assert notices_text(app) == ""
        for key, name in (("y", "ZeroDivisionError: sums"), ("z", "KeyError: 'handler'")):
            await pilot.press(key)
            await pilot.pause()
            assert f"Unexpected: {name}" in notices_text(app)
        await pilot.press("escape", "z")
        await pilot.pause()
        assert notices_text(app).count("KeyError") == 1  # the step still hears
    log = (tmp_path / "state" / "errors.log").read_text()
    assert "in action_bug" in log
    assert "in on_faulty_asked" in log


@pytest.mark.slow
async def test_help_shows_the_step_and_its_keys(tmp_path: Path) -> None:
    app = faulty(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        for key in ("f1", "question_mark"):
            await pilot.press(key)
            assert isinstance(app.screen, HelpScreen)
            await pilot.pause()
            shown = app.export_screenshot()
            assert "Faulty" in shown
            assert "Wrong" in shown
            await pilot.press("escape")
            assert not isinstance(app.screen, HelpScreen)


async def test_quitting_asks_only_when_something_would_be_lost(until, tmp_path: Path) -> None:
    app = faulty(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        faulty_step = app.query_one(Faulty)
        faulty_step.stake = "The search ends without a result."
        await pilot.press("ctrl+q")
        await until(pilot, lambda: isinstance(app.screen, Question))
        assert "Quit now? The search ends without a result." in str(app.screen.query_one(Static).render())
        await pilot.press("n")
        assert app.is_running
        assert not isinstance(app.screen, Question)
        await pilot.press("ctrl+q")
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await pilot.pause()
        assert app.return_code == 0
    calm = faulty(tmp_path)
    async with calm.run_test(size=(80, 24)) as pilot:
        await pilot.press("ctrl+q")
        assert calm.return_code == 0


async def test_a_field_takes_letters_and_escape_leaves_it(tmp_path: Path) -> None:
    app = faulty(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        app.query_one(Input).focus()
        await pilot.press("n", "1", "t")
        assert app.query_one(Input).value == "n1t"
        await pilot.press("escape")
        assert app.focused is app.current


async def test_steps_are_in_the_command_palette(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)):
        titles = [command.title for command in app.get_system_commands(app.screen)]
    assert "3 Capture" in titles


@pytest.mark.slow
async def test_every_action_is_in_the_command_palette_with_its_key(tmp_path: Path) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(80, 24)):
        keyed = [c.title.lower() for c in app.get_system_commands(app.screen) if c.help.startswith("key ")]
    for word in ("record", "release", "report", "export", "compare", "link", "degrees"):
        assert any(word in title for title in keyed), word


@pytest.mark.slow
async def test_the_palette_goes_to_the_step_and_acts_there(tmp_path: Path, notices_text) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        (release,) = (c for c in app.get_system_commands(app.screen) if c.title == "Capture: release the rods")
        await release.callback()
        await pilot.pause()
        assert app.current.NAME == "Capture"
        assert "press s to be guided to the pose first" in notices_text(app)


@pytest.mark.slow
async def test_a_screenshot_is_saved_next_to_the_results_or_the_reason_is_shown(tmp_path: Path, notices_text) -> None:
    app = DprApp(Workspace(out=tmp_path / "bench"), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        app.deliver_screenshot()
        assert len(list((tmp_path / "bench" / "screenshots").glob("*.svg"))) == 1
        app.workspace.out = tmp_path / "file"
        app.workspace.out.write_text("")
        app.deliver_screenshot()
        await pilot.pause()
        assert "the screenshot cannot be saved" in notices_text(app)


@pytest.mark.slow
async def test_a_screen_that_is_too_small_reports_it_and_still_shows_the_state_of_the_rig(
    tmp_path: Path, until
) -> None:
    # At 60x20 the line with the latch was lost.
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(60, 20)) as pilot:
        await pilot.pause()
        assert "60x20 is too small: the screen needs 80x24" in str(app.query_one("#too-small", Static).render())
        await until(pilot, lambda: "no&#160;device" in app.export_screenshot())
        assert "Connect" not in app.export_screenshot()
        await pilot.resize_terminal(80, 24)
        await until(pilot, lambda: not app.query_one("#too-small").display)


@pytest.mark.slow
async def test_after_the_window_was_too_small_the_keys_work_again(tmp_path: Path, until, notices_text) -> None:
    # The step had lost the focus: "r does nothing here now", below "Press r to RELEASE".
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state", steps=STEPS[:3])
    async with app.run_test(size=(80, 24)) as pilot:
        for key, focused in (("3", app.steps[2]), ("2", app.query_one("#names"))):
            await pilot.press(key)
            for small in ((60, 20), (79, 24), (30, 5)):
                await pilot.resize_terminal(*small)
                await until(pilot, lambda: app.query_one("#too-small").display)
                await pilot.resize_terminal(80, 24)
                await until(pilot, lambda: not app.query_one("#too-small").display)
                await until(pilot, lambda focused=focused: app.screen.focused is focused)
        await pilot.press("3", "r")
        assert "Not released: press s to be guided to the pose first" in notices_text(app)


@pytest.mark.slow
async def test_the_stepper_keeps_its_two_rows(tmp_path: Path) -> None:
    # At 120 columns it wrapped behind step 4 and pushed out what is missing and what is next.
    data = Path(__file__).parent / "data"
    result = Workspace(out=tmp_path, model=data / "model.json", diagnosis=data / "diagnosis.json")
    app = DprApp(result, tmp_path / "state")
    async with app.run_test(size=(120, 30)) as pilot:
        await pilot.press("4", "6", "1")
        for width in (120, 80, 100, 160):
            await pilot.resize_terminal(width, 30)
            await pilot.pause()
            rows = stepper(app).splitlines()
            assert len(rows) == 2
            assert "6 Diagnose" in rows[0]
            assert len(rows[0]) <= width - 2
            assert "next (n): 2 Rig" in rows[1]


async def test_the_same_message_is_not_stacked(tmp_path: Path, notices_text) -> None:
    app = faulty(tmp_path)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("w", "w", "w")
        assert notices_text(app).count("no cable") == 1


@pytest.mark.slow
async def test_a_key_without_effect_is_reported_and_old_notices_are_removed(tmp_path: Path, notices_text) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", "r", "k", "8")
        assert notices_text(app).splitlines() == [
            "k has no function here; f1 shows the keys",
            "8 has no function here; f1 shows the keys",
        ]
        await pilot.press("1")  # they were about what is left now
        assert notices_text(app) == ""


@pytest.mark.slow
@pytest.mark.parametrize("desktop", thinned([True, False], 2))
async def test_the_report_is_opened_by_key(tmp_path: Path, notices_text, monkeypatch, until, desktop: bool) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":0") if desktop else monkeypatch.delenv("DISPLAY", raising=False)
    page = tmp_path / "my bench" / "report" / "report.html"
    app = DprApp(Workspace(out=tmp_path / "my bench"), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("5", "f2")
        assert "This step has no report yet" in notices_text(app)
        page.parent.mkdir(parents=True)
        page.touch()
        await pilot.press("f2")
        await until(pilot, lambda: opened or str(page) in notices_text(app).replace("\n", ""))
    assert opened == ([page.as_uri()] if desktop or sys.platform != "linux" else [])


@pytest.mark.slow
def test_nothing_that_computes_is_imported_before_it_is_needed(tmp_path: Path) -> None:
    script = """
import asyncio, pathlib, sys
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.workspace import Workspace

async def look():
    here = pathlib.Path(sys.argv[1])
    async with DprApp(Workspace(out=here), here).run_test() as pilot:
        await pilot.press("6")
    print({"scipy", "numba", "filterpy", "cma", "matplotlib"} & sys.modules.keys() or "light")

asyncio.run(look())
"""
    done = subprocess.run([sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True)
    assert done.stdout == "light\n"


def test_without_a_terminal_the_command_lists_the_alternatives(tmp_path: Path) -> None:
    environment = os.environ | {"DPR_LAB_STATE": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "dpr_lab", "tui"], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 1
    assert "needs a terminal; without a terminal use the commands capture" in done.stderr


@pytest.mark.long
def test_wrong_keys_stop_the_command_with_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "keys.toml").write_text("[capture]\nrelease = 'k'\n")
    environment = os.environ | {"DPR_LAB_STATE": str(tmp_path), "DPR_LAB_CONFIG": str(tmp_path)}
    master, slave = os.openpty()
    done = subprocess.run(
        [sys.executable, "-m", "dpr_lab", "tui"],
        stdout=slave,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        env=environment,
    )
    os.close(master)
    os.close(slave)
    assert done.returncode == 3
    assert "the key 'k' is assigned to both capture.release and capture.keep" in done.stderr
    assert "Traceback" not in done.stderr

import ast
import math
import re
from pathlib import Path

import pytest
from textual.binding import Binding
from textual.widgets import Markdown

import dpr_lab.tui
from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig
from dpr_lab.tui.app import KEYED, STEPS, DprApp
from dpr_lab.tui.keys import about_keys, actions, keys_file, load_keymap
from dpr_lab.tui.recorder.attempt import Attempt, Phase
from dpr_lab.tui.recorder.messages import Connected, Idle, RecorderFailed
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.workspace import Workspace
from firmware_protocol.identity import DeviceInfo

TUI = Path(dpr_lab.tui.__file__).parent
INFO = DeviceInfo("1.0.0", "000051d000000001", (16384, 16384, 16384), 4000, 1000)
CONNECTED = Connected("serial:///dev/ttyACM0?baud=921600", INFO, 1000, (), "")


def keymap(folder: Path, text: str) -> dict[str, str]:
    file = folder / "keys.toml"
    file.write_text(text)
    return load_keymap(file, DprApp, KEYED)


def test_without_a_file_nothing_changes(tmp_path: Path) -> None:
    assert load_keymap(tmp_path / "keys.toml", DprApp, KEYED) == {}


def test_every_action_of_every_place_has_an_id_of_its_own() -> None:
    shared = {binding for place in (DprApp, *KEYED) for binding in place.__dict__.get("BINDINGS", ())}
    assert len({binding.id for binding in shared}) == len(shared)
    for place in (DprApp, *KEYED):
        assert len(actions(place)) == len(place.__dict__.get("BINDINGS", ()))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[capture]\nfire = 'r'", "capture.fire: unknown action (known actions: app.browse"),
        ("[capture]\nrelease = 'hyperspace'", "capture.release = 'hyperspace': unknown key"),
        ("[capture]\nrelease = 'shiftctrl+r'", "unknown key: use for example r, space, f5 or ctrl+r"),
        ("[capture]\nrelease = 'k'", "the key 'k' is assigned to both capture.release and capture.keep"),
        ("[capture]\nrelease = 'n'", "the key 'n' is assigned to both app.next and capture.release"),
        ("[app]\nhelp = 's'", "the key 's' is assigned to both app.help and "),
        ("[capture]\nrelease = 3", "capture.release = 3: give a key"),
        ("release = 'r'", "release: write the actions below the name of their section"),
        ("[capture", "cannot be used"),
    ],
)
def test_a_wrong_file_names_file_action_and_key(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigError) as caught:
        keymap(tmp_path, text)
    assert str(tmp_path / "keys.toml") in str(caught.value)
    assert reason in str(caught.value)


def test_two_actions_may_swap_their_keys(tmp_path: Path) -> None:
    swapped = keymap(tmp_path, "[capture]\nkeep = 'a'\nagain = 'k'")
    assert swapped == {"capture.keep": "a", "capture.again": "k"}


def test_keys_of_removed_actions_are_ignored(tmp_path: Path) -> None:
    text = "[slider]\nless = 'n'\n[identify]\npause = 'w'\nstart = 'f6'\n[compare]\nearlier = 'f7'\nlater = 'f8'"
    assert keymap(tmp_path, text) == {"identify.start": "f6"}


def test_the_help_names_only_sections_that_exist() -> None:
    sections = {name.split(".")[0] for name in actions(DprApp, *KEYED)}
    assert set(re.findall(r"`([a-z]+)`", about_keys().split("The sections are")[1])) <= sections


@pytest.mark.long
async def test_a_new_key_works_and_the_old_one_does_not(tmp_path: Path) -> None:
    changed = keymap(tmp_path, "[capture]\nrepeats = 'f6'\n[app]\nnext = 'y,ctrl+right'")
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state", changed, steps=STEPS[:3])
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("y", "n", "y")
        assert app.current.NAME == "Capture"
        checklist = app.query_one(CaptureStep).query_one("#checklist")
        await pilot.press("f6", "f")
        await pilot.pause()
        assert "2 of each pose" in str(checklist.render())


@pytest.mark.slow
async def test_a_report_that_arrives_while_the_screen_ends_is_not_drawn(tmp_path: Path) -> None:
    # A timer of the step asked for the chart of the swing while Textual removed the widgets.
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state", steps=STEPS[:3])
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        step = app.query_one(CaptureStep)
    assert not step.query("#swing")
    with app._context():
        step._draw()


MOVES = {"left", "right", "up", "down", "home", "end", "shift+up", "shift+down", "escape", "enter"}
"""Keys for moving, selecting and leaving in all lists."""


def test_a_key_means_one_thing_on_all_screens() -> None:
    meanings: dict[str, set[str]] = {}
    for place in (DprApp, *KEYED):
        for binding in Binding.make_bindings(place.__dict__.get("BINDINGS", ())):
            if binding.key not in MOVES:
                meanings.setdefault(binding.key, set()).add(binding.description)
    assert {key: what for key, what in meanings.items() if len(what) > 1} == {}


@pytest.mark.slow
async def test_every_text_names_the_key_as_it_is(tmp_path: Path) -> None:
    # A remapped release key left "Press r to RELEASE" on the screen, and r did nothing.
    changed = keymap(tmp_path, "[capture]\nrelease = 'f7'\nstart = 'f8'\nconnect = 'f9'\n[connect]\nexercise = 'f6'")
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state", changed, steps=STEPS[:3])
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        app.device.connected = app.device.lost = None
        await pilot.press("f7")
        assert "press f8 to be guided" in "\n".join(notice.message for notice in app.notices)
        step.attempt = Attempt(1, "X1", load_rig("paper").poses["X1"], Phase.READY)
        app.device.note(Idle((0.0, 3.1, 0.1), True, math.inf))
        app.device.connected = CONNECTED
        step._draw()
        assert "Press f7 to RELEASE" in str(app.query_one("#headline").render())
        await pilot.press("d")  # it said "of 20 s" of a recording of 10 s
        assert "An attempt is under way: end it with x" in "\n".join(notice.message for notice in app.notices)
        assert step.options.duration == 10.0
        step.attempt = None
        app.device.note(RecorderFailed(None, "gone", alive=False))
        step._draw()
        assert "f9: connect again" in str(app.query_one("#headline").render())
        await pilot.press("f1")
        help_text = app.screen.query_one(Markdown).source
        assert "`f7` opens a dialog with a countdown" in help_text
        assert "keys.toml" in help_text
        assert "{" not in help_text


@pytest.mark.parametrize(
    "place", [place for place in KEYED if getattr(place, "HELP", "")], ids=lambda place: place.__name__
)
def test_no_help_names_a_key_by_itself(place: type) -> None:
    assert re.findall(r"`[a-z/\[\]]`", place.HELP) == []


NAMED_KEY = re.compile(r"\b[Pp]ress (?:[a-zA-Z/]|f\d+)\b|(?:^|[ (])(?:[a-zA-Z/]|f\d+): [a-z]")
"""A key said as it is, `press s` or `k: keep it`, where `{capture.keep}` would be said as the keymap has it."""


def texts(path: Path) -> set[str]:
    """All texts of a file except docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    result = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    strings = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in result)
    return {node.value for node in strings if isinstance(node.value, str)}


def test_no_text_of_any_screen_names_a_key_by_itself() -> None:
    assert NAMED_KEY.search("Press r to RELEASE")
    assert NAMED_KEY.search("good. k: keep it")
    result = {(path.name, text) for path in TUI.rglob("*.py") for text in texts(path) if NAMED_KEY.search(text)}
    assert result == set()


def test_the_config_folder_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DPR_LAB_CONFIG", str(tmp_path))
    assert keys_file() == tmp_path / "keys.toml"

from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.tui.app import KEYED, DprApp
from dpr_lab.tui.bench import Bench
from dpr_lab.tui.capture import CaptureStep
from dpr_lab.tui.keys import actions, keys_file, load_keymap


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
    ("text", "said"),
    [
        ("[capture]\nfire = 'r'", "capture.fire: no such action (there are: app.browse"),
        ("[capture]\nrelease = 'hyperspace'", "capture.release = 'hyperspace': no such key"),
        ("[capture]\nrelease = 'shiftctrl+r'", "no such key: write for example r, space, f5 or ctrl+r"),
        ("[capture]\nrelease = 'k'", "the key 'k' is both capture.release and capture.keep"),
        ("[capture]\nrelease = 'n'", "the key 'n' is both app.next and capture.release"),
        ("[app]\nhelp = 's'", "the key 's' is both app.help and "),
        ("[capture]\nrelease = 3", "capture.release = 3: write a key"),
        ("release = 'r'", "release: write the actions of a place below its name"),
        ("[capture", "cannot be used"),
    ],
)
def test_a_wrong_file_names_file_action_and_key(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        keymap(tmp_path, text)
    assert str(tmp_path / "keys.toml") in str(caught.value)
    assert said in str(caught.value)


def test_two_actions_may_swap_their_keys(tmp_path: Path) -> None:
    swapped = keymap(tmp_path, "[capture]\nkeep = 'a'\nagain = 'k'")
    assert swapped == {"capture.keep": "a", "capture.again": "k"}


async def test_a_new_key_works_and_the_old_one_does_not(tmp_path: Path) -> None:
    changed = keymap(tmp_path, "[capture]\nrepeats = 'f6'\n[app]\nnext = 'j,ctrl+right'")
    app = DprApp(Bench(out=tmp_path), tmp_path / "state", changed)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("j", "n", "j")
        assert app.current.NAME == "Capture"
        checklist = app.query_one(CaptureStep).query_one("#checklist")
        await pilot.press("f6", "e")
        await pilot.pause()
        assert "2 of each pose" in str(checklist.render())


def test_the_config_folder_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DPR_LAB_CONFIG", str(tmp_path))
    assert keys_file() == tmp_path / "keys.toml"

"""Step 2: a rig chosen, changed and saved on the screen with the checks of every rig file."""

from pathlib import Path

import pytest
from textual.app import App, ComposeResult
from textual.widgets import Input, OptionList, Static, TextArea

from dpr_lab.configs import BUILTIN
from dpr_lab.rig import load_rig
from dpr_lab.tui.steps.rig import RigStep
from dpr_lab.tui.steps.rig_editor import RigEditor
from dpr_lab.tui.steps.table_import import TableImport
from dpr_lab.tui.widgets.dialogs import Question


def verdict(app) -> str:
    return str(app.screen.query_one("#verdict", Static).content)


@pytest.mark.slow
async def test_a_rig_is_made_from_a_built_in_one_and_checked_before_it_is_saved(
    lab, until, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    async with lab(RigStep) as pilot:
        await pilot.press("f3")
        await until(pilot, lambda: isinstance(pilot.app.screen, RigEditor))
        target, text = pilot.app.screen.query_one(Input), pilot.app.screen.query_one(TextArea)
        assert target.value == str(tmp_path / "my_paper.toml")
        good = text.text
        text.text = good.replace("L1 = ", "L1 = -")
        await pilot.press("ctrl+s")
        assert "not saved" in verdict(pilot.app)
        assert "L1" in verdict(pilot.app)
        assert not (tmp_path / "my_paper.toml").exists()
        text.text = good.replace('name = "paper"', 'name = "mine"')
        for wrong, why in ((str(BUILTIN / "rigs" / "paper.toml"), "is built in"), ("rig.txt", "ends in .toml")):
            target.value = wrong
            await pilot.press("ctrl+s")
            assert why in verdict(pilot.app)
        (tmp_path / "file").touch()
        target.value = "file/rig.toml"
        await pilot.press("ctrl+s")
        assert "cannot be written" in verdict(pilot.app)
        target.value = str(tmp_path / "my_paper.toml")
        await pilot.press("ctrl+s")
        await until(pilot, lambda: pilot.app.workspace.rig == str(tmp_path / "my_paper.toml"))
        assert load_rig(tmp_path / "my_paper.toml").name == "mine"
        assert pilot.app.query_one(RigStep).outcome() == "mine"


async def test_a_folder_with_the_name_of_a_built_in_rig_does_not_hide_the_rig(
    lab, until, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "furuta").mkdir()
    async with lab(RigStep) as pilot:
        pilot.app.query_one(RigStep).query_one(Input).value = "furuta"
        await pilot.press("u")
        await until(pilot, lambda: pilot.app.query_one(RigStep).outcome() == "furuta")


async def test_a_table_without_suffix_that_is_named_like_a_built_in_rig_is_imported(
    lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "furuta").write_text("t,theta1,theta2\n")
    async with lab(RigStep) as pilot:
        step = pilot.app.query_one(RigStep)
        step.query_one(Input).value = "furuta"
        await step.action_read()
        await pilot.pause()
        assert isinstance(pilot.app.screen, TableImport)


async def test_rigs_used_before_are_offered_first(lab, until, tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text((BUILTIN / "rigs" / "paper.toml").read_text())
    async with lab(RigStep) as pilot:
        pilot.app.query_one(RigStep).query_one(Input).value = str(mine)
        await pilot.press("u")
        await until(pilot, lambda: pilot.app.workspace.recent_rigs == [str(mine)])
        names = pilot.app.query_one("#names", OptionList)
        assert "used before" in str(names.get_option_at_index(0).prompt)
        await pilot.press("escape", "f3")
        await until(pilot, lambda: isinstance(pilot.app.screen, RigEditor))
        assert pilot.app.screen.query_one(Input).value == str(mine)
        await pilot.press("#", "escape")
        await until(pilot, lambda: isinstance(pilot.app.screen, Question))  # what was changed is not lost silently
        await pilot.press("y")
        await until(pilot, lambda: not isinstance(pilot.app.screen, RigEditor))
        assert pilot.app.workspace.rig == str(mine)


async def test_changes_are_discarded_without_an_error(until, tmp_path: Path) -> None:
    class Alone(RigEditor):
        def compose(self) -> ComposeResult:
            yield TextArea("rate_hz = 1\n")

    mine = tmp_path / "mine.toml"
    mine.touch()
    app, editor = App[None](), Alone(mine)
    async with app.run_test() as pilot:
        app.push_screen(editor)
        await until(pilot, lambda: app.screen is editor)
        editor.call_next(editor.action_leave)  # as a key: Textual awaits what it starts in this message queue
        await until(pilot, lambda: isinstance(app.screen, Question))
        await pilot.press("y")
        await until(pilot, lambda: app.screen is not editor)

"""The run browser: list, filter, verification, export, and returned selection."""

import shutil
from pathlib import Path

import pytest
from textual.app import App
from textual.widgets import DataTable, Input, Markdown, Static

from dpr_lab.storage.inspect import info, verify
from dpr_lab.tui.steps.step import Step
from dpr_lab.tui.widgets.dialogs import HelpScreen
from dpr_lab.tui.widgets.run_browser import RunBrowser


class Nothing(Step):
    NAME = "Nothing"


class Answer:
    given: list[Path] | None
    asked = False

    def __call__(self, answer: list[Path] | None) -> None:
        self.given, self.asked = answer, True


@pytest.fixture
def folder(recorded: list[Path], tmp_path: Path) -> Path:
    """Folder with the recorded runs, and one incomplete run."""
    out = tmp_path / "bench" / "runs"
    out.mkdir(parents=True)
    for name, run in zip(("first", "second", "third"), recorded, strict=True):
        shutil.copy(run, out / f"{name}.mcap")
        shutil.copy(f"{run}.sha256", out / f"{name}.mcap.sha256")
    (out / "torn.mcap").write_bytes(recorded[0].read_bytes()[:100_000])
    return out


def rows(app: App[None]) -> list[list[str]]:
    table = app.screen.query_one(DataTable)
    return [[str(cell) for cell in table.get_row_at(index)] for index in range(table.row_count)]


def shown_text(app: App[None], widget: str) -> str:
    return str(app.screen.query_one(widget, Static).content)


async def opened(pilot, until, folder: Path, selected: list[Path]) -> Answer:
    answer = Answer()
    pilot.app.workspace.out = folder.parent
    pilot.app.push_screen(RunBrowser(pilot.app.services, selected), answer)
    await until(pilot, lambda: isinstance(pilot.app.screen, RunBrowser) and pilot.app.screen.query(DataTable))
    await until(pilot, lambda: not any("reading" in row for row in rows(pilot.app)))
    return answer


@pytest.mark.slow
async def test_every_run_is_listed_with_its_properties(lab, until, folder: Path) -> None:
    async with lab(Nothing, size=(120, 30)) as pilot:
        await opened(pilot, until, folder, [folder / "second.mcap"])
        listed = {row[-1]: row for row in rows(pilot.app)}
        assert list(listed) == ["first", "second", "third", "torn"]
        assert [row[0] for row in listed.values()] == [" ", "✔", " ", " "]
        assert [row[1] for row in listed.values()] == ["X1", "X2", "X3", "X1"]
        assert listed["first"][3:7] == ["3.0", "0", "whole", "ok"]
        assert listed["torn"][5] == "cut"
        assert "1000 Hz" in shown_text(pilot.app, "#about")


async def test_chosen_runs_are_handed_back_in_the_order_of_the_list(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [folder / "third.mcap"])
        await pilot.press("space", "enter")
        assert answer.given == [folder / "first.mcap", folder / "third.mcap"]


@pytest.mark.slow
async def test_enter_takes_the_run_under_the_cursor_where_none_was_chosen(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [])
        await pilot.press("down", "enter")
        assert answer.given == [folder / "second.mcap"]


@pytest.mark.slow
async def test_a_cut_run_is_recovered_by_key(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        await opened(pilot, until, folder, [])
        await pilot.press("ctrl+end", "ctrl+r")
        await until(pilot, lambda: "samples recovered" in shown_text(pilot.app, "#result"))
    assert (folder / "torn-recovered.mcap").is_file()


@pytest.mark.long
async def test_leaving_changes_nothing(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [folder / "third.mcap"])
        await pilot.press("space", "asterisk", "escape")
        assert answer.asked
        assert answer.given is None


@pytest.mark.slow
async def test_the_filter_narrows_what_is_shown_and_chosen(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [folder / "first.mcap"])
        await pilot.press("slash", *"x1 whole")
        assert [row[-1] for row in rows(pilot.app)] == ["first"]
        pilot.app.screen.query_one(Input).value = "ok"
        await pilot.pause()
        assert [row[-1] for row in rows(pilot.app)] == ["first", "second", "third"]
        await pilot.press("enter", "asterisk", "enter")
        assert answer.given == [folder / f"{name}.mcap" for name in ("first", "second", "third")]


@pytest.mark.long
async def test_all_shown_and_then_none(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [])
        await pilot.press("asterisk", "asterisk", "enter")
        assert answer.given == []


@pytest.mark.long
async def test_a_run_from_elsewhere_stays_chosen(lab, until, folder: Path, recorded: list[Path]) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [recorded[0]])
        await pilot.press("enter")
        assert answer.given == [recorded[0]]


@pytest.mark.slow
async def test_verify_distinguishes_intact_from_damaged_files(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        await opened(pilot, until, folder, [])
        await pilot.press("q")
        await until(pilot, lambda: "checking" not in shown_text(pilot.app, "#result"))
        assert shown_text(pilot.app, "#result") == "first.mcap: complete and unchanged"
        await pilot.press("ctrl+end", "q")
        await until(pilot, lambda: "checking" not in shown_text(pilot.app, "#result"))
        assert "no torn.mcap.sha256" in shown_text(pilot.app, "#result")


@pytest.mark.slow
async def test_export_writes_the_format_that_was_picked(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        await opened(pilot, until, folder, [])
        await pilot.press("e", "enter")
        await until(pilot, lambda: "exported" in shown_text(pilot.app, "#result"))
        exported = folder.parent / "exports" / "first.csv"
        assert exported.read_text().startswith("t_s,theta0_rad")
        await pilot.press("e", "enter")
        await until(pilot, lambda: pilot.app.notices)
        (notice,) = pilot.app.notices
        assert "exists already" in notice.message


@pytest.mark.slow
async def test_help_describes_the_run_browser(lab, until, folder: Path) -> None:
    async with lab(Nothing) as pilot:
        answer = await opened(pilot, until, folder, [])
        for key in ("f1", "question_mark"):
            await pilot.press(key)
            assert isinstance(pilot.app.screen, HelpScreen)
            text = pilot.app.screen.query_one(Markdown).source
            assert "# Runs" in text
            assert "`q` Check" in text
            await pilot.press("escape")
        assert isinstance(pilot.app.screen, RunBrowser)
        assert not answer.asked


async def test_an_empty_folder_is_reported_with_the_next_step(lab, until, tmp_path: Path) -> None:
    async with lab(Nothing) as pilot:
        await opened(pilot, until, tmp_path / "runs", [])
        assert "record some in step 3" in shown_text(pilot.app, "#result")
        await pilot.press("space", "asterisk", "q", "e")


@pytest.mark.slow
async def test_a_note_is_edited_and_kept_next_to_the_run(lab, until, folder: Path) -> None:
    before = (folder / "first.mcap").read_bytes()
    async with lab(Nothing, size=(120, 30)) as pilot:
        await opened(pilot, until, folder, [])
        await pilot.press("i", *"bearing oiled", "enter")
        await until(pilot, lambda: "bearing oiled" in shown_text(pilot.app, "#about"))
        assert isinstance(pilot.app.screen, RunBrowser)
        assert (folder / "first.mcap.note").read_text() == "bearing oiled"
        assert (folder / "first.mcap").read_bytes() == before
        assert info(folder / "first.mcap").note == "bearing oiled"
        assert verify(folder / "first.mcap").ok
        await pilot.press("slash", *"oiled", "enter")
        assert [row[-1] for row in rows(pilot.app)] == ["first"]
        await pilot.press("i", *" twice", "escape")
        assert (folder / "first.mcap.note").read_text() == "bearing oiled"


@pytest.mark.slow
async def test_runs_of_another_folder_are_listed_next_to_the_chosen_ones(
    lab, until, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    other = tmp_path / "elsewhere"
    other.mkdir()
    shutil.copy(folder / "second.mcap", other / "far.mcap")
    async with lab(Nothing, size=(120, 30)) as pilot:
        answer = await opened(pilot, until, folder, [folder / "first.mcap"])
        field = pilot.app.screen.query_one("#folder", Input)
        await pilot.press("o", "backspace", *"~/else")
        await until(pilot, lambda: field._suggestion == "~/elsewhere/")
        await pilot.press("right", "enter")
        await until(pilot, lambda: {row[-1] for row in rows(pilot.app)} == {"far", "first"})
        assert pilot.app.workspace.recent_folders == [other]
        await pilot.press("o", "down")
        assert field.value == str(other)
        await pilot.press("end", "backspace", "enter")
        await until(pilot, lambda: any("no such folder" in notice.message for notice in pilot.app.notices))
        await pilot.press("escape", "asterisk", "enter")
        await until(pilot, lambda: answer.asked)
        assert {path.name for path in answer.given or ()} == {"far.mcap", "first.mcap"}

import json
import time
from pathlib import Path

import pytest

from dpr_lab.report.run_names import recorded, run_name
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.path_suggester import PathSuggester
from dpr_lab.tui.texts import following, named_runs
from dpr_lab.tui.workspace import Workspace, load, state_folder


def test_what_was_saved_comes_back(tmp_path: Path) -> None:
    run, model = tmp_path / "a.mcap", tmp_path / "model.json"
    run.touch()
    model.touch()
    workspace = Workspace("multiarm", "sim://", tmp_path, [run], model=model, theme="dpr-light", step="Rig")
    workspace.save(tmp_path / "state")
    assert load(tmp_path / "state") == (workspace, [])
    assert [file.name for file in (tmp_path / "state").iterdir()] == ["bench.json"]


def test_without_a_saved_workspace_the_start_shows_no_notice(tmp_path: Path) -> None:
    assert load(tmp_path) == (Workspace(), [])


@pytest.mark.parametrize("text", ["", "{", "[]", '{"runs": 3}', '{"rig": 7}', '{"out": null}', "\x00\xff"])
def test_a_damaged_file_is_a_fresh_start_with_a_notice(tmp_path: Path, text: str) -> None:
    (tmp_path / "bench.json").write_text(text, encoding="latin-1")
    workspace, notices = load(tmp_path)
    assert workspace == Workspace()
    assert "bench.json" in notices[0]
    assert "starts with an empty workspace" in notices[0]
    assert "validation error" not in notices[0]


def test_a_damaged_file_names_the_entry_and_what_is_wrong_with_it(tmp_path: Path) -> None:
    # "1 validation error for Workspace"
    (tmp_path / "bench.json").write_text('{"runs": 3}')
    (notice,) = load(tmp_path)[1]
    assert "bench.json: runs = 3 is not valid: " in notice


def test_missing_files_are_removed_with_a_notice(tmp_path: Path) -> None:
    kept = tmp_path / "kept.mcap"
    kept.touch()
    lost = tmp_path / "lost.mcap"
    before = Workspace(runs=[kept, lost], held_out=[lost, kept], model=tmp_path / "m.json", diagnosis=tmp_path / "d")
    before.save(tmp_path)
    workspace, notices = load(tmp_path)
    assert (workspace.runs, workspace.held_out, workspace.model, workspace.diagnosis) == ([kept], [kept], None, None)
    assert [Path(notice.split(":")[0]).name for notice in notices] == ["lost.mcap", "m.json", "d"]


def test_another_folder_begins_without_the_runs_and_results_of_the_last_one(tmp_path: Path) -> None:
    run, model = tmp_path / "a.mcap", tmp_path / "model.json"
    before = Workspace("furuta", "sim://", tmp_path, [run], held_out=[run], undecided=run, model=model, step="Identify")
    before.move_to(tmp_path)
    assert (before.runs, before.model, before.step) == ([run], model, "Identify")
    before.move_to(tmp_path / "other")
    assert before == Workspace("furuta", "sim://", tmp_path / "other")


def test_the_state_folder_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DPR_LAB_STATE", str(tmp_path))
    assert state_folder() == tmp_path
    monkeypatch.delenv("DPR_LAB_STATE")
    assert state_folder().name == "dpr-lab"


@pytest.mark.slow
async def test_step_and_theme_are_resumed(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2", "t")
        await pilot.pause()
        assert app.theme == "dpr-light"
    saved, _ = load(app.folder)
    assert (saved.step, saved.theme) == ("Rig", "dpr-light")
    again = DprApp(saved, app.folder)
    async with again.run_test(size=(80, 24)):
        assert (again.current.NAME, again.theme) == ("Rig", "dpr-light")
    assert json.loads((app.folder / "bench.json").read_text())["step"] == "Rig"


async def test_a_path_is_completed_and_the_home_folder_expanded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "rigs").mkdir()
    (tmp_path / "rigs" / "mine.toml").touch()
    (tmp_path / "rigs" / "mine.txt").touch()
    complete = PathSuggester(".toml").get_suggestion
    assert await complete("~/ri") == "~/rigs/"
    assert await complete("~/rigs/m") == "~/rigs/mine.toml"
    assert await complete(f"{tmp_path}/rigs/mine.to") == f"{tmp_path}/rigs/mine.toml"
    assert await complete("~/nothing/there") is None


def test_a_run_is_named_by_pose_and_local_time_with_its_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    try:
        assert run_name(Path("20261121T101500Z_X1_00000001.mcap")) == "X1 (2026-11-21 11:15 CET)"
        assert run_name(Path("first.mcap")) == "first"
    finally:
        monkeypatch.undo()
        time.tzset()


def test_runs_of_one_day_are_named_by_their_poses_and_one_span_of_time() -> None:
    runs = [Path(f"20261121T10{10 + n}00Z_X{n}_00000001.mcap") for n in range(1, 4)]
    first, last = (recorded(run) for run in (runs[0], runs[-1]))
    assert named_runs(runs) == f"3 runs: X1, X2, X3 ({first[:16]} to {last[11:]})"
    assert named_runs(runs[:1]) == f"1 run: X1 ({first})"
    assert named_runs([*runs, Path("mine.mcap")]).startswith(f"4 runs: X1 ({first}), ")


@pytest.mark.parametrize(
    ("current", "by", "expected"), [("a", 1, "b"), ("c", 1, "a"), ("a", -1, "c"), ("typed", 1, "a"), ("typed", -1, "c")]
)
def test_a_cycle_continues_at_its_ends_for_a_value_outside(current: str, by: int, expected: str) -> None:
    assert following("abc", current, by) == expected

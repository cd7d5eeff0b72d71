import json
from pathlib import Path

import pytest

from dpr_lab.tui.app import DprApp
from dpr_lab.tui.bench import Bench, load, state_folder


def test_what_was_saved_comes_back(tmp_path: Path) -> None:
    run, model = tmp_path / "a.mcap", tmp_path / "model.json"
    run.touch()
    model.touch()
    bench = Bench(rig="multiarm", link="sim://", out=tmp_path, runs=[run], model=model, theme="dpr-light", step="Rig")
    bench.save(tmp_path / "state")
    assert load(tmp_path / "state") == (bench, [])
    assert [file.name for file in (tmp_path / "state").iterdir()] == ["bench.json"]


def test_nothing_saved_is_a_fresh_start_without_a_word(tmp_path: Path) -> None:
    assert load(tmp_path) == (Bench(), [])


@pytest.mark.parametrize("text", ["", "{", "[]", '{"runs": 3}', '{"rig": 7}', '{"out": null}', "\x00\xff"])
def test_a_damaged_file_is_a_fresh_start_with_a_notice(tmp_path: Path, text: str) -> None:
    (tmp_path / "bench.json").write_text(text, encoding="latin-1")
    bench, notices = load(tmp_path)
    assert bench == Bench()
    assert "bench.json" in notices[0]
    assert "starts fresh" in notices[0]


def test_what_is_gone_is_dropped_with_a_notice(tmp_path: Path) -> None:
    kept = tmp_path / "kept.mcap"
    kept.touch()
    lost = tmp_path / "lost.mcap"
    Bench(runs=[kept, lost], held_out=[lost, kept], model=tmp_path / "m.json", diagnosis=tmp_path / "d").save(tmp_path)
    bench, notices = load(tmp_path)
    assert (bench.runs, bench.held_out, bench.model, bench.diagnosis) == ([kept], [kept], None, None)
    assert [Path(notice.split(":")[0]).name for notice in notices] == ["lost.mcap", "m.json", "d"]


def test_the_state_folder_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DPR_LAB_STATE", str(tmp_path))
    assert state_folder() == tmp_path
    monkeypatch.delenv("DPR_LAB_STATE")
    assert state_folder().name == "dpr-lab"


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

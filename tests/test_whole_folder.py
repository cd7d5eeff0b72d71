"""Results of several files, which are written completely or not at all."""

from contextlib import suppress
from pathlib import Path

import pytest

from dpr_lab.errors import DprError
from dpr_lab.whole_file import whole_folder


def test_files_appear_together_and_the_record_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    moved: list[str] = []
    replace = Path.replace
    monkeypatch.setattr(Path, "replace", lambda self, target: (moved.append(self.name), replace(self, target))[1])
    out = tmp_path / "out"
    with whole_folder(out, "a.json") as folder:
        (folder / "part").mkdir()
        for name in ("a.json", "part/b.txt", "c.html"):
            (folder / name).write_text("new")
        assert not (out / "c.html").exists()
    assert sorted(file.relative_to(out).as_posix() for file in out.rglob("*")) == [
        "a.json",
        "c.html",
        "part",
        "part/b.txt",
    ]
    assert moved[-1] == "a.json"


def test_an_interruption_keeps_the_former_files_and_the_new_record(tmp_path: Path) -> None:
    for name in ("a.json", "c.html", "notes.txt"):
        (tmp_path / name).write_text("old")
    with suppress(KeyboardInterrupt), whole_folder(tmp_path, "a.json") as folder:
        (folder / "a.json").write_text("new")
        (folder / "c.html").write_text("half")
        raise KeyboardInterrupt
    folder = tmp_path / "new.a"
    assert {file.name: file.read_text() for file in tmp_path.iterdir() if file.is_file()} == {
        name: "old" for name in ("a.json", "c.html", "notes.txt")
    }
    assert [file.name for file in folder.iterdir()] == ["a.json"]
    with whole_folder(tmp_path, "a.json") as folder:
        assert not list(folder.iterdir())
    assert not folder.exists()


def test_a_record_never_describes_the_files_of_another_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_text("old")

    def refused(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(DprError, match=f"{tmp_path}: cannot be written: No space left"):
        with whole_folder(tmp_path, "a.json", "b.json") as folder:
            (folder / "a.json").write_text("new")
    assert not (tmp_path / "a.json").exists()
    assert (folder / "a.json").read_text() == "new"


def test_a_file_that_depends_on_the_earlier_record_is_renamed(tmp_path: Path) -> None:
    for depends in ("first", "second", None):
        with whole_folder(tmp_path, "a.json", "b.json") as folder:
            (folder / "a.json").touch()
            if depends:
                (folder / "b.json").write_text(depends)
    assert {file.name for file in tmp_path.iterdir()} == {"a.json", "outdated.b.json"}
    assert (tmp_path / "outdated.b.json").read_text() == "second"


def write_all(out: Path, record: str, *names: str) -> None:
    with whole_folder(out, record) as folder:
        for name in (record, *names):
            (folder / name).write_text("new")


def test_files_that_cannot_be_moved_remain_in_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = Path.replace

    def refused(self: Path, target: Path) -> Path:
        if self.name == "c.html":
            raise PermissionError(13, "Permission denied")
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", refused)
    fresh = tmp_path / "new.a"
    with pytest.raises(DprError, match=f"Permission denied; the files that were not moved are in {fresh}"):
        write_all(tmp_path, "a.json", "b.txt", "c.html")
    assert not (tmp_path / "a.json").exists()
    names = {file.name for file in fresh.iterdir()}
    assert names >= {"a.json", "c.html"}
    assert names | {file.name for file in tmp_path.iterdir() if file.is_file()} == {"a.json", "b.txt", "c.html"}

"""Full disk: no incomplete file under a final name, no crash of a library, and a message."""

import errno
import os
import subprocess
from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError, RunError
from dpr_lab.storage import writer
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.export import EXPORTERS, export
from dpr_lab.storage.inspect import recover
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.workflows.checks import check_file_writable, check_folder_writable
from tests.warm_process import started

PROGRAM = """
import resource, signal, sys
import numpy as np
from pathlib import Path
from dpr_lab.errors import RunError
from dpr_lab.run import Run
from dpr_lab.storage.export import export
import h5py, pyarrow, scipy.io
t = np.arange(20000) / 1000
noise = np.random.default_rng(1)
run = Run("a", t, noise.normal(size=(len(t), 3)), noise.integers(0, 1 << 40, (len(t), 3)), "X1", "r", "", 1000.0)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sys.dont_write_bytecode = True  # a module file of the limited size would be damaged for all later tests
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
for target in sys.argv[1:]:
    try:
        export(run, Path(target))
    except RunError as error:
        print(error)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="limits the size of files")
def test_an_export_that_fails_leaves_nothing(tmp_path: Path) -> None:
    targets, pipe = [str(tmp_path / f"run{suffix}") for suffix in EXPORTERS], subprocess.PIPE
    with started("tests.program_text", [PROGRAM, *targets], stdout=pipe, stderr=pipe, text=True) as process:
        try:
            out, err = process.communicate(timeout=600)
        finally:
            process.kill()
    assert process.returncode == 0, err[-500:]
    messages = out.splitlines()
    assert len(messages) == len(targets)
    for target, message in zip(targets, messages, strict=True):
        assert f"{target}: cannot be written" in message
        assert message.endswith("choose another folder")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_import_and_a_recovery_that_fail_leave_nothing(tmp_path: Path, paper, monkeypatch) -> None:
    rows = "".join(f"{i / 100},{3 + i / 1000},{3 - i / 1000}\n" for i in range(50))
    (tmp_path / "swing.csv").write_text(f"t,theta1,theta2\n{rows}")
    import_csv(tmp_path / "swing.csv", paper, out=tmp_path / "whole.mcap")
    before = sorted(tmp_path.iterdir())

    def full(*_) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("dpr_lab.storage.writer.RunWriter._sync", full)
    with pytest.raises(RunError, match=r"run\.mcap: cannot be written: No space left on device; choose"):
        import_csv(tmp_path / "swing.csv", paper, out=tmp_path / "run.mcap")
    with pytest.raises(RunError, match=r"run\.mcap: cannot be written: No space left on device; choose"):
        recover(tmp_path / "whole.mcap", tmp_path / "run.mcap")
    with pytest.raises(RunError, match="exists already"):
        recover(tmp_path / "whole.mcap", tmp_path / "whole.mcap")
    assert sorted(tmp_path.iterdir()) == before


def test_a_recording_without_a_temporary_file_is_a_run_error(tmp_path: Path, paper, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer, "keep_on_disk", full)
    with pytest.raises(RunError, match=r"run\.mcap: cannot be written: No space left on device"):
        writer.RunWriter(tmp_path / "run.mcap", RunMetadata(paper, "X1", 1000))


@pytest.mark.slow
def test_a_whole_export_has_its_final_name_alone(tmp_path: Path, recorded) -> None:
    (run, *_) = recorded({}, duration=0.2)
    for suffix in EXPORTERS:
        export(run, tmp_path / f"run{suffix}")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == sorted(EXPORTERS)
    with pytest.raises(RunError, match="exists already"):
        export(run, tmp_path / "run.csv")


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that takes no file")
def test_an_unwritable_output_is_reported_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for refuse, place, result in (
        (check_file_writable, tmp_path, "is a folder"),
        (check_file_writable, tmp_path / "file" / "m.json", r"m\.json: cannot be written.*choose another folder"),
        (check_file_writable, Path("/proc/nowhere/m.json"), r"m\.json: cannot be written.*choose another folder"),
        (check_folder_writable, tmp_path / "file", "is a file"),
        (check_folder_writable, Path("/proc/nowhere"), "cannot be written"),
    ):
        with pytest.raises(ConfigError, match=result):
            refuse(place)
    check_file_writable(tmp_path / "new" / "m.json")
    check_folder_writable(tmp_path / "new")
    assert not (tmp_path / "new").exists()

"""Memory use while reading is that of the numbers, not of their text; files that are not tables are refused early."""

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dpr_lab.errors import RunError
from dpr_lab.storage.tables import table as table_module
from dpr_lab.storage.tables.table import TableLimits, read_table

CHILD = """
import resource, sys
from pathlib import Path
import numpy as np, scipy.signal
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.inspect import info
from dpr_lab.storage.reader import load_run
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
path = Path(sys.argv[1])
if path.suffix == ".csv":
    import_csv(path, load_rig("paper"), ImportOptions(keep_rest=True), path.with_suffix(".mcap"))
else:
    info(path)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""

pytestmark = pytest.mark.skipif(os.name != "posix", reason="measures a process")


def grown_kb(path: Path) -> int:
    done = subprocess.run([sys.executable, "-c", CHILD, str(path)], capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr[-500:]
    return int(done.stdout)


@pytest.mark.slow
def test_a_table_of_two_megabytes_takes_a_few_times_its_numbers(tmp_path: Path) -> None:
    rows = 50_000
    with (tmp_path / "a.csv").open("w") as file:
        file.write("t,theta1,theta2\n")
        for k in range(rows):
            swing = [math.pi + 0.5 * math.cos(2 * math.pi * f * k / 1000) for f in (0.8, 1.1)]
            file.write(f"{k / 1000:.6f},{swing[0]:.12f},{swing[1]:.12f}\n")
    assert grown_kb(tmp_path / "a.csv") < 20 * rows * 3 * 8 / 1024  # text in lists took 45 times as much as the numbers


@pytest.mark.long
def test_a_file_of_tiny_messages_takes_no_memory_for_each(tmp_path: Path, paper) -> None:
    from dpr_lab.storage.metadata import RunMetadata, RunSummary
    from dpr_lab.storage.writer import RunWriter

    with RunWriter(tmp_path / "a.mcap", RunMetadata(rig=paper, pose="X1", rate_hz=1000.0)) as writer:
        for number in range(400_000):
            writer.raw(number, b"x")
        writer.finish(RunSummary(release_tick=0))
    assert grown_kb(tmp_path / "a.mcap") < 80_000


def test_a_line_without_end_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,theta1,theta2\n" + "1," * 100_000)
    with pytest.raises(RunError, match="line 2 is longer than"):
        read_table(tmp_path / "a.csv")


def test_more_rows_than_a_recording_has_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(rows=60))
    (tmp_path / "a.csv").write_text("t,a\n" + "1,2\n" * 61)
    with pytest.raises(RunError, match="more than 60 rows"):
        read_table(tmp_path / "a.csv")
    (tmp_path / "a.csv").write_text("t,a\n" + "1,2\n" * 60)
    assert len(read_table(tmp_path / "a.csv").column("a")) == 60

"""The date of a recording is that of its option, its time stamps or its file name, never that of the import."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.configs import BUILTIN
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.inspect import info
from dpr_lab.storage.tables.options import ImportOptions, date_in, parse_recorded_at

TABLES = BUILTIN / "tables"
OPTIONS = ImportOptions(unit="deg", angles="relative", zero="hanging")


def test_the_date_is_given_or_that_of_the_stamps(tmp_path: Path) -> None:
    file, rig = TABLES / "side.csv", load_rig(TABLES / "bench.toml")
    run = import_csv(file, rig, OPTIONS, tmp_path / "a.mcap")
    assert (run.recorded_utc, info(tmp_path / "a.mcap").recorded_utc) == ("", "")
    named = tmp_path / "2026-03-01 side.csv"
    shutil.copy(file, named)
    assert import_csv(named, rig, OPTIONS).recorded_utc == date_in("X1_2026-03-01_b") == "2026-03-01"
    dated = replace(OPTIONS, recorded_at="2026-03-01T14:30+01:00", note="cold oil")
    assert import_csv(file, rig, dated, tmp_path / "b.mcap").recorded_utc == "2026-03-01T13:30:00+00:00"
    written = info(tmp_path / "b.mcap")
    assert (written.recorded_utc, written.note) == ("2026-03-01T13:30:00+00:00", "cold oil")
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    rows[:, 0] += datetime(2025, 7, 1, 12, tzinfo=UTC).timestamp()
    stamped = tmp_path / "stamped.csv"
    np.savetxt(stamped, rows, delimiter=",", header="t,theta1,theta2", comments="", fmt="%.6f")
    assert import_csv(stamped, rig, OPTIONS).recorded_utc == "2025-07-01T12:00:00+00:00"


@pytest.mark.parametrize("title", ["=== SESSION: 2025-04-10T01:05:42 ===", "# recorded 2025-04-10 01:05:42, cold"])
def test_a_date_above_the_numbers_is_that_of_the_recording(tmp_path: Path, title: str) -> None:
    """The file name contains the date of a copy."""
    file, rig = tmp_path / "2026-03-01.csv", load_rig(TABLES / "bench.toml")
    file.write_text(f"{title}\n{(TABLES / 'side.csv').read_text()}")
    local = datetime(2025, 4, 10, 1, 5, 42).astimezone(UTC).isoformat()
    assert import_csv(file, rig, OPTIONS).recorded_utc == local


@pytest.mark.parametrize("text", ["yesterday", "2026-13-01", "2026-03-01T25:00", "9999-12-31"])
def test_an_invalid_date_is_refused(text: str) -> None:
    assert parse_recorded_at("2026-03-01") == "2026-03-01"
    with pytest.raises(ValueError, match="recorded_at"):
        ImportOptions(recorded_at=text)


@pytest.mark.parametrize("name", ["swing", "swing 01-03-2026", "2026-13-01", "2026-03-01 to 2026-03-04", "9999-12-31"])
def test_an_ambiguous_or_invalid_date_in_a_file_name_is_ignored(name: str) -> None:
    assert date_in(name) == ""

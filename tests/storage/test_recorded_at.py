"""The date of a recording is that of its option, its time stamps or its file name, never that of the import."""

import shutil
import time
from collections.abc import Iterator
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


@pytest.fixture
def in_tokyo(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Set the local time to UTC + 9 h."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("in_tokyo")
@pytest.mark.parametrize(
    ("text", "utc"),
    [
        ("=== SESSION: 2025-04-10T12:05:42 ===", "2025-04-10T03:05:42+00:00"),
        ("recorded 2025-04-10 01:05:42, cold", "2025-04-09T16:05:42+00:00"),
        ("recorded 2025-04-10 01:05:42+02:00", "2025-04-09T23:05:42+00:00"),
        ("recorded 2025-04-10 01:05:42 -0500.", "2025-04-10T06:05:42+00:00"),
        ("2025-04-10T01:05:42Z", "2025-04-10T01:05:42+00:00"),
        ("2025-04-10T01:05:42.250000Z", "2025-04-10T01:05:42+00:00"),
        ("swing of 2025-04-10, begin 2025-04-10 01:05Z", "2025-04-10T01:05:00+00:00"),
        ("begin 2025-04-10 01:05, end 2025-04-10 01:07", "2025-04-10"),
        ("begin 2025-04-10 01:05, copied 2025-04-11", ""),
        ("2025-04-10 25:00", "2025-04-10"),
    ],
)
def test_the_date_in_a_text_has_its_zone(text: str, utc: str) -> None:
    assert date_in(text) == utc


@pytest.mark.usefixtures("in_tokyo")
@pytest.mark.parametrize("more", [0, 60])
def test_a_date_above_the_numbers_is_that_of_the_recording(tmp_path: Path, more: int) -> None:
    """The file name contains the date of a copy."""
    file, rig = tmp_path / "2026-03-01.csv", load_rig(TABLES / "bench.toml")
    title = "# recorded 2025-04-10 01:05:42+02:00\n" + "# setting\n" * more
    file.write_text(title + (TABLES / "side.csv").read_text())
    assert import_csv(file, rig, OPTIONS).recorded_utc == "2025-04-09T23:05:42+00:00"
    columns, *rows = (TABLES / "side.csv").read_text().splitlines()
    epoch = datetime(2025, 7, 1, 12, tzinfo=UTC).timestamp()
    stamps = [f"{epoch + float(row.partition(',')[0]):.6f},{row.partition(',')[2]}" for row in rows]
    file.write_text(title + "\n".join([f"# {columns}", *stamps]))
    assert import_csv(file, rig, OPTIONS).recorded_utc == "2025-07-01T12:00:00+00:00"


@pytest.mark.parametrize("text", ["yesterday", "2026-13-01", "2026-03-01T25:00", "9999-12-31"])
def test_an_invalid_date_is_refused(text: str) -> None:
    assert parse_recorded_at("2026-03-01") == "2026-03-01"
    with pytest.raises(ValueError, match="recorded_at"):
        ImportOptions(recorded_at=text)


@pytest.mark.parametrize("name", ["swing", "swing 01-03-2026", "2026-13-01", "2026-03-01 to 2026-03-04", "9999-12-31"])
def test_an_ambiguous_or_invalid_date_in_a_file_name_is_ignored(name: str) -> None:
    assert date_in(name) == ""

"""Runs are grouped by the time of recording, not by the time of import."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from dpr_lab.drift.groups import Occasion, grouped
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.workflows.drift import watch_drift
from tests.storage.mutated_tables import base_tables

NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


def test_groups_by_date_need_a_date_and_groups_by_label_do_not() -> None:
    runs = [Occasion("a", NOON, "warm"), Occasion("b", None, "cold"), Occasion("c", NOON, "cold")]
    for by in ("day", "session"):
        with pytest.raises(RunError, match=f"cannot group by {by}: 1 of 3 .*: b. .*--recorded-at.*--by label"):
            grouped(runs, by)
    groups = grouped(runs, "label")
    assert (groups.order, groups.group, groups.names) == ((0, 1, 2), (0, 1, 1), ("warm", "cold"))


@pytest.fixture(scope="module")
def tables(paper: Rig, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two tables of an effect-free rig."""
    folder = tmp_path_factory.mktemp("tables")
    for name in ("free", "wild"):
        (folder / f"{name}.csv").write_bytes(base_tables(rig=paper)[name].text())
    return sorted(folder.glob("*.csv"))


@pytest.mark.slow
def test_imported_tables_without_a_date_are_not_grouped_by_the_day_of_the_import(
    paper: Rig, tables: list[Path], tmp_path: Path
) -> None:
    files = [tmp_path / f"{table.stem}.mcap" for table in tables]
    for table, file in zip(tables, files, strict=True):
        import_csv(table, paper, out=file)
    with pytest.raises(RunError, match="2 of 2 runs have no recording time"):
        watch_drift(files, "paper")


@pytest.mark.slow
def test_imported_tables_with_dates_are_grouped_by_these(paper: Rig, tables: list[Path], tmp_path: Path) -> None:
    files = [tmp_path / f"{table.stem}.mcap" for table in tables]
    for table, file, day in zip(tables, files, ("2026-03-02", "2026-03-01T23:30"), strict=True):
        import_csv(table, paper, ImportOptions(recorded_at=day), file)
    result = watch_drift(files, "paper")
    assert result.drift.groups == ("2026-03-01", "2026-03-02")

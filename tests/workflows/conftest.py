"""Fixtures of the tests of analyses."""

from collections.abc import Callable
from pathlib import Path

import pytest

from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.identify import IdentifyRequest, identify
from tests.storage.mutated_tables import MutatedTable, mutated_tables


@pytest.fixture(scope="session")
def tables(paper: Rig) -> dict[str, MutatedTable]:
    return {table.name: table for table in mutated_tables(rig=paper)}


@pytest.fixture(scope="session")
def clean(
    paper: Rig, tables: dict[str, MutatedTable], made_once: Callable[[str, Callable[[Path], None]], Path]
) -> Path:
    """Folder of a run without a mistake, its model, and the settings of a short search."""

    def make(folder: Path) -> None:
        (folder / "quick.toml").write_text('algorithm = "iga"\ngenerations = 2\n')
        table = tables["wild/none"]
        import_csv(table.write(folder), paper, table.options, folder / "clean.mcap")
        settings = str(folder / "quick.toml")
        identify(IdentifyRequest((folder / "clean.mcap",), "paper", folder / "model.json", settings=settings))

    return made_once("clean_table", make)

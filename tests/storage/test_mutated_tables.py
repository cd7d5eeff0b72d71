"""A table with a mistake is imported or refused with a message, without any other exception."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError, RunError
from dpr_lab.report.plain import as_json
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.understand import understand
from tests.storage.mutated_tables import MUTATIONS, MutatedTable, mutated_tables
from tests.thinned import FULL, thinned

TURNS = 5
"""Number of turns, equal to the number of base tables."""
SLOW = {"noise_only", "zeros_between"}
"""Tables whose readings are compared for seconds; `make test` imports tables with outliers and stale readings."""


@pytest.fixture(scope="module")
def tables(paper: Rig) -> list[MutatedTable]:
    return mutated_tables(rig=paper)


@pytest.mark.slow
def test_the_mutated_tables_are_many_and_always_the_same(paper: Rig, tables: list[MutatedTable]) -> None:
    assert len({table.name for table in tables}) == len(tables) >= 200
    assert {table.mutation for table in tables} == set(MUTATIONS)
    again = mutated_tables(rig=paper)
    assert [table.name for table in again] == [table.name for table in tables]
    assert [table.content for table in again[::9]] == [table.content for table in tables[::9]]


def turn(table: MutatedTable, tables: list[MutatedTable]) -> int:
    """Turn in which a table is imported: the first has every mutation once, the others have it on another base."""
    names = [each.name for each in tables if each.mutation == table.mutation]
    return (names.index(table.name) + list(MUTATIONS).index(table.mutation)) % len(names)


@pytest.mark.slow
@pytest.mark.parametrize("number", thinned(range(TURNS), TURNS))
def test_no_mistake_in_a_table_ends_in_another_error_than_a_sentence(
    paper: Rig, tables: list[MutatedTable], tmp_path: Path, number: int
) -> None:
    chosen = [table for table in tables if turn(table, tables) == number]
    assert number or {table.mutation for table in chosen} == set(MUTATIONS)
    if not FULL:
        chosen = [table for table in chosen[::2] if table.mutation not in SLOW]
    for index, table in enumerate(chosen):
        file = table.write(tmp_path)
        try:
            run = import_csv(file, paper, table.options)
        except (RunError, ConfigError):
            with pytest.raises((RunError, ConfigError), match=file.name):
                understand(file, paper, table.options)
        else:
            assert np.isfinite(run.theta).all(), table.name
            assert (np.diff(run.t) > 0).all(), table.name
            if index % 10 and not FULL:
                continue  # a preview reads the table as the import does
            as_json(understand(file, paper, table.options).to_json())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "unit", "scale", "cause"),
    [
        ("torque_mNm", "", {}, "the torques are in mN m"),
        ("torque_mNm", "_Nm", {}, "the torques must be multiplied by 0.001"),
        ("none", "", {"tau1": 1e-3, "tau2": 1e-3}, "the torques must be multiplied by 1000"),
    ],
)
def test_the_unit_of_torques_is_named_only_if_neither_an_option_nor_a_name_states_it(
    name: str, unit: str, scale: dict[str, float], cause: str, tables: list[MutatedTable], paper: Rig, tmp_path: Path
) -> None:
    table = next(table for table in tables if table.name == f"driven/{name}")
    file = table.write(tmp_path)
    file.write_text(file.read_text().replace("_Nm", unit))
    options = replace(table.options, scale=scale)
    assert f"it is if {cause} (" in understand(file, paper, options).questions[0].sentence

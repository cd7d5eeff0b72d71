"""Analyses of mutated tables give a message or a finite result, and never an incorrect cause with a high probability.

The tables are of a rig without any effect, so that every cause that is named of them is wrong.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.errors import ConfigError, DprError, RunError
from dpr_lab.report.plain import as_json
from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.workflows.compare import CompareRequest, compare
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.drift import watch_drift
from dpr_lab.workflows.identifiability import identifiability
from dpr_lab.workflows.identify import IdentifyRequest, identify
from tests.storage.mutated_tables import (
    MUTATIONS,
    MutatedTable,
    Sheet,
    base_tables,
    doubly_mutated,
)
from tests.thinned import thinned

BASES = ("free", "wild", "degrees", "counts", "driven")
CASES = [f"{base}/{mutation}" for mutation in MUTATIONS for base in BASES]
QUICK = ("degrees/held_start",)
"""Tables of `make test`."""
SEEDS = 60
SURE = 0.9


@pytest.fixture(scope="module")
def sheets(paper: Rig) -> dict[str, Sheet]:
    return base_tables(rig=paper)


def finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return all(map(finite, parts))


def answer(analysis: Callable[[], Any]) -> Any:
    """Result of an analysis, or its message if it refuses the table."""
    try:
        return analysis()
    except DprError:
        return None


def analysed(table: MutatedTable, paper: Rig, clean: Path, tmp_path: Path) -> dict[str, Any] | None:
    """The diagnosis of a table that is imported and diagnosed; all analyses answer in finite JSON or in a sentence."""
    run = tmp_path / "run.mcap"
    try:
        import_csv(table.write(tmp_path), paper, table.options, run)
    except (RunError, ConfigError):
        return None
    model = tmp_path / "model.json"
    settings = str(clean / "quick.toml")
    if answer(lambda: identify(IdentifyRequest((run,), "paper", model, settings=settings))):
        written = json.loads(model.read_text())
        assert finite(written)
        if isinstance(scale := written["scale"], dict):  # of a moving arm it is the name of an inertia
            low, high = scale["interval90"]
            assert low <= scale["b"] <= high
    if known := answer(lambda: identifiability("paper", [run])):
        as_json(known.identifiability.to_json())
    if compared := answer(lambda: compare(CompareRequest((run,), clean / "model.json", tmp_path / "compared"))):
        as_json(compared.saved)
    if drifted := answer(lambda: watch_drift([clean / "clean.mcap", run], "paper", "label")):
        as_json(drifted.to_json())
    diagnosed = answer(lambda: diagnose(DiagnoseRequest((run,), "paper")))
    result = diagnosed.to_json() if diagnosed else None
    assert result is None or finite(json.loads(as_json(result)))
    return result


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in CASES])
def test_no_mistake_in_a_table_ends_in_a_traceback_or_a_sure_wrong_cause(
    paper: Rig, tables: dict[str, MutatedTable], clean: Path, tmp_path: Path, name: str
) -> None:
    if name not in tables:
        pytest.skip("the mutation does not apply to this table")
    result = analysed(tables[name], paper, clean, tmp_path)
    assert result is None or [effect for effect in result["effects"] if effect["probability"] > SURE] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", thinned(range(SEEDS), SEEDS))
def test_two_mistakes_in_a_table_end_in_finite_numbers_or_a_sentence(
    paper: Rig, sheets: dict[str, Sheet], clean: Path, tmp_path: Path, seed: int
) -> None:
    base = BASES[seed % len(BASES)]
    analysed(doubly_mutated(base, sheets[base], seed), paper, clean, tmp_path)

"""No result contains a non-finite number, for any mounting of the rods and any fault of the logger.

`tests/workflows/test_mutated_tables.py` does the same for tables of both rods that are described wrongly.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.faulty_loggers import FAULTS, log
from tests.storage.mutated_tables import MutatedTable, Sheet, base_tables
from tests.workflows.test_mutated_tables import analysed

RATE_HZ, DURATION_S = 200.0, 2.5
RODS: dict[str, dict[str, str]] = {
    "inner": {"mounted": "inner"},
    "outer": {"mounted": "outer"},
    "elbow": {"elbow": "clamped"},
}
KINDS = ("both", *RODS, "driven", "prescribed arm", "free arm")
"""Mounted rods, and their drives."""

Change = Callable[[Sheet, np.random.Generator], Sheet]


def _angles(sheet: Sheet) -> NDArray[np.float64]:
    return np.stack([sheet.columns["theta1"], sheet.columns["theta2"]])


def _with_angles(sheet: Sheet, angles: NDArray[np.float64]) -> Sheet:
    return sheet.with_columns(theta1=angles[0], theta2=angles[1])


def _logged(fault: str) -> Change:
    def change(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        t = sheet.columns["t"]
        logged = log(fault, t, 1 / RATE_HZ, rng)
        taken = np.array([np.interp(logged.taken, t, column) for column in _angles(sheet)])[:, logged.sent]
        return _with_angles(sheet.with_columns(t=logged.stamps), taken)

    return change


def _stuck(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    angles, half = _angles(sheet), sheet.n // 2
    angles[:, half:] = angles[:, half : half + 1]
    return _with_angles(sheet, angles)


def _dead(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    return sheet.with_columns(theta2=np.full(sheet.n, np.pi))


def _spike(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    angles = _angles(sheet)
    angles[int(rng.integers(2)), int(rng.integers(20, sheet.n))] += 1e6
    return _with_angles(sheet, angles)


CHANGES: dict[str, Change] = {
    "as it is": lambda sheet, rng: sheet,
    **{fault: _logged(fault) for fault in FAULTS},
    "short": lambda sheet, rng: sheet.rows(slice(0, 40)),
    "very short": lambda sheet, rng: sheet.rows(slice(0, 12)),
    "slow": lambda sheet, rng: sheet.rows(slice(0, None, 8)),
    "stuck from the middle on": _stuck,
    "one dead encoder": _dead,
    "one spike": _spike,
    "spins": lambda sheet, rng: _with_angles(sheet, _angles(sheet) + 40 * sheet.columns["t"]),
    "hardly moves": lambda sheet, rng: _with_angles(sheet, np.pi + 1e-6 * (_angles(sheet) - np.pi)),
    "noise alone": lambda sheet, rng: _with_angles(sheet, np.pi + rng.normal(0, 0.3, (2, sheet.n))),
    "coarse": lambda sheet, rng: _with_angles(sheet, np.round(_angles(sheet), 1)),
    "without noise": lambda sheet, rng: _with_angles(sheet, np.pi + 0.5 * np.cos([[5.0], [7.0]] * sheet.columns["t"])),
    "late start": lambda sheet, rng: sheet.with_columns(t=sheet.columns["t"] + 1.7e9),
    "slow motion": lambda sheet, rng: sheet.with_columns(t=sheet.columns["t"] * 100),
    "time lapse": lambda sheet, rng: sheet.with_columns(t=sheet.columns["t"] / 100),
}
CASES = [f"{kind}/{change}" for kind in KINDS for change in CHANGES]
QUICK = ("outer/coarse", "prescribed arm/one dead encoder")
"""Cases of `make test`."""


def table_of(kind: str, paper: Rig) -> tuple[Sheet, Rig]:
    """Table of a rig without a mistake, and the rig with its mounted rods."""
    if kind == "driven":
        return base_tables(rig=paper)["driven"], paper
    rig = paper.with_rods(**RODS[kind]) if kind in RODS else paper
    one = rig.model_copy(update={"poses": {"X2": rig.poses["X2"]}})
    run = record(load_plant("paper", 3), one, DURATION_S, round(RATE_HZ))[0].swing
    columns = {"t": run.t, "theta1": run.theta[:, 1], "theta2": run.theta[:, 2]}
    if kind.endswith("arm"):
        options = {"arm": kind.split()[0]}
        return Sheet({**columns, "theta0": 0.2 * np.sin(3 * run.t)}, options), rig
    return Sheet(columns), rig


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in CASES])
def test_every_result_is_finite_or_a_sentence(paper: Rig, clean: Path, tmp_path: Path, name: str, few_readings) -> None:
    few_readings("no interpretation is expected")
    kind, _, change = name.partition("/")
    sheet, rig = table_of(kind, paper)
    rng = np.random.default_rng(CASES.index(name))
    changed = CHANGES[change](replace(sheet, columns=dict(sheet.columns)), rng)
    table = MutatedTable(name.replace(" ", "-"), change, changed, ImportOptions(**changed.options))
    analysed(table, rig, clean, tmp_path)

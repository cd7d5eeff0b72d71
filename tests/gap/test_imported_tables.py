"""The imported table of a captured run gives the same verdict as the run, including its rest."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.export import export
from tests.thinned import thinned

FEW = ("detent_joint2", "spring_joint2", "coulomb_joint2", "clock_rate")


@pytest.mark.slow
@pytest.mark.parametrize("later_s", thinned([4.2, 0.0], 2))
def test_the_exported_table_of_a_clean_rig_shows_no_gap(
    recorded: Callable[..., list[Run]], paper: Rig, tmp_path: Path, later_s: float
) -> None:
    tables = []
    for run in recorded({}, seed=4, duration=2.5):
        file = export(replace(run, t=run.t + later_s, counts=None), tmp_path / f"{run.name}.csv")
        tables.append(import_csv(file, paper, out=tmp_path / f"{run.name}.mcap"))
    assert all(len(run.rest) > 100 and np.abs(run.t).min() == 0 for run in tables)
    diagnosis = diagnose(tables, paper, library={name: EFFECTS[name] for name in FEW})
    assert (diagnosis.verdict, diagnosis.effects) == ("no_gap", []), diagnosis.sentence

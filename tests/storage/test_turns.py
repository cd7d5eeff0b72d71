"""Angles in turns or half turns that a logger wraps are reported with the options that read them."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.rig import parse_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.plausible import turn_notes
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

T = np.arange(0.0, 6.0, 0.02)
HANGING = np.pi + 0.9 * np.cos(6.0 * T) * np.exp(-T / 20)  # rad, 0 = upright


def wrapped(period: float) -> np.ndarray:
    return (HANGING / (2 * np.pi) * period + period / 2) % period - period / 2


@pytest.mark.parametrize(("period", "scale"), [(1.0, 2 * np.pi), (2.0, np.pi)])
def test_wrapped_turns_are_reported_with_their_options(tmp_path: Path, period: float, scale: float) -> None:
    rig = parse_rig(draft_rig(RigMeasures("turns", 0.4, None, Measure(0.1), None, mounted="inner")))
    file = tmp_path / "turns.csv"
    np.savetxt(file, np.column_stack([T, wrapped(period)]), "%.6f", ",", header="t_s,theta1_rad", comments="")
    note = f"--wrap {period:g} --scale {scale:.6g}"
    assert any(note in line for line in import_csv(file, rig).notes)
    run = import_csv(file, rig, ImportOptions(wrap=period, scale={"theta1": scale}))
    assert not any(note in line for line in run.notes)
    np.testing.assert_allclose(run.theta[:, 1], HANGING, atol=1e-4)


@pytest.mark.parametrize("swing", [np.sin(6.0 * T), 0.99 * np.sign(np.sin(T)), wrapped(2 * np.pi)])
def test_angles_in_radians_get_no_note(swing: np.ndarray) -> None:
    assert turn_notes({"theta1": swing}) == []


@pytest.mark.parametrize("period", [1.0, 2.0])
def test_wraps_of_a_fast_rod_are_reported(period: float) -> None:
    turns = 0.31 * np.arange(40) + 0.05 * np.sin(np.arange(40))
    assert turn_notes({"theta1": (turns * period) % period - period / 2})

"""Zero and height of a single rod in a table."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.rig import Rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv

T = np.arange(0, 1, 0.01)


def table(folder: Path, header: str, *columns: np.ndarray) -> Path:
    file = folder / "swing.csv"
    np.savetxt(file, np.column_stack(columns), delimiter=",", header=header, comments="")
    return file


def test_a_signed_counter_stored_without_sign_keeps_its_zero(one: Rig, tmp_path: Path) -> None:
    counts = np.round(700 * np.sin(7 * T) - 1)
    file = table(tmp_path, "t,theta1", T, counts % 2**16)
    run = import_csv(
        file, one, ImportOptions(zero="hanging", unit="counts", wrap=2.0**16, columns={"theta1": "theta1"})
    )
    turn = 2 * np.pi / one.encoders.counts_per_rev[1]
    np.testing.assert_allclose(run.theta[:, 1] - np.pi, counts[-len(run.t) :] * turn, atol=1e-9)


@pytest.mark.parametrize(("zero", "asks"), [("upright", False), ("hanging", True)])
def test_a_rod_that_lingers_upright_before_it_falls_needs_no_other_zero(
    one: Rig, tmp_path: Path, zero: str, asks: bool
) -> None:
    t = np.arange(0.0, 2.2, 0.01)
    fall = 4 * np.arctan(np.exp(5.5 * (t - 1.6)))  # separatrix of a rod with 5.5 rad/s
    angle = fall if zero == "upright" else 2.5 * np.sin(5 * t) ** 3
    notes = import_csv(table(tmp_path, "t,theta1", t, angle), one, ImportOptions(keep_rest=True)).notes
    assert any("points upwards most of the time" in note for note in notes) is asks

"""Tables and identification of an inner rod that a strong motor moves; tests for passive rigs are not applied."""

import numpy as np
import pytest

from dpr_lab.identification.misread.tried import check_description
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from tests.gap.test_moving_arm import prescribed


@pytest.mark.slow
@pytest.mark.parametrize("hanging", [pytest.param(False, marks=pytest.mark.long), True])
def test_its_table_is_not_compared_with_a_free_swing(tmp_path, hanging):
    rig, run, _ = prescribed(seconds=4.0)
    theta, t = run.theta, run.t
    if hanging:  # the motor starts after a rest of the hanging rods
        rest = np.full((500, 3), np.pi) * [0, 1, 1] + np.random.default_rng(1).normal(0, 2e-4, (500, 3))
        theta, t = np.concatenate([rest, theta - theta[0] + [0, np.pi, np.pi]]), 2e-3 * np.arange(500 + len(theta))
    table = tmp_path / "moved.csv"
    rows = np.column_stack([t, theta[:, 1:]])
    np.savetxt(table, rows, delimiter=",", header="t,theta1,theta2", comments="", fmt="%.9f")
    read = import_csv(table, rig, ImportOptions(inner="prescribed"))
    assert read.inner is not None
    assert not [note for note in read.notes if "times as fast" in note or "energy" in note]


@pytest.mark.slow
def test_the_energy_that_its_motor_supplies_is_no_mistake():
    rig, run, _ = prescribed(seconds=4.0, friction=0.004)
    assert check_description([run], rig).energy_rise == 0.0

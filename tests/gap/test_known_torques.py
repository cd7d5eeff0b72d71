"""Torques that change between rows are taken as samples, and are not called late."""

import numpy as np
import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.setup import Torques
from tests.bench_rigs import bench


def test_a_sampled_torque_acts_around_its_instant():
    torques = Torques(np.array([0.0, 0.1, 0.3]), np.arange(6.0).reshape(3, 2))
    sampled = torques.sampled()
    np.testing.assert_allclose(sampled.t, [-0.05, 0.05, 0.2])
    np.testing.assert_array_equal(sampled.joints, torques.joints)


@pytest.mark.slow
def test_a_torque_sensor_of_one_rod_is_not_called_early():
    case = bench("driven", 205)
    diagnosis = diagnose(case.runs, case.rig, held_out=case.held_out)
    assert diagnosis.verdict == "named"
    assert {effect.name for effect in diagnosis.effects} == {"coulomb_joint1", "torque_offset_joint1"}
    assert any("known torques change between rows" in sentence for sentence in diagnosis.assumptions)

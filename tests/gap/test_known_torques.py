"""Torques that change between rows act before their rows; the diagnosis does not report an early torque."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig
from dpr_lab.setup import Torques
from sim_device.plant.config import load_plant
from sim_device.plant.drives import JointDrives
from sim_device.trials.offline_recorder import record
from tests.bench_rigs import bench
from tests.thinned import candidates

LIKELY = candidates("coulomb", "torque_", "input_delay", "latency", "encoder_offset")


def test_a_sampled_torque_acts_around_its_instant():
    torques = Torques(np.array([0.0, 0.1, 0.3]), np.arange(6.0).reshape(3, 2))
    sampled = torques.earlier(0.5)
    np.testing.assert_allclose(sampled.t, [-0.05, 0.05, 0.2])
    np.testing.assert_array_equal(sampled.joints, torques.joints)


def test_samples_of_a_continuous_torque_have_its_mean_between_rows_and_do_not_overshoot():
    t = np.arange(0, 4, 0.02)
    torque = np.sin(9 * t)
    held = Torques(t, np.stack([torque, 0 * t], axis=1), on_arm=torque)
    exact = np.diff(-np.cos(9 * t) / 9) / 0.02
    for mean in (held.as_samples().mean_before(t)[1:, 0], np.diff(np.interp(t, *held.as_samples().arm_knots)) / 0.02):
        assert abs(mean - exact).max() < 4e-3  # at the maxima
        assert abs(mean @ exact / (exact @ exact) - 1) < 1e-4  # the mean of two rows is too small by 2.7e-3
    step = np.where(t < 2, -1.0, 1.0)
    assert abs(Torques(t, np.stack([step, step], axis=1)).as_samples().joints).max() <= 1.0 + 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("renewed_s", "share"), [pytest.param(0.005, 0.4, marks=pytest.mark.long), (0.010, 0.6)])
def test_torques_of_every_fifth_row_are_not_a_delay_of_the_drive(paper: Rig, renewed_s: float, share: float):
    """The drive renews its torque every 5 ms; or once per row of 25 ms, but this long after the row."""
    t, slow = np.arange(0, 3.01, 0.005), renewed_s > 0.005
    instants = np.floor((t - renewed_s) / 0.025 + 1e-9) * 0.025 + renewed_s if slow else t
    plant = load_plant("paper", 1)
    torques = 0.1 * np.sin(7 * np.stack([instants, instants + 1], axis=1))
    run = record(plant, paper, 3.0, 200, JointDrives(t, torques, plant.drives, 1))[0].swing
    diagnosis = diagnose([replace(run.only(np.arange(len(run.t)) % 5 == 0), rate_hz=40.0)], paper, library=LIKELY)
    assert diagnosis.verdict == "no_gap"
    stated = f"earlier than its time stamp, by {share:.2f} of the row interval"
    assert any(stated in sentence for sentence in diagnosis.assumptions)


@pytest.mark.long
def test_a_torque_sensor_of_one_rod_is_not_called_early():
    case = bench("driven", 205)
    diagnosis = diagnose(case.runs, case.rig, held_out=case.held_out)
    assert diagnosis.verdict == "named"
    assert {effect.name for effect in diagnosis.effects} == {"coulomb_joint1", "torque_offset_joint1"}
    assert any("known torques change between rows" in sentence for sentence in diagnosis.assumptions)

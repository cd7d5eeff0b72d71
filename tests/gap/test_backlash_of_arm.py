"""Blind plants with backlash: of the arm's gear, read at the motor, and of encoder 1."""

import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import load_rig
from sim_device.plant.arm_drive import arm_drive_of
from sim_device.plant.config import load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.moving_arm import with_arm
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request
from tests.thinned import candidates, thinned

CASES = [
    ("driven_double", "driven", "backlash_joint0", 2),
    ("furuta", "free", "backlash_joint0", 2),
    ("furuta", "driven", "backlash_joint0", 2),
    ("driven_double", "free", "backlash_joint0", 1),
    ("paper", "clamped", "backlash_joint1", 1),
]
"""Rig, mode of its arm, hidden effect, seed."""
DURATION_S, RATE_HZ = 3.0, 250
LIKELY = candidates("backlash", "coulomb", "stribeck", "arm_compliance", "latency", "hysteresis", "input_delay")


@pytest.mark.slow
@pytest.mark.parametrize("case", thinned(CASES, 8))
def test_backlash_is_named_and_not_taken_for_friction_compliance_or_latency(case):
    name, mode, effect, seed = case
    plant, rig = weighed(load_plant(name, seed), load_rig(name))
    if mode != "clamped":
        rig, plant = with_arm(rig, plant, mode)
    hidden = draw_plant(parse_request(f"single:clear:{effect}"), plant, rig)
    runs = record(hidden, rig, DURATION_S, RATE_HZ, drives=arm_drive_of(hidden))
    diagnosis = diagnose(runs, rig, library=LIKELY)
    assert [one.name for one in diagnosis.effects] == [effect]
    assert diagnosis.effects[0].members == [effect]
    size = diagnosis.effects[0].parameters["play_rad"].value
    assert size == pytest.approx(hidden.effects[effect]["play_rad"], rel=0.02)
    assert diagnosis.verdict in ("named", "partly_explained")  # means over samples blur the jumps of a driven motor

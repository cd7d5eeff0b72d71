"""Drawn plants with a free or driven arm: only the hidden effect is visible."""

import numpy as np
import pytest

from dpr_lab.effects import OF_ARM
from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig
from sim_device.options import Options
from sim_device.plant.config import load_plant
from sim_device.trials.arm_gap import arm_gap
from sim_device.trials.draw import draw_plant
from sim_device.trials.moving_arm import drawn_arm, visible_on_arm, with_arm
from sim_device.trials.request import parse_request
from sim_device.trials.trial import drawn_trial


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "mode"), [("furuta", "driven"), pytest.param("driven_double", "free", marks=pytest.mark.long)]
)
def test_a_clean_plant_has_no_gap_and_a_drawn_effect_one_that_shows(name: str, mode: str) -> None:
    rig, plant = with_arm(load_rig(name), load_plant(name, 5), mode)
    clean = draw_plant(parse_request("clean"), plant, rig)
    assert clean.effects == {}
    assert (clean.arm.mode, clean.arm_drive is None) == (mode, mode == "free")
    assert arm_gap(clean, rig) < 1e-2
    asked = draw_plant(parse_request("single:clear:coulomb_joint0"), plant, rig)
    assert list(asked.effects) == ["coulomb_joint0"]
    assert 1.9 < arm_gap(asked, rig) < 21.0
    subtle = draw_plant(parse_request("single:subtle:coulomb_joint0"), plant, rig)
    assert 0.4 < arm_gap(subtle, rig) < 1.6


def test_what_is_drawn_acts_at_the_arm_and_only_a_drive_has_its_faults() -> None:
    plant = load_plant("furuta")
    driven = set(visible_on_arm(plant))
    free = set(visible_on_arm(with_arm(load_rig("furuta"), plant, "free")[1]))
    assert driven - free == {
        "torque_offset_joint0",
        "torque_ripple_joint0",
        "dead_zone_joint0",
        "saturation_joint0",
        "input_delay",
    }
    assert free < set(OF_ARM)


def test_a_saturated_drive_gives_nothing_beyond_a_limit_that_its_program_reaches() -> None:
    rig, plant = with_arm(load_rig("furuta"), load_plant("furuta", 8), "driven")
    drawn = draw_plant(parse_request("single:clear:saturation_joint0"), plant, rig).effects["saturation_joint0"]
    assert plant.arm_drive is not None
    assert drawn["share"] == 1.0
    assert 0.2 < drawn["limit_Nm"] / (plant.arm_drive.amplitude * plant.arm_drive.torque_per_input) < 0.9


@pytest.mark.slow
def test_a_trial_of_a_driven_arm_reports_its_input_and_seals_its_fault() -> None:
    options = Options(rig="furuta", plant="furuta", arm="driven", draw_effects="single:clear:dead_zone_joint0", seed=4)
    trial = drawn_trial(options, load_rig("furuta"))
    assert list(trial.kept["truth"]["effects"]) == ["dead_zone_joint0"]
    (first, *_) = trial.report(direct=True)["runs"]
    assert first["arm_mode"] == "driven"
    assert len(first["arm_input"]) == len(first["t"])
    assert 3.0 < max(first["arm_input"]) < 5.0
    assert "torques" not in first


def test_a_rig_without_a_drive_and_kinds_of_other_rigs_are_refused() -> None:
    with pytest.raises(ConfigError, match="use --rig and --plant driven_double"):
        with_arm(load_rig("paper"), load_plant("paper"), "driven")
    rig, plant = with_arm(load_rig("furuta"), load_plant("furuta"), "free")
    with pytest.raises(ConfigError, match="not available with a moving arm; available: single"):
        draw_plant(parse_request("outside"), plant, rig)


def test_drawn_arms_and_programs_differ() -> None:
    plant = load_plant("furuta")
    drawn = [drawn_arm(plant, np.random.default_rng(seed)) for seed in range(12)]
    assert len({one.arm.J0 for one in drawn}) == 12
    assert {one.arm_drive.program for one in drawn if one.arm_drive} == {"sines", "chirp", "prbs"}

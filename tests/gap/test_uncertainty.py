"""Intervals include quantities that the fit assumes as known, and steps due to backlash are not sensor faults."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.gap.conclusion.ratios import fitted_scale
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.refits import refit
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Parameter
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed as weighed_rig
from tests.thinned import candidates


def weighed(rig: Rig, mass: float, std: float) -> Rig:
    """Rig file whose inner rod was weighed with a standard uncertainty."""
    nominal = rig.parameters["m1"].nominal
    return rig.model_copy(
        update={"parameters": {**rig.parameters, "m1": Parameter(nominal=nominal, measured=mass, std=std)}}
    )


@pytest.mark.long
def test_a_mass_weighed_badly_widens_what_follows_from_it(recorded, paper: Rig):
    mass = paper.parameters["m1"].nominal
    runs = recorded({"com_offset_link1": {"offset_m": 1e-3}})
    library = {"com_offset_link1": EFFECTS["com_offset_link1"]}
    result = [
        diagnose(runs, weighed(paper, own, std), library=library)
        for own, std in ((mass, 1e-9), (mass, 0.02 * mass), (1.02 * mass, 1e-9))
    ]
    sharp, wide, heavier = (entry.effects[0].parameters["offset_m"] for entry in result)
    scaled = heavier.value * result[0].scale_b / result[2].scale_b
    assert scaled == pytest.approx(sharp.value / 1.02, rel=2e-3)  # what a refit says of such an error
    reach = (wide.interval90[1] - wide.interval90[0]) / 2
    assert reach == pytest.approx(
        np.hypot(1.645 * 0.02 * abs(sharp.value), (sharp.interval90[1] - sharp.value)), rel=0.1
    )


@pytest.mark.slow
def test_steps_of_a_play_are_not_missed_counts(recorded, paper: Rig):
    runs = recorded({"backlash_joint2": {"play_rad": 0.012}}, duration=8.0)
    diagnosis = diagnose(runs, paper, library=candidates("backlash", "missed", "coulomb", "encoder"))
    assert [effect.name for effect in diagnosis.effects] == ["backlash_joint2"]
    assert not [finding for finding in diagnosis.sensor_findings if finding.name == "missed_counts"]


def test_a_scale_from_friction_that_follows_the_load_has_no_condition(paper: Rig, bare):
    plant, rig = weighed_rig(load_plant("paper", 3), paper)
    effects = {"load_friction_joint2": {"friction_radius_m": 6e-4}}
    problem, model = bare(record(plant.model_copy(update={"effects": effects}), rig, 1.0), rig)
    start = model.estimate.changed(params=effect_params(effects))
    model = refit(problem, start, tuple(effects), iterations=3)
    scale = fitted_scale(problem, model.fit, covariance(problem, model, rig), rig)
    assert scale is not None
    assert scale.condition == ""


@pytest.mark.long
def test_friction_that_follows_the_load_shows_the_scale(paper: Rig):
    plant, rig = weighed_rig(load_plant("paper", 3), paper)
    result = plant.model_copy(update={"effects": {"load_friction_joint2": {"friction_radius_m": 6e-4}}})
    diagnosis = diagnose(
        record(result, rig, 5.0), rig, library={"load_friction_joint2": EFFECTS["load_friction_joint2"]}
    )
    true_b = base_parameters(result.Z, rig.rig.L1, rig.rig.g)[BASE.index("b")]
    assert diagnosis.scale_b == pytest.approx(true_b, rel=0.02)
    assert diagnosis.effects[0].parameters["friction_radius_m"].value == pytest.approx(6e-4, rel=0.02)
    assert any("fixes the scale" in sentence for sentence in diagnosis.assumptions)

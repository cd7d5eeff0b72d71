"""Torques along a known trajectory, compared with the equations of motion of the whole rig."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.effects.effect import Recorded
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.response import trajectory
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.hypothesis import scan
from dpr_lab.gap.hypothesis.scan import ShapeScan
from dpr_lab.rig import Rig, load_rig
from sim_device.plant.arm_drive import arm_drive_of
from sim_device.plant.config import load_plant
from sim_device.trials.moving_arm import with_arm
from sim_device.trials.offline_recorder import record

WHOLE_S = 2.0  # no initial state but that of the release, so that the arm's past is the model's
COUPLING = 1e-4  # small enough to be linear


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [4.0, 12.0])
def test_the_response_of_a_compliant_arm_agrees_with_the_whole_rig(recorded, screened, paper: Rig, frequency: float):
    problem, initial = screened(recorded({}, duration=WHOLE_S)).cut(2 * WHOLE_S)
    arm = {"coupling_per_kg": COUPLING, "frequency_hz": frequency, "damping_ratio": 0.05}
    held, loose = (
        Estimate.of(nominal_ratios(paper), effect_params({"arm_compliance": a} if a else {}), initial)
        for a in ({}, arm)
    )
    whole = problem.predict(loose) - problem.predict(held)
    along = trajectory(problem, held)
    linear = along.response(problem, along.torques("arm", problem.model.constants, loose.params[None]))[:, :, 0]
    seen = problem.whitened(whole)
    assert len(problem.segments) == 3
    assert np.abs(linear - seen).max() < 0.05 * np.abs(seen).max()


def test_a_driven_arm_turns_as_far_as_the_fitted_gain_says(screened):
    """A pattern over the arm's angle is compared with where the arm was."""
    rig, plant = with_arm(load_rig("furuta"), load_plant("furuta", 1), "driven")
    runs = record(plant, rig, 1.0, 250, drives=arm_drive_of(plant))
    problem, initial = screened(runs, rig).cut(0.5)
    model = {"free_arm": {"inertia_kgm2": 4e-4, "viscous_Nms": 4e-4}, "drive_gain": {"excess": 0.3}}
    estimate = Estimate.of(nominal_ratios(rig), effect_params(model), initial)
    along = trajectory(problem, estimate)
    turned = np.interp(along.at, np.arange(len(along.motion.t)), along.motion.theta[:, 2])
    assert np.ptp(turned) > 0.5
    assert turned == pytest.approx(problem.predict(estimate)[:, 2], abs=1e-3)


@pytest.mark.slow
def test_the_scan_finds_the_arms_frequency_between_the_points_of_its_grid(recorded, bare):
    truth = {"arm_compliance": {"coupling_per_kg": 0.06, "frequency_hz": 7.2, "damping_ratio": 0.08}}
    problem, base = bare(recorded(truth))
    along = trajectory(problem, base.fit.estimate)
    result = ShapeScan(problem, base.fit, along, Recorded((None,))).shapes(EFFECTS["arm_compliance"])
    assert dict(result[0])[param_index("arm_compliance", "frequency_hz")] == pytest.approx(7.2, rel=0.1)


@pytest.mark.slow
def test_a_scan_does_not_lose_the_order_that_is_nearly_gravity(recorded, bare, monkeypatch):
    monkeypatch.setattr(scan, "arc", lambda angle: 4 * np.pi)  # as if the rods had turned twice
    problem, base = bare(recorded({"com_offset_link1": {"offset_m": 2e-3}}))
    along = trajectory(problem, base.fit.estimate)
    recorded_shapes = Recorded((None,))
    next_to_fit = ShapeScan(problem, base.fit, along, recorded_shapes)
    free = next_to_fit.shapes(EFFECTS["detent_joint1"])
    order = param_index("detent_joint1", "order")
    assert min(dict(shape)[order] for shape in free) >= 2.0  # order one is gravity and an offset of the centre of mass
    every = tuple(
        replace(one, scan=(1.0, *one.scan)) if one.scan else one for one in EFFECTS["detent_joint1"].parameters
    )
    result = next_to_fit.shapes(replace(EFFECTS["detent_joint1"], parameters=every))
    assert dict(result[0])[order] == 1.0

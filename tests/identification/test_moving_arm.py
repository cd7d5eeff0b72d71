"""Sealed rig whose arm moves: `identify` and `compare` use its encoder as the prescribed motion of the arm."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.estimation.arm_motion import prescribed_arm
from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.identify import identify
from dpr_lab.rig import load_rig
from sim_device.plant.config import ArmConfig, load_plant
from sim_device.trials.offline_recorder import record


@pytest.mark.slow
def test_a_rig_whose_arm_moves_is_identified_and_compared() -> None:
    rig, drawn = load_rig("paper"), load_plant("paper", 5)
    parameters = drawn.parameters | {"m2": 0.97 * drawn.parameters["m2"], "c1": 1.3 * drawn.parameters["c1"]}
    loose = ArmConfig(mode="free", J0=0.05, c0=0.02, k0=1.0)
    plant = drawn.model_copy(update={"parameters": parameters, "arm": loose})
    recorded = record(plant, rig, 3.0, 500)
    carried = [replace(run, arm=prescribed_arm(run.t, run.theta[:, 0], rig, run.name)) for run in recorded]
    assert max(float(np.ptp(run.theta[:, 0])) for run in recorded) > 0.1
    model = identify(carried[:2], rig)
    truth = ratios(base_parameters(plant.Z, rig.L1, rig.g))
    for name, true in zip(RATIOS, truth.tolist(), strict=True):
        result = model.ratios[name]
        assert abs(result.value / true - 1) < 0.01, name
        if name != "c1/b":  # the noise of the arm's encoder biases it beside
            assert abs(result.value - true) < 2 * result.std, name
    seen, held = (compare_run(run, rig, model) for run in (carried[2], recorded[2]))
    assert seen.held_out
    assert (seen.segment_rms_rad < 1.3 * seen.noise_rad).all()
    assert held.segment_rms_rad.max() > 10 * seen.segment_rms_rad.max()

"""Sealed plants with replayed torques: dpr-lab identifies their common scale."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.identification.identify import identify
from dpr_lab.rig import Rig
from sim_device.trials.driven import driven_runs


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_the_scale_of_a_driven_plant_lies_within_three_standard_deviations(paper: Rig, seed: int) -> None:
    plant, runs = driven_runs(paper, seed)
    assert all(run.torque_kind == "measured" and run.commanded is not None for run in runs)
    result = identify(runs[:2], paper).base["b"]
    true = float(base_parameters(plant.Z, paper.L1, paper.g)[1])
    assert result.std is not None
    assert abs(result.value - true) < 3 * result.std
    assert result.std < 0.02 * true
    assert np.abs(runs[0].torques - runs[0].commanded).max() < 0.02  # pyright: ignore[reportOptionalOperand]

"""Derivatives of the readings where effects remember what happened in the segment before."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.readings import memories, readings
from dpr_lab.effects import effect_vector
from dpr_lab.gap.base_fit import fit_base, nominal_rods
from dpr_lab.gap.problem import START_STEPS
from dpr_lab.gap.record import record

REMEMBERING = {
    "hysteresis_joint2": {"torque_Nm": 2e-3, "length_rad": 0.1},
    "backlash_joint2": {"play_rad": 0.02},
    "arm_compliance": {"coupling_per_kg": 1.0, "frequency_hz": 14.0, "damping_ratio": 0.05},
}


@pytest.mark.parametrize("effect", REMEMBERING)
def test_slopes_by_start_states_are_those_of_wider_differences_with_the_memory_held(recorded, paper, effect):
    truth = {effect: REMEMBERING[effect]}
    made, base = fit_base([record(run, paper) for run in recorded(truth, duration=3.0)], paper, nominal_rods(paper))
    at = replace(base.fit.point, vector=effect_vector(truth))
    memory = memories(at.base, at.vector, made.known, made.pieces, at.starts)
    slopes = made.predict(at)[1]
    for column, step in enumerate(300 * START_STEPS):
        ahead, behind = at.starts.copy(), at.starts.copy()
        ahead[:, column] += step
        behind[:, column] -= step
        wide = [readings(at.base, at.vector, made.known, made.pieces, starts, memory) for starts in (ahead, behind)]
        expected = (wide[0] - wide[1]) / (2 * step)
        off = np.abs(slopes[:, :, column] - expected) > 0.05 * np.abs(expected).max()
        assert off.mean() < 0.02  # an encoder's play has kinks, at which differences depend on their width

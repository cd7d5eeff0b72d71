"""Gauss-Newton with stick-slip motion: joints that rest for most of a recording, and poorly known initial states."""

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.fitting.estimate import Estimate, effect_parameters, ratio_parameters
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.rig import load_rig

NOISE, TICK, SAMPLES = 3e-4, 0.002, 50


def coulomb(first, second):
    return effect_params({"coulomb_joint1": {"torque_Nm": first}, "coulomb_joint2": {"torque_Nm": second}})


@pytest.mark.parametrize(
    ("first", "second", "start", "seconds"), [(0.3, 0.1, (0.9, 1.4), 4), (0.1, 0.03, (0.8, 1.4), 8)]
)
def test_friction_of_joints_that_come_to_rest_is_found(rng, first, second, start, seconds):
    rig = load_rig("paper")
    constants = rig_constants(rig)
    base = base_parameters(rig.nominal, constants.L1, constants.g)
    t = np.arange(0, seconds, TICK)
    states = simulate(base, constants.L1, constants.g, [*np.add(np.pi, start), 0, 0], t, 5e-4, coulomb(first, second))
    read = np.column_stack([states[:, 0], states[:, 1] - states[:, 0]]) + NOISE * rng.standard_normal((len(t), 2))
    chosen = np.arange(30, len(t), 5)
    chosen = chosen[: len(chosen) // SAMPLES * SAMPLES].reshape(-1, SAMPLES)
    began = [round(segment_start(float(t[i])) / TICK) for i in chosen[:, 0]]
    initial = states[began] + rng.normal(0, 1, (len(began), 4)) * [1e-3, 1e-3, 0.03, 0.03]
    weight = np.full((chosen.size, 2), 1 / NOISE)
    problem = Problem(segments(list(t[chosen])), read[chosen.ravel()], weight, RodsWithEffects(constants))
    off = ratios(base) * [1.01, 0.99, 1.01, 1.2, 0.8]
    at = Estimate.of(np.append(off, [base[1], np.nan]), coulomb(0.7 * first, 0.7 * second), initial)
    names = "coulomb_joint1", "coulomb_joint2"
    free = [*ratio_parameters(at), *(p for name in names for p in effect_parameters(EFFECTS[name]))]
    fitted = fit(problem, at, free, iterations=30)
    assert fitted.converged
    assert fitted.chi2 / (2 * chosen.size - len(free) - 4 * len(chosen)) == pytest.approx(1.0, abs=0.15)
    torques = fitted.estimate.params[[param_index(name, "torque_Nm") for name in names]]
    assert torques == pytest.approx([first, second], rel=0.01)

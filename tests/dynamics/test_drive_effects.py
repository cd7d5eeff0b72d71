"""Effects of drives, compared with a Lagrangian in matrices that SciPy integrates between logged instants."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters, whole_parameters
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.effects.effect import Recorded
from dpr_lab.fitting.estimate import SCALE, Estimate, unknown_ratios, with_scale
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import trajectory
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.hypothesis.scan import ShapeScan
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.rig import load_rig
from dpr_lab.setup import Setup, Torques

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
BASE = base_parameters(RIG.nominal, RIG.L1, RIG.g)
WHOLE = whole_parameters(RIG.nominal, RIG.L1, RIG.g)
LOGGED = np.arange(0.0, 1.6, 0.02)
T = np.arange(0.031, 1.5, 0.01)  # the lanes begin at the release
TAU = np.random.default_rng(3).normal(0, 0.1, (len(LOGGED), 2)) + 0.1 * np.sin(7 * LOGGED)[:, None]
START = np.array([3.0, 3.3, 0.0, 0.0])
DRIVEN = Setup(torques=Torques(LOGGED, TAU))


def lagrangian(t, given, laws, late=0.0):
    """(n, 2) angles at t of rods under torques that jump at `late` after each logged instant.

    laws: (joint, torque given there, its angle) -> torque that the joint feels.
    """
    a, b, d, e1, c1, c2 = BASE

    def slope(_, x, tau):
        theta, omega = x[:2], x[2:]
        q = np.array([theta[0] - np.pi, theta[1] - theta[0]])
        felt = np.array([laws(j, tau[j], q[j]) for j in (0, 1)]) - [c1 * omega[0], c2 * (omega[1] - omega[0])]
        k = d * np.cos(theta[0] - theta[1])
        whirl = d * np.sin(theta[0] - theta[1]) * np.array([-(omega[1] ** 2), omega[0] ** 2])
        weight = np.array([e1, d * RIG.g / RIG.L1]) * np.sin(theta)
        return [*omega, *np.linalg.solve([[a, k], [k, b]], whirl + weight + [[1, -1], [0, 1]] @ felt)]

    jumps = LOGGED + late
    borders = np.concatenate([[0.0], jumps[(jumps > 0.0) & (jumps < t[-1])], [t[-1]]])
    x, result, at = START, [], []
    for begin, end in pairwise(borders):
        tau = given[max(0, np.searchsorted(jumps, 0.5 * (begin + end)) - 1)]
        here = t[(t > begin) & (t <= end)]
        path = solve_ivp(slope, (begin, end), x, "DOP853", t_eval=np.union1d(here, end),
                         args=(tau,), rtol=1e-9, atol=1e-10)  # fmt: skip
        x = path.y[:, -1]
        result += [*path.y[:2, : len(here)].T]
        at += [*here]
    assert np.allclose(at, t)
    return np.array(result)


LAWS = {
    "torque_scale_joint1": ({"excess": 0.2}, lambda j, tau, q: tau * (1.2 if j == 0 else 1.0)),
    "torque_scale_joint2": ({"excess": -0.3}, lambda j, tau, q: tau * (0.7 if j == 1 else 1.0)),
    "torque_offset_joint1": ({"offset_Nm": 0.05}, lambda j, tau, q: tau + 0.05 * (j == 0)),
    "torque_offset_joint2": ({"offset_Nm": -0.04}, lambda j, tau, q: tau - 0.04 * (j == 1)),
    "torque_ripple_joint1": (
        {"cos_share": 0.2, "sin_share": -0.1, "order": 5.0},
        lambda j, tau, q: tau * (1 + (j == 0) * (0.2 * np.cos(5 * q) - 0.1 * np.sin(5 * q))),
    ),
    "torque_ripple_joint2": (
        {"cos_share": 0.0, "sin_share": 0.3, "order": 7.0},
        lambda j, tau, q: tau * (1 + (j == 1) * 0.3 * np.sin(7 * q)),
    ),
    "input_delay": ({"delay_s": 7.3e-3}, lambda j, tau, q: tau),
}


def read(effects, setup=DRIVEN, step=2.5e-4):
    laid_out = segments([T], setups=[setup], step=step)
    return predict(WHOLE, effect_params(effects), CONSTANTS, laid_out, START[None])


def test_every_effect_of_a_drive_has_a_second_implementation():
    assert set(LAWS) == {name for name, effect in EFFECTS.items() if effect.driven and not effect.of_arm}


@pytest.mark.parametrize("name", LAWS)
def test_it_satisfies_lagrange_s_equations(name):
    values, laws = LAWS[name]
    theta = lagrangian(T, TAU, laws, values.get("delay_s", 0.0))
    truth = np.column_stack([theta[:, 0], theta[:, 1] - theta[:, 0]])
    assert np.abs(truth - read({})).max() > 1e-2
    assert np.abs(truth - read({name: values})).max() < 1e-5


def test_nothing_of_a_drive_acts_in_a_free_swing():
    everything = {name: values for name, (values, _) in LAWS.items()}
    assert np.array_equal(read(everything, Setup()), read({}, Setup()))


@pytest.fixture(scope="module")
def problem():
    """Drive with four faults on joint 2, which also has Coulomb friction and a rotor; noise of 0.3 mrad."""
    rng = np.random.default_rng(8)
    truth = {
        "torque_scale_joint2": {"excess": 0.1},
        "torque_ripple_joint2": {"sin_share": 0.15, "order": 9.0},
        "input_delay": {"delay_s": 6e-3},
        "coulomb_joint2": {"torque_Nm": 0.02},
        "rotor_inertia_joint2": {"inertia_kgm2": 1e-3},
    }
    cut = np.array_split(np.arange(len(T)), 5)
    angles = read(truth, step=1e-3)
    laid_out = segments([T[part] for part in cut], [0] * len(cut), [DRIVEN])
    speeds = np.gradient(np.column_stack([angles[:, 0], angles.sum(axis=1)]), T, axis=0)
    began = [max(0, part[0] - 2) for part in cut]
    initial = np.column_stack([angles[began, 0], angles[began].sum(axis=1), speeds[began]])
    initial[0] = START
    seen = angles + 3e-4 * rng.standard_normal(angles.shape)
    return truth, Problem(laid_out, seen, np.full(seen.shape, 1 / 3e-4), RodsWithEffects(CONSTANTS)), initial


def test_a_drive_is_distinguished_from_friction_and_inertia(problem):
    truth, problem, initial = problem
    params = effect_params({"torque_ripple_joint2": {"order": 9.0}})
    at = Estimate.of(with_scale(unknown_ratios(WHOLE), 0.9 * WHOLE[1]), params, initial)
    free = free_parameters(at, list(truth), problem)
    fitted = fit(problem, at, free, iterations=40)
    A, _ = fitted.linear.flat
    std = dict(zip([(p.effect, p.name) for p in free], np.linalg.inv(A.T @ A).diagonal() ** 0.5, strict=True))
    assert fitted.chi2 / (problem.evidence - len(free)) == pytest.approx(1.0, abs=0.25)
    assert fitted.estimate.ratios[SCALE] == pytest.approx(WHOLE[1], abs=4 * std["", "b"])
    for name, values in truth.items():
        for parameter in EFFECTS[name].amplitudes:
            sigma, value = std[name, parameter.name], values.get(parameter.name, 0.0)
            assert fitted.estimate.params[param_index(name, parameter.name)] == pytest.approx(value, abs=4 * sigma)
            assert value == 0.0 or abs(value) > 5 * sigma


def test_the_order_of_a_ripple_is_scanned_along_the_swing(problem):
    truth, problem, initial = problem
    known = effect_params({name: values for name, values in truth.items() if name != "torque_ripple_joint2"})
    fitted = fit(problem, Estimate.of(unknown_ratios(WHOLE), known, initial), (), iterations=5)
    ripple, nothing = EFFECTS["torque_ripple_joint2"], Recorded((None,))
    kept = ShapeScan(problem, fitted, trajectory(problem, fitted.estimate), nothing).shapes(ripple)
    assert ((param_index("torque_ripple_joint2", "order"), 9.0),) in kept
    names = ["torque_scale_joint1", "torque_ripple_joint2", "coulomb_joint2", "rotor_inertia_joint2"]
    assert score_test(problem, fitted, [EFFECTS[name] for name in names], nothing).ranking[0].effect is ripple

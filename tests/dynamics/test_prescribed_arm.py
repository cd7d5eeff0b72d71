"""Arm with prescribed motion, compared with Lagrange's equations of point masses by SymPy."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.prediction import predict, segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import effect_params
from dpr_lab.estimation.arm_motion import arm_motion
from dpr_lab.fitting.estimate import Estimate, ratio_parameters, unknown_ratios
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import trajectory
from dpr_lab.fitting.rods import RodsAlone
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import Mounting
from dpr_lab.setup import ArmMotion, Setup

RIG = load_rig("paper")
L0 = 0.3
CONSTANTS = rig_constants(RIG)._replace(L0=L0)
Z = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
WHOLE = whole_parameters(Z, RIG.L1, RIG.g)
T = np.arange(0.03, 1.6, 5e-3)  # the lanes begin at the release
START = np.array([2.6, 3.3, 0.0, 0.0])


def moved(t, cos):
    """Oscillation of theta0 that starts at rest, rad."""
    return 0.9 * (1 - cos(4 * t)) + 0.2 * (1 - cos(9 * t))


@cache
def equations():
    """Function (t, angles, speeds) that returns mass matrix and forces; each rod is two point masses, the elbow one."""
    t, names = sp.Symbol("t"), sp.symbols("x1 x2 v1 v2 a1 a2")
    q1, q2 = sp.Function("q1")(t), sp.Function("q2")(t)
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = (sp.Float(value) for value in Z)
    inner, outer = (sp.Matrix([sp.sin(q), sp.cos(q)]) for q in (q1, q2))
    elbow, phi = sp.Float(RIG.L1) * inner, moved(t, sp.cos)
    masses = [(mb, elbow)]
    masses += [(m1 / 2, (l1 + side * sp.sqrt(J1 / m1)) * inner) for side in (1, -1)]
    masses += [(m2 / 2, elbow + (l2 + side * sp.sqrt(J2 / m2)) * outer) for side in (1, -1)]
    radial, tangent = sp.Matrix([sp.cos(phi), sp.sin(phi)]), sp.Matrix([-sp.sin(phi), sp.cos(phi)])
    L = 0
    for mass, (across, up) in masses:
        velocity = (L0 * radial + across * tangent).diff(t)
        L += mass * (velocity.dot(velocity) + up.diff(t) ** 2) / 2 - mass * RIG.g * up
    u1, u2 = q1.diff(t), q2.diff(t)
    ranks = dict(zip([u1.diff(t), u2.diff(t), u1, u2, q1, q2], [names[i] for i in (4, 5, 2, 3, 0, 1)], strict=True))
    left = ((q1, u1, -c1 * u1 + c2 * (u2 - u1)), (q2, u2, -c2 * (u2 - u1)))
    rest = sp.Matrix([(L.diff(u).diff(t) - L.diff(q) - force).subs(ranks) for q, u, force in left])
    return sp.lambdify((t, *names[:4]), (rest.jacobian(names[4:]), -rest.subs({names[4]: 0, names[5]: 0})), cse=True)


@cache
def swung() -> np.ndarray:
    """Readings (n, 2) of the encoders of joints 1 and 2."""

    def rates(t, x):
        M, f = equations()(t, *x)
        return [*x[2:], *np.linalg.solve(M, f)[:, 0]]

    y = solve_ivp(rates, (0.0, T[-1]), START, "DOP853", t_eval=T, rtol=1e-9, atol=1e-10).y
    return np.column_stack([y[0], y[1] - y[0]])


def read(setup: Setup) -> np.ndarray:
    laid_out = segments([T], setups=[setup], step=1e-3)
    return predict(WHOLE, effect_params({}), CONSTANTS, laid_out, START[None])


@pytest.mark.slow
def test_the_rods_on_a_prescribed_arm_satisfy_lagrange_s_equations():
    t = np.arange(0.0, 1.7, 1e-3)
    known = ArmMotion(t, moved(t, np.cos), 3.6 * np.sin(4 * t) + 1.8 * np.sin(9 * t))
    assert np.abs(swung() - read(Setup())).max() > 0.3
    assert read(Setup(arm=known)) == pytest.approx(swung(), abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("model", [RodsAlone, RodsWithEffects], ids=["ratios", "lanes"])
def test_the_ratios_are_found_with_the_arm_s_encoder_alone(model, rng):
    noise, logged = 2e-4, np.arange(0.0, 1.605, 5e-3)
    arm = arm_motion(logged, moved(logged, np.cos) + noise * rng.standard_normal(len(logged)), "a run")
    seen = swung() + noise * rng.standard_normal((len(T), 2))
    truth = unknown_ratios(WHOLE)
    perturbed = Estimate.of(truth * [1.05, 1, 1.03, 0.97, 1.2, 1, 1], effect_params({}), START[None])
    left = {}
    for known in (arm, None):
        laid_out = segments([T], setups=[Setup(arm=known)])
        problem = Problem(laid_out, seen, np.full(seen.shape, 1 / noise), model(CONSTANTS))
        fitted = fit(problem, perturbed, ratio_parameters(perturbed), iterations=30)
        left[known] = fitted.chi2 / problem.evidence
        if known is not None:
            A, _ = fitted.linear.flat
            assert fitted.estimate.ratios[:5] == pytest.approx(truth[:5], rel=0.02)
            assert (np.abs(fitted.estimate.ratios - truth)[:5] < 7 * np.linalg.inv(A.T @ A).diagonal() ** 0.5).all()
            if model is RodsWithEffects:  # a trajectory starts where its segments do
                along = trajectory(problem, fitted.estimate).motion
                assert np.abs(np.interp(T, along.t, along.theta[:, 0]) - swung()[:, 0]).max() < 0.08
    assert left[arm] < 1.5
    assert left[None] > 1e3


@pytest.mark.parametrize("mounting", ["both", "clamped", "inner", "outer"])
def test_derivatives_agree_with_differences_for_all_mountings_on_a_moving_arm(mounting: Mounting):
    t = np.arange(0.0, 1.7, 5e-3)
    known = ArmMotion(t, moved(t, np.cos), 3.6 * np.sin(4 * t) + 1.8 * np.sin(9 * t))
    laid_out = segments([T[:100]], setups=[Setup(mounting, arm=known)], step=1e-3)
    start = START if mounting in ("both", "clamped") else np.array([2.6, 2.6, 0.0, 0.0])
    at = Estimate.of(unknown_ratios(WHOLE), effect_params({}), start[None])
    rods, lanes = RodsAlone(CONSTANTS), RodsWithEffects(CONSTANTS)
    free = ratio_parameters(at)
    slopes = rods.slopes(laid_out, at, free)
    for k, parameter in enumerate(free):
        moved_by = 1e-5 * at.ratios[parameter.place]
        either = [at.changed(ratios=at.ratios + sign * moved_by * np.eye(7)[parameter.place]) for sign in (1, -1)]
        apart = np.subtract(*(rods.predict(laid_out, other) for other in either)) / (2 * moved_by)
        assert slopes[:, :, k] == pytest.approx(apart, abs=1e-5 * max(1.0, np.abs(apart).max()))
    led = np.arange(segment_start(T[0]), T[0] - 1e-9, 5e-3)
    whole = segments([np.concatenate([led, T[:100]])], setups=laid_out.setups, step=1e-3)
    seen = 1 if mounting in ("inner", "outer") else 2
    apart = rods.predict(whole, at)[len(led) :] - lanes.predict(laid_out, at)
    assert np.abs(apart[:, :seen]).max() < 1e-4

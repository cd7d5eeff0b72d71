"""Mounted rods and masses in both output models, compared with a Lagrangian that shares no code with the package."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_of_run, base_slopes, whole_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate, ratio_parameters, unknown_ratios, visible_ratios
from dpr_lab.fitting.rods import RodsAlone
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import Setup
from tests.dynamics.scalar_readings import read_segments
from tests.whole_swing import energy

Z = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
RIG = load_rig("paper")
WHOLE = whole_parameters(Z, RIG.L1, RIG.g)
T = np.arange(0.03, 2.0, 5e-3)
ELBOW = 0.7
ONE_ROD = {"inner": 0.0, "outer": 0.0, "clamped": ELBOW}
INNER_LOADED = Setup("inner", AddedMass(rod="inner", mass=0.05, position=0.2))


def acceleration(mounting: str, elbow: float, Z=Z):
    """Function alpha(theta, omega) for one degree of freedom, by Lagrange's equation of point masses."""
    l1, l2, m1, m2, mb, c1, _, J1, J2 = Z
    t = sp.Symbol("t")
    angle = sp.Function("theta")(t)

    def at(lengths):
        """Position of a point at given lengths along rods with given angles; 0 = upright."""
        return sum(r * sp.sin(a) for r, a in lengths), sum(r * sp.cos(a) for r, a in lengths)

    inner, outer = angle, angle + elbow
    if mounting == "outer":
        bodies = [(m2, J2, at([(l2, inner)]), inner)]
    else:
        bodies = [(m1, J1, at([(l1, inner)]), inner), (mb, 0.0, at([(RIG.L1, inner)]), inner)]
    if mounting == "clamped":
        bodies.append((m2, J2, at([(RIG.L1, inner), (l2, outer)]), outer))
    kinetic = sum(m * (x.diff(t) ** 2 + y.diff(t) ** 2) / 2 + J * a.diff(t) ** 2 / 2 for m, J, (x, y), a in bodies)
    potential = sum(m * RIG.g * y for m, _, (_, y), _ in bodies)
    L, speed = kinetic - potential, angle.diff(t)
    q, w, alpha = sp.symbols("q w alpha")
    equation = (L.diff(speed)).diff(t) - L.diff(angle) + c1 * speed
    equation = equation.subs(angle.diff(t, 2), alpha).subs(speed, w).subs(angle, q)
    return sp.lambdify((q, w), -equation.subs(alpha, 0) / equation.diff(alpha))


def readings(model, setup: Setup, initial, whole=WHOLE, t=T, params=None):
    laid_out = segments([t], setups=[setup], step=1e-3)
    params = effect_params({}) if params is None else params
    return model.predict(laid_out, Estimate.of(unknown_ratios(whole), params, np.array([initial])))


@pytest.mark.parametrize("model", [RodsAlone, RodsWithEffects], ids=["ratios", "lanes"])
@pytest.mark.parametrize(("mounting", "elbow"), ONE_ROD.items())
def test_each_mounting_satisfies_lagrange_s_equations(mounting, elbow, model):
    alpha = acceleration(mounting, elbow)
    # The lanes start a segment before its first sample, at the release where that is near.
    start = 0.0 if model is RodsWithEffects else T[0]
    truth = solve_ivp(
        lambda _, x: [x[1], alpha(*x)], (start, T[-1]), [1.1, 2.0], "DOP853", T, rtol=1e-11, atol=1e-11
    ).y[0]
    result = readings(model(rig_constants(RIG)), Setup(mounting, elbow=round(elbow, 1)), [1.1, 1.1 + elbow, 2.0, 9.0])
    assert result[:, 0] == pytest.approx(truth, abs=1e-7)
    assert result[:, 1] == pytest.approx(elbow, abs=1e-9)


def test_a_rod_alone_keeps_its_energy_without_friction():
    frictionless = WHOLE * [1, 1, 1, 1, 0, 0, 1]
    model, setup = RodsAlone(rig_constants(RIG)), Setup("inner")
    t = np.linspace(0.0, 2.0, 4001)
    angle = readings(model, setup, [0.3, 0.3, 0.0, 0.0], frictionless, t)[:, 0]
    speed = np.gradient(angle, t)
    a, b, d, e1, _, _ = base_of_run(frictionless, setup, RIG.L1, RIG.g)
    assert a + b == pytest.approx(Z[7] + Z[2] * Z[0] ** 2 + Z[4] * RIG.L1**2)
    level = [energy(q, q, w, w, a, b, d, e1, 0.0) for q, w in zip(angle[5:-5], speed[5:-5], strict=True)]
    assert np.ptp(level) < 2e-5 * max(level)


@pytest.mark.parametrize("setup", [Setup("inner"), Setup("outer"), Setup("clamped", elbow=0.7), INNER_LOADED], ids=str)
def test_derivatives_agree_with_those_of_the_readings(setup: Setup):
    laid_out = segments([T, T + 2.0], setups=[setup], step=2.5e-3)
    model, initial = RodsAlone(rig_constants(RIG)), np.array([[1.1, 1.8, 2.0, 2.0], [2.0, 2.7, -1.0, -1.0]])
    at = Estimate.of(unknown_ratios(WHOLE), effect_params({}), initial)
    free = ratio_parameters(at, range(7))
    slopes = model.slopes(laid_out, at, free)
    for column, parameter in enumerate(free):
        both = []
        for sign in (1, -1):
            ratios = at.ratios.copy()
            ratios[parameter.place] += sign * 1e-6 * ratios[parameter.place]
            both.append(model.predict(laid_out, Estimate.of(ratios, at.params, initial)))
        expected = (both[0] - both[1]) / 2e-6
        assert slopes[:, :, column] * at.ratios[parameter.place] == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_a_swing_of_one_rod_determines_its_own_parameters_only():
    def names(*setups: Setup) -> set[int]:
        return set(visible_ratios(setups))

    a, d, e1, c1, c2, _, p = range(7)
    assert names(Setup()) == {a, d, e1, c1, c2}
    assert names(Setup(), Setup("clamped")) == {a, d, e1, c1, c2}
    assert names(Setup(), Setup("inner")) == {a, d, e1, c1, c2, p}
    assert names(Setup("inner")) == {e1, c1}
    assert names(Setup("outer")) == {d, c1}
    assert names(Setup("clamped", elbow=0.7)) == {e1, d, c1}
    for setup in (Setup("inner"), Setup("outer")):
        assert np.linalg.matrix_rank(base_slopes(setup, RIG.L1, RIG.g)) == 3


@pytest.mark.parametrize("mounting", ["clamped", "inner"])
def test_effects_act_in_the_lanes_as_in_the_simulator(mounting: str):
    coefficients = {
        "coulomb_joint1": {"torque_Nm": 0.01},
        "load_friction_joint1": {"friction_radius_m": 2e-3},
        "air_drag_both": {"coefficient_kg_per_m2": 5e-3},
        "spring_joint2": {"stiffness_Nm_per_rad": 0.05},
        "base_tilt": {"tilt_rad": 0.02},
    }
    params, constants = effect_params(coefficients), rig_constants(RIG)
    elbow = 0.7 if mounting == "clamped" else 0.0  # the halves of a rod alone are in line
    laid_out = segments([T], setups=[Setup(mounting, elbow=elbow)], step=2.5e-3)
    initial = np.array([[1.1, 1.1 + elbow, 2.0, 2.0]])
    result = RodsWithEffects(constants).predict(laid_out, Estimate.of(unknown_ratios(WHOLE), params, initial))
    alone, _ = read_segments(WHOLE, params, constants, laid_out, initial)
    assert result == pytest.approx(alone[:, :2], abs=1e-9)
    assert np.ptp(result[:, 1]) < 1e-9

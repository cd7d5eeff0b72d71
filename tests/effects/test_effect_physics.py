"""Effects compared with independent forms: Lagrange by SymPy, quadrature, DOP853, closed forms."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import quad, solve_ivp

from dpr_lab.dynamics.arm import CLAMPED, ArmParameters, mounted
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.rig_constants import UNKNOWN, rig_constants
from dpr_lab.dynamics.simulate import at_release, simulate
from dpr_lab.dynamics.step import accelerations_at, joint_forces, model_with
from dpr_lab.effects import air_drag, effect_params
from dpr_lab.effects.hysteresis import deflected
from dpr_lab.effects.quantities import Motion
from dpr_lab.kernels import njit
from dpr_lab.rig import load_rig
from tests.whole_swing import simulate_arm

Z = np.array([0.21, 0.19, 0.11, 0.09, 0.2, 0.0, 0.0, 0.0014, 0.0012])
L0, L1, L2, G = 0.3, 0.4, 0.37, 9.81
FRAME = (L0, L1, G)
BASE_NAMED, ARM = mounted(Z, FRAME, ArmParameters())
CONSTANTS = UNKNOWN._replace(L0=L0, L1=L1, L2=L2, g=G, m1=0.11, m2=0.09, mb=0.2)
BASE = base_parameters(Z, L1, G)


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(4)
    return np.hstack([rng.uniform(-np.pi, np.pi, (30, 2)), rng.normal(0, 8, (30, 2))])


def accelerations(state, values, t=0.0):
    theta1, theta2, omega1, omega2 = state
    model = model_with(BASE_NAMED, CONSTANTS, ARM, effect_params(values))
    x = at_release([0.0, theta1, theta2, 0.0, omega1, omega2])
    return accelerations_at(t, x, 0.0, 0.0, model, CLAMPED, 0.0)[1:]


@pytest.fixture(scope="module")
def lagrange():
    """Function (state, y1, y2, tilt, rotor1, rotor2, shake, longer) of accelerations, from positions."""
    q, w, alpha = sp.symbols("q0:2"), sp.symbols("w0:2"), sp.symbols("a0:2")
    y1, y2, tilt, rotor1, rotor2, shake = extra = sp.symbols("y1 y2 tilt rotor1 rotor2 shake")
    l1, l2, m1, m2, mb, J1, J2 = (sp.Float(Z[i]) for i in (0, 1, 2, 3, 4, 7, 8))

    def along(angle, length, aside):
        up = sp.Matrix([sp.sin(angle), sp.cos(angle)])
        return length * up + aside * sp.Matrix([sp.cos(angle), -sp.sin(angle)])

    joint2 = along(q[0], L1, 0)
    bodies = ((m1, along(q[0], l1, y1)), (mb, joint2), (m2, joint2 + along(q[1], l2, y2)))

    def speed2(position):
        velocity = position.jacobian(q) * sp.Matrix(w)
        return velocity.dot(velocity)

    kinetic = sum(m * speed2(p) for m, p in bodies) / 2
    kinetic += (J1 * w[0] ** 2 + J2 * w[1] ** 2 + rotor1 * w[0] ** 2 + rotor2 * (w[1] - w[0]) ** 2) / 2
    # Gravity turned by the tilt, and the force of inertia on a base that accelerates sideways.
    gravity = G * sp.Matrix([sp.sin(tilt), -sp.cos(tilt)])
    potential = -sum(m * (gravity - sp.Matrix([shake, 0])).dot(p) for m, p in bodies)
    momentum = sp.Matrix([kinetic]).jacobian(w).T
    forces = sp.Matrix([kinetic - potential]).jacobian(q).T - momentum.jacobian(q) * sp.Matrix(w)
    return sp.lambdify([[*q, *w], *extra], momentum.jacobian(w).LUsolve(forces), cse=True), alpha


@pytest.mark.parametrize(
    ("place", "size", "values"),
    [
        (0, 0.004, {"com_offset_link1": {"offset_m": 0.004}}),
        (1, -0.003, {"com_offset_link2": {"offset_m": -0.003}}),
        (2, 0.02, {"base_tilt": {"tilt_rad": 0.02}}),
        (3, 5e-4, {"rotor_inertia_joint1": {"inertia_kgm2": 5e-4}}),
        (4, 5e-4, {"rotor_inertia_joint2": {"inertia_kgm2": 5e-4}}),
        (5, 0.3, {"base_vibration": {"cos_m_per_s2": 0.3}}),
    ],
)
def test_effects_of_geometry_inertia_and_base_satisfy_lagrange_s_equations(lagrange, states, place, size, values):
    extra = np.zeros(6)
    extra[place] = size
    for state in states:
        expected = lagrange[0](state, *extra).ravel()
        np.testing.assert_allclose(
            accelerations(state, values), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
        )


def test_all_of_them_at_once_satisfy_lagrange_s_equations(lagrange, states):
    values = {
        "com_offset_link1": {"offset_m": 0.004},
        "com_offset_link2": {"offset_m": -0.003},
        "rotor_inertia_joint1": {"inertia_kgm2": 5e-4},
        "rotor_inertia_joint2": {"inertia_kgm2": 3e-4},
    }
    for state in states:
        expected = lagrange[0](state, 0.004, -0.003, 0.0, 5e-4, 3e-4, 0.0).ravel()
        np.testing.assert_allclose(accelerations(state, values), expected, rtol=1e-9, atol=1e-8)


def test_a_longer_inner_rod_changes_only_the_outer_rod_s_gravity(states):
    longer = BASE_NAMED._replace(e2=BASE_NAMED.d * G / (L1 + 0.003))
    for theta1, theta2, omega1, omega2 in states:
        x = at_release([0.0, theta1, theta2, 0.0, omega1, omega2])
        model = model_with(longer, CONSTANTS, ARM, effect_params({}))
        expected = accelerations_at(0.0, x, 0.0, 0.0, model, CLAMPED, 0.0)[1:]
        result = accelerations([theta1, theta2, omega1, omega2], {"wrong_length_L1": {"added_m": 0.003}})
        np.testing.assert_allclose(result, expected, rtol=1e-10)


@njit
def _moments(start, slope, length):
    return air_drag.moments(start, slope, length)


@pytest.mark.parametrize(("start", "slope"), [(1.0, 3.0), (-1.0, 5.0), (2.0, -7.0), (0.5, 0.0), (-3.0, 1e-9), (0, 0)])
def test_drag_along_a_rod_is_the_integral(start, slope):
    def speed(s):
        return start + slope * s

    turn = [-start / slope] if slope and 0 < -start / slope < L2 else None
    force = quad(lambda s: speed(s) * abs(speed(s)), 0, L2, points=turn)[0]
    moment = quad(lambda s: s * speed(s) * abs(speed(s)), 0, L2, points=turn)[0]
    assert _moments(start, slope, L2) == pytest.approx((force, moment), rel=1e-12, abs=1e-14)


def work(state, values):
    """Torques on theta1, theta2 that an effect adds, computed from the change of the accelerations."""
    theta1, theta2 = state[:2]
    coupling = BASE_NAMED.d * np.cos(theta1 - theta2)
    change = np.subtract(accelerations(state, values), accelerations(state, {}))
    return np.array([[BASE_NAMED.a, coupling], [coupling, BASE_NAMED.b]]) @ change


def test_drag_of_both_rods_is_the_force_on_each_of_their_points(states):
    k = 5e-3
    for state in states:
        theta1, theta2, omega1, omega2 = state
        lever = L1 * np.cos(theta2 - theta1)
        s = (np.arange(4000) + 0.5) / 4000
        inner, outer = s * L1 * omega1, lever * omega1 + s * L2 * omega2
        push1, push2 = -k * inner * abs(inner) * L1 / 4000, -k * outer * abs(outer) * L2 / 4000
        on_outer = np.array([lever * push2.sum(), (s * L2 * push2).sum()])
        on_both = np.add(on_outer, [(s * L1 * push1).sum(), 0.0])
        for name, expected in (("air_drag_outer", on_outer), ("air_drag_both", on_both)):
            result = work(state, {name: {"coefficient_kg_per_m2": k}})
            np.testing.assert_allclose(result, expected, rtol=1e-5, atol=1e-8)


def test_joint_forces_are_mass_times_acceleration_less_weight(states):
    l1, l2, m1, m2, mb = Z[:5]
    for state in states:
        theta1, theta2, omega1, omega2 = state
        alpha = accelerations(state, {})
        waves = np.sin(theta1), np.cos(theta1), np.sin(theta2), np.cos(theta2)
        motion = Motion._make([0.0, 0.0, theta1, theta2, 0.0, omega1, omega2, *waves, *np.zeros(8)])

        def moved(length, theta, omega, turn):
            return length * np.array(
                [np.cos(theta) * turn - np.sin(theta) * omega**2, -np.sin(theta) * turn - np.cos(theta) * omega**2]
            )

        weight = np.array([0.0, G])
        joint2 = moved(L1, theta1, omega1, alpha[0])
        force2 = m2 * (joint2 + moved(l2, theta2, omega2, alpha[1]) + weight)
        force1 = force2 + mb * (joint2 + weight) + m1 * (moved(l1, theta1, omega1, alpha[0]) + weight)
        expected = np.linalg.norm(force1), np.linalg.norm(force2)
        assert joint_forces(motion, (0.0, *alpha), BASE_NAMED, CONSTANTS) == pytest.approx(expected, rel=1e-9)


def test_load_friction_is_the_load_times_its_radius():
    # A rod that hardly slides, hanging straight, carries its weight; the torque is mu r times that.
    state = [np.pi, np.pi, 1e-3, 1e-3]
    torque1, _ = work(state, {"load_friction_joint1": {"friction_radius_m": 1e-3}})
    assert torque1 == pytest.approx(-1e-3 * (0.11 + 0.09 + 0.2) * G, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "values", "law"),
    [
        ("coulomb", {"torque_Nm": 2e-3}, lambda u, q, t: -2e-3 * np.sign(u)),
        (
            "stribeck",
            {"torque_Nm": 1e-3, "extra_at_rest_Nm": 2e-3, "speed_rad_per_s": 0.7},
            lambda u, q, t: -(1e-3 + 2e-3 * np.exp(-((u / 0.7) ** 2))) * np.sign(u),
        ),
        (
            "friction_curve",
            {"forward_Nm": 1e-3, "backward_Nm": 4e-3, "rise2_Nm": 2e-3, "rise4_Nm": 3e-3},
            lambda u, q, t: (
                -np.sign(u)
                * np.interp(abs(u), [0, 0.3, 1, 3, 8], np.array([1e-3, 1e-3, 3e-3, 3e-3, 6e-3]) + 3e-3 * (u < 0.0))
            ),
        ),
        ("friction_drift", {"rate_Nm_per_rad": 1e-4}, lambda u, q, t: -1e-4 * t * u),
        (
            "spring",
            {"stiffness_Nm_per_rad": 1e-2, "cubic_Nm_per_rad3": 1e-3, "constant_Nm": 2e-3},
            lambda u, q, t: 2e-3 - 1e-2 * q - 1e-3 * q**3,
        ),
        (
            "detent",
            {"cos1_Nm": 1e-3, "sin1_Nm": 2e-3, "cos2_Nm": 3e-3, "sin2_Nm": 4e-3, "order": 7.0},
            lambda u, q, t: 1e-3 * np.cos(7 * q) + 2e-3 * np.sin(7 * q) + 3e-3 * np.cos(14 * q) + 4e-3 * np.sin(14 * q),
        ),
    ],
)
def test_a_law_acts_on_its_own_joint_and_back_on_the_inner_rod(states, name, values, law):
    for state in states:
        theta1, theta2, omega1, omega2 = state
        first, second = law(omega1, theta1 - np.pi, 0.0), law(omega2 - omega1, theta2 - theta1, 0.0)
        np.testing.assert_allclose(work(state, {f"{name}_joint1": values}), [first, 0.0], atol=1e-12)
        np.testing.assert_allclose(work(state, {f"{name}_joint2": values}), [-second, second], atol=1e-12)


def test_friction_drift_grows_with_the_time_since_the_release():
    state, values = np.array([1.0, 2.0, 3.0, -4.0]), {"friction_drift_joint1": {"rate_Nm_per_rad": 1e-4}}
    late = np.subtract(accelerations(state, values, t=7.0), accelerations(state, {}))
    coupling = BASE_NAMED.d * np.cos(1.0)
    assert np.array([BASE_NAMED.a, coupling]) @ late == pytest.approx(-1e-4 * 7.0 * 3.0)


def test_a_small_swing_loses_four_times_friction_over_stiffness_per_period():
    # Closed form for one rod under dry friction alone; the outer rod is made too light to matter.
    base, friction = np.array([0.02, 1e-9, 0.0, 0.4, 0.0, 0.0]), 5e-4
    params = effect_params({"coulomb_joint1": {"torque_Nm": friction}})
    period = 2 * np.pi * np.sqrt(base[0] / base[3])
    swing = simulate(base, L1, G, [np.pi + 0.05, np.pi, 0.0, 0.0], period * np.arange(6), 2e-4, params)
    np.testing.assert_allclose(np.diff(swing[:, 0]), -4 * friction / base[3], rtol=1e-3)


def test_presliding_solves_dahl_s_equation():
    length = 0.03
    for presliding, displacement in ((0.0, 0.05), (0.9, -0.01), (-1.0, 0.2)):
        way = np.sign(displacement)
        solved = solve_ivp(
            lambda x, z, way: (way - z) / length, (0, abs(displacement)), [presliding], args=(way,), rtol=1e-10
        )
        assert deflected(presliding, displacement, length) == pytest.approx(solved.y[0, -1], abs=1e-6)
    assert deflected(0.4, 0.0, length) == pytest.approx(0.4, abs=1e-15)


@pytest.mark.slow
def test_presliding_swing_agrees_with_dop853():
    force, length = 2e-3, 0.05
    a, b, d, e1, _, _ = BASE

    def slope(t, x):
        theta1, theta2, omega1, omega2, z1, z2 = x
        c, s = d * np.cos(theta1 - theta2), d * np.sin(theta1 - theta2)
        u = omega2 - omega1
        right = [
            -s * omega2**2 + e1 * np.sin(theta1) - force * z1 + force * z2,
            s * omega1**2 + d * G / L1 * np.sin(theta2) - force * z2,
        ]
        grips = (omega1 - abs(omega1) * z1) / length, (u - abs(u) * z2) / length
        return [omega1, omega2, *np.linalg.solve([[a, c], [c, b]], right), *grips]

    t = np.linspace(0, 2, 41)
    start = [np.pi + 0.4, np.pi - 0.3, 0.0, 0.0]
    expected = solve_ivp(slope, (0, 2), [*start, 0.0, 0.0], "DOP853", t, rtol=1e-10, atol=1e-11, max_step=2e-3).y[:4].T
    values = {"torque_Nm": force, "length_rad": length}
    params = effect_params({"hysteresis_joint1": values, "hysteresis_joint2": values})
    np.testing.assert_allclose(simulate(BASE, L1, G, start, t, 2e-4, params), expected, atol=3e-6)
    coarse = simulate(BASE, L1, G, start, t, 2.5e-3, params)
    np.testing.assert_allclose(coarse[:, :2], expected[:, :2], atol=2e-4)


def test_compliant_arm_is_an_arm_on_a_spring():
    arm = ArmParameters(J0=0.05, c0=0.02, k0=400.0, mode="free")
    inertia = 0.05 + (0.11 + 0.09 + 0.2) * L0**2
    speed = np.sqrt(400.0 / inertia)
    effect = {
        "coupling_per_kg": L0**2 / inertia,
        "frequency_hz": speed / (2 * np.pi),
        "damping_ratio": 0.02 / (2 * inertia * speed),
    }
    t, start = np.linspace(0, 1, 101), [0.0, 0.1, 3.0, 0.0, 0.0, 0.0]
    free = simulate_arm(Z, FRAME, arm, start, t, 2e-4)
    compliant = simulate_arm(Z, FRAME, ArmParameters(), start, t, 2e-4, effect_params({"arm_compliance": effect}))
    np.testing.assert_allclose(compliant, free, atol=1e-11)
    assert np.abs(free[:, 0]).max() > 1e-3


def test_an_arm_is_not_mounted_twice():
    params = effect_params({"arm_compliance": {"coupling_per_kg": 0.1}})
    with pytest.raises(ValueError, match="arm_compliance"):
        simulate_arm(Z, FRAME, ArmParameters(J0=0.05, k0=400.0, mode="free"), np.zeros(6), [0.0, 1.0], effects=params)


def test_constants_that_were_not_measured_are_nan():
    params = effect_params({"air_drag_outer": {"coefficient_kg_per_m2": 5e-3}})
    assert np.isnan(simulate(BASE, L1, G, [0.1, 3.0, 0.0, 0.0], [0.0, 0.1], effects=params)[1]).all()


def test_known_are_the_rig_s_own_values():
    rig = load_rig("paper")
    measured = rig.parameters["m2"].model_copy(update={"measured": 0.123, "std": 0.001})
    own = rig_constants(rig.model_copy(update={"parameters": {**rig.parameters, "m2": measured}}))
    assert own.m2 == 0.123
    assert own.L2 == 0.4
    assert own.relative2 == 1.0

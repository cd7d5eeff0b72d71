"""Contract of all effects at a free or driven arm, and their batch simulation."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.arm import FREE, ArmParameters, mass_matrix, with_gravity
from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.moving_arm.swing import arm_segments, swing_segments
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import at_release, integrate, motors_of, rig_model
from dpr_lab.dynamics.step import motion_of
from dpr_lab.effects import EFFECTS, OF_ARM, effect_params, param_index
from dpr_lab.effects.limits import amplitude_limits, oversized
from dpr_lab.effects.mounted import effects_of_run
from dpr_lab.effects.quantities import ArmModel, BaseParameters
from dpr_lab.rig import load_rig
from dpr_lab.setup import Setup, Torques
from tests.arm_engine import drawn_plant, rig_of, swing
from tests.three_hinges import three_hinges
from tests.whole_swing import simulate_arm

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
BASE = whole_parameters(RIG.nominal, CONSTANTS.L1, CONSTANTS.g)
INERTIA, VISCOUS = 0.15, 0.02
T = 0.02 + 5e-3 * np.arange(160)
LOGGED = 2e-3 * np.arange(600)
PUSH = 2.0 * np.sin(6.0 * LOGGED) + 1.0 * np.sign(np.sin(17.0 * LOGGED))
START = np.array([[2.0, 1.0, 0.3, -0.5, 0.1, 0.4]])
SHAPES = {"hard_stop_joint0": {"range_rad": 0.2}, "saturation_joint0": {"limit_Nm": 1.0}}


def driven(torque=PUSH):
    torques = Torques(LOGGED, np.zeros((len(LOGGED), 2)), on_arm=torque)
    return segments([T], setups=[Setup(torques=torques, arm_moves=True)], step=1e-3)


def read(effects, laid_out=None, start=START):
    arm = {"free_arm": {"inertia_kgm2": INERTIA, "viscous_Nms": VISCOUS}}
    return predict(BASE, effect_params(arm | effects), CONSTANTS, laid_out or driven(), start, arm=True)


def typical(effect, factor=1.0):
    return {effect.name: {p.name: 10 * factor * p.typical for p in effect.amplitudes} | SHAPES.get(effect.name, {})}


def held_torque():
    """Instants and mean torques of the steps of a driven record."""
    t = 1e-3 * np.arange(round(1e3 * T[-1]) + 1)
    return t, np.append(np.diff(np.interp(t, *driven().setups[0].torques.arm_knots)) / np.diff(t), 0.0)


each_effect = pytest.mark.parametrize("effect", OF_ARM.values(), ids=OF_ARM)


@pytest.mark.slow
def test_lanes_with_a_moving_arm_agree_with_the_equation_of_the_whole_rig():
    p = [*BASE[:6], INERTIA, VISCOUS, 0.0, 0.0, 1.0, CONSTANTS.L0]
    before, mean = held_torque()
    whole = swing_segments(
        p,
        (CONSTANTS.L1, CONSTANTS.g),
        arm_segments([before], [FREE], [mean], 1e-3),
        START[:, [4, 0, 1, 5, 2, 3]],
    )[20::5]
    result = read({})
    np.testing.assert_allclose(result[:, 0], whole[:, 1], atol=1e-8)
    np.testing.assert_allclose(result[:, 2], whole[:, 0], atol=1e-8)


@each_effect
def test_acts_and_stays_finite(effect):
    change = read(typical(effect)) - read({})
    assert np.isfinite(change).all()
    assert 1e-6 < np.abs(change).max() < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, e in OF_ARM.items() if e.stage in ("torque0", "drive0", "whole0")])
def test_the_lanes_and_the_scalar_steps_agree(name):
    carried = sum(RIG.nominal[2:5]) * CONSTANTS.L0**2
    arm, effects = ArmParameters(INERTIA - carried, VISCOUS, mode="free"), typical(EFFECTS[name])
    t, torque = held_torque()
    frame, start = (CONSTANTS.L0, CONSTANTS.L1, CONSTANTS.g), START[0, [4, 0, 1, 5, 2, 3]]
    alone = simulate_arm(RIG.nominal, frame, arm, start, t, 1e-3, effect_params(effects), torque, CONSTANTS)[20::5]
    np.testing.assert_allclose(read(effects)[:, [2, 0]], alone[:, :2], atol=1e-7)


def test_a_tilted_axis_agrees_with_tilted_gravity_in_mujoco():
    Z, frame, arm = RIG.nominal, (0.3, CONSTANTS.L1, CONSTANTS.g), ArmParameters(0.05, 0.02, mode="free")
    t, torque = 0.005 * np.arange(200), 0.3 * np.sin(0.02 * np.arange(200))
    start, tilt = np.array([0.7, 2.0, 1.5, 0.4, 0.3, -0.2]), {"along_rad": 0.004, "across_rad": -0.007}
    moment = float(sum(Z[2:5])) * frame[0] * frame[2]
    tilt |= {"along_Nm": moment * tilt["along_rad"], "across_Nm": moment * tilt["across_rad"]}
    push = (frame[2] * tilt["along_rad"], frame[2] * tilt["across_rad"])
    expected = three_hinges(mujoco, Z, arm, start, t, torque, frame, push)
    effects = effect_params({"axis_tilt_joint0": tilt})
    result = simulate_arm(Z, frame, arm, start, t, 1e-3, effects, torque)[:, :3]
    upright = simulate_arm(Z, frame, arm, start, t, 1e-3, None, torque)[:, :3]
    assert np.abs(result - upright).max() > 0.01
    np.testing.assert_allclose(result, expected, atol=2e-3 * np.abs(result - upright).max())


@each_effect
def test_an_amplitude_of_zero_has_exactly_no_effect_for_any_shape(effect):
    shapes = {effect.name: {p.name: 3.0 * p.default for p in effect.shapes}}
    np.testing.assert_array_equal(read(shapes), read({}))


@each_effect
def test_a_clamped_arm_has_no_arm_effects_and_a_free_arm_no_drive_effects(effect):
    params = effect_params(typical(effect))
    on = [param_index(effect.name, parameter.name) for parameter in effect.amplitudes]
    assert params[on].all()
    assert not effects_of_run(params, Setup())[on].any()
    free = segments([T], setups=[Setup(arm_moves=True)], step=1e-3)
    if effect.driven:
        np.testing.assert_array_equal(read(typical(effect), free), read({}, free))


def dry_rates(friction):
    """Independent model of an arm: SymPy's equation of one rod on the arm, with smoothed Coulomb friction."""
    import sympy as sp

    t0, t1, w0, w1 = sp.symbols("t0 t1 w0 w1")
    a, A, r, e1, c0, c1 = sp.symbols("a A r e1 c0 c1")
    kinetic = A * w0**2 / 2 + a * (w1**2 + sp.sin(t1) ** 2 * w0**2) / 2 + r * e1 * sp.cos(t1) * w0 * w1
    potential = e1 * sp.cos(t1)
    q, v = sp.Matrix([t0, t1]), sp.Matrix([w0, w1])
    momenta = sp.Matrix([kinetic.diff(w) for w in v])
    M = momenta.jacobian(v)
    rest = sp.Matrix([(kinetic - potential).diff(x) for x in q]) - momenta.jacobian(q) * v
    rest -= sp.Matrix([c0 * w0, c1 * w1])
    own = base_of_one_rod()
    values = {a: own[0], e1: own[1], c1: own[2], A: INERTIA, c0: VISCOUS, r: CONSTANTS.L0 / CONSTANTS.g}
    solved = sp.lambdify((t0, t1, w0, w1), [M.subs(values), rest.subs(values)])

    def rates(t, x):
        mass, force = solved(*x)
        i = min(int(t / 2e-3 + 1e-9), len(PUSH) - 1)
        force = np.add(np.ravel(force), [PUSH[i] - friction * np.tanh(x[2] / 1e-4), 0.0]).astype(float)
        return [*x[2:], *np.linalg.solve(np.array(mass, dtype=float), force)]

    return rates


def base_of_one_rod():
    a, _, _, e1, c1, _, p = BASE
    return a - p, e1 - p * CONSTANTS.g / CONSTANTS.L1, c1


@pytest.mark.slow
def test_stick_and_slip_of_the_arm_agree_with_an_independent_engine():
    friction = 2.4
    torques = Torques(LOGGED, np.zeros((len(LOGGED), 2)), on_arm=PUSH)
    setup = Setup("inner", torques=torques, arm_moves=True)
    start = np.array([[2.0, 2.0, 0.3, 0.3, 0.1, 0.4]])
    result = read({"coulomb_joint0": {"torque_Nm": friction}}, segments([T], setups=[setup], step=1e-3), start)
    rates, x, angles, now = dry_rates(friction), [0.1, 2.0, 0.4, 0.3], [], 0.0
    for until in T:
        steps = np.arange(now, until - 1e-9, 2e-3)
        for begin in steps:
            done = solve_ivp(rates, (begin, min(begin + 2e-3, until)), x, method="LSODA", rtol=1e-8, atol=1e-10)
            x = done.y[:, -1]
        angles.append(x[:2])
        now = until
    expected = np.array(angles)
    assert np.mean(np.abs(np.diff(expected[:, 0])) < 2e-6) > 0.02  # it rests at times
    np.testing.assert_allclose(result[:, 2], expected[:, 0], atol=3e-4)
    np.testing.assert_allclose(result[:, 0], expected[:, 1], atol=3e-4)


def test_names_of_the_arm_end_with_its_joint():
    assert all(name.endswith("_joint0") for name in OF_ARM)
    assert all(EFFECTS[name].joints == (-1,) for name in OF_ARM)


def motor_state(effects, t, torque, viscous=VISCOUS):
    """(n, 3) angle of the motor, its speed and the owed impulse, and (n, 6) states, by the scalar steps."""
    arm = ArmParameters(INERTIA - sum(RIG.nominal[2:5]) * CONSTANTS.L0**2, viscous, mode="free")
    frame = CONSTANTS.L0, CONSTANTS.L1, CONSTANTS.g
    model, mode = rig_model(RIG.nominal, frame, arm, effect_params(effects), CONSTANTS)
    states = integrate(model, mode, at_release(START[0, [4, 0, 1, 5, 2, 3]]), t, 1e-3, torque)
    return motors_of(states), states[:, :6]


@pytest.mark.parametrize(
    "more", [{}, {"torque_scale_joint0": {"excess": 0.2}}, {"coulomb_joint0": {"torque_Nm": 0.05}}]
)
@pytest.mark.parametrize("share", [0.003, 0.1])
def test_the_motor_behind_backlash_agrees_in_lanes_and_scalar_steps(share, more):
    effects = {"backlash_joint0": {"play_rad": 0.04, "motor_share": share}} | more
    t, torque = held_torque()
    motor, states = motor_state(effects, t, torque)
    result = read(effects)
    np.testing.assert_allclose(result[:, 2], motor[20::5, 0], atol=1e-5)
    np.testing.assert_allclose(result[:, 0], states[20::5, 1], atol=1e-5)
    assert np.abs(motor[:, 0] - states[:, 0]).max() == pytest.approx(0.02, rel=1e-6)


def test_a_motor_behind_backlash_conserves_momentum_and_loses_energy_at_impacts():
    share, t = 0.2, 1e-3 * np.arange(1500)
    motor, states = motor_state({"backlash_joint0": {"play_rad": 0.1, "motor_share": share}}, t, 0.0, viscous=0.0)
    base = with_gravity(BASE[:6], CONSTANTS.L1, CONSTANTS.g)
    arm = ArmModel((1.0 - share) * INERTIA, CONSTANTS.L0 / CONSTANTS.g, 0.0, 0.0)
    momentum, energy = [], []
    for (_, speed, owed), x in zip(motor, states, strict=True):
        motion = motion_of(0.0, x[:3], x[3:], (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
        M00, M01, M02 = mass_matrix(motion, base, arm)
        w0, w1, w2 = x[3:]
        momentum.append(M00 * w0 + M01 * w1 + M02 * w2 + share * INERTIA * speed + owed)
        kinetic = base.a * w1**2 + base.b * w2**2 + 2 * base.d * np.cos(x[1] - x[2]) * w1 * w2
        kinetic += w0 * (M00 * w0 + 2 * M01 * w1 + 2 * M02 * w2) + share * INERTIA * speed**2
        energy.append(0.5 * kinetic + base.e1 * np.cos(x[1]) + base.e2 * np.cos(x[2]))
    loose = np.abs(motor[:, 0] - states[:, 0]) < 0.05 * (1 - 1e-9)
    assert np.sum(np.diff(loose.astype(int)) < 0) > 3  # impacts
    np.testing.assert_allclose(momentum, momentum[0], atol=1e-5 * np.abs(momentum).max() + 1e-6)
    settled = np.array(energy)[np.abs(motor[:, 2]) < 1e-7]  # not in the step between an impact and its reaction
    assert len(settled) > 0.9 * len(energy)
    assert (np.diff(settled) < 1e-5 * abs(energy[0])).all()
    assert settled[-1] < settled[0] - 0.01 * abs(energy[0])


@pytest.mark.slow
@pytest.mark.parametrize("both", [True, False])
@pytest.mark.parametrize("mode", ["free", "driven"])
def test_backlash_of_the_arm_s_gear_agrees_with_a_motor_in_mujoco(both, mode):
    plant = replace(drawn_plant(np.random.default_rng(3), both, "backlash_joint0", 1.0, 0.2), rotor=0.3)
    rig, t = rig_of(plant, mode), 2e-3 * np.arange(1000)
    u = 0.2 * np.sin(7.0 * t + 0.3) + 0.06 * np.sign(np.sin(11.0 * t)) if mode == "driven" else np.zeros(len(t))
    start = np.array([0.0, 4.4, 3.6 if both else 4.4, 0.0 if mode == "driven" else 1.0, 0.0, 0.0])
    expected = swing(plant, start, t, u)[10:, 0]
    constants = rig_constants(rig)
    setup = Setup(rig.rods.mounting, torques=Torques(t, np.zeros((len(t), 2)), on_arm=u), arm_moves=True)
    base = whole_parameters(rig.nominal, constants.L1, constants.g)
    arm = {"free_arm": {"inertia_kgm2": plant.A + plant.rotor * plant.J0, "viscous_Nms": plant.c0}}
    backlash = {"backlash_joint0": {**plant.size, "motor_share": plant.motor_share}}
    laid_out, initial = (
        segments([t[10:]], setups=[setup], step=1.25e-3),
        [[start[1], start[2], 0.0, 0.0, 0.0, start[3]]],
    )
    result = predict(base, effect_params(arm | backlash), constants, laid_out, initial, arm=True)[:, 2]
    assert np.std(result - expected) < 8e-5  # 0.3 mrad is the noise of its encoder


def test_a_saturated_drive_is_within_the_limits_of_a_rig_and_a_huge_friction_exceeds_them():
    a, b, d, e1, c1, c2 = BASE[:6]
    limits = amplitude_limits(BaseParameters(a, b, d, e1, d * CONSTANTS.g / CONSTANTS.L1, c1, c2), CONSTANTS)
    with pytest.raises(ValueError, match="read-only"):  # all problems of a diagnosis share this array
        limits *= 2.0
    saturated = effect_params({"saturation_joint0": {"share": 1.0, "limit_Nm": 0.01}})
    assert oversized(saturated, limits) == ()
    friction = limits[param_index("coulomb_joint0", "torque_Nm")]
    both = effect_params({"saturation_joint0": {"share": 1.0}, "coulomb_joint0": {"torque_Nm": friction}})
    assert oversized(both, limits) == ("coulomb_joint0",)


@pytest.mark.parametrize(("turns", "stops"), [(1.0, ()), (12.0, ("hard_stop_joint0",))])
def test_a_stop_beyond_many_turns_has_no_effect(turns, stops):
    params = effect_params({"hard_stop_joint0": {"stiffness_Nm_per_rad": 0.01, "range_rad": turns * 2 * np.pi}})
    assert oversized(params, None) == stops

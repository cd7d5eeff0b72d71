"""Joints with stiction, compared with SciPy's event location, MuJoCo, closed forms and the energy balance."""

import numpy as np
import pytest

from dpr_lab.dynamics.arm import ReducedRods
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.dry_friction import slides
from dpr_lab.dynamics.prediction import PAD, predict, predict_batch
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.rig import load_rig
from tests.event_driven import Rods, swing
from tests.whole_swing import energy

RIG = load_rig("paper")
CONSTANTS = rig_constants(RIG)
L1, G = CONSTANTS.L1, CONSTANTS.g
BASE = base_parameters(RIG.nominal, L1, G)


def hanging(more1, more2):
    """State at rest with an angle from hanging, rad."""
    return np.array([np.pi + more1, np.pi + more2, 0.0, 0.0])


CASES = {
    "sliding": (2e-3, 1e-3, [0.1, np.pi, 0.0, 0.0]),
    "either joint for a while": (0.2, 0.05, hanging(0.3, 1.9)),
    "both at once": (0.1, 0.03, hanging(0.3, 1.2)),
    "elbow while the shoulder swings": (0.0, 0.03, hanging(0.5, 0.5)),
    "shoulder while the elbow swings": (0.3, 0.0, hanging(0.3, 1.2)),
}
each_case = pytest.mark.parametrize(("first", "second", "start"), CASES.values(), ids=CASES)


def coulomb(first, second):
    return effect_params({"coulomb_joint1": {"torque_Nm": first}, "coulomb_joint2": {"torque_Nm": second}})


def joints(states):
    return np.column_stack([states[:, 2], states[:, 3] - states[:, 2]])


@each_case
def test_agrees_with_event_location(first, second, start):
    t = np.linspace(0, 1.5, 61)
    expected = swing(Rods(BASE, G / L1, (lambda u: first, lambda u: second)), start, t)
    result = simulate(BASE, L1, G, start, t, 2.5e-3, coulomb(first, second))
    np.testing.assert_allclose(result[:, :2], expected[:, :2], atol=3e-6)
    np.testing.assert_allclose(result, simulate(BASE, L1, G, start, t, 2e-4, coulomb(first, second)), atol=3e-5)
    np.testing.assert_allclose(
        simulate(BASE, L1, G, start, t, 2e-4, coulomb(first, second)), expected, atol=2e-9, rtol=0
    )
    assert ((joints(result) == 0) == (np.abs(joints(expected)) < 1e-10)).mean() > 0.98


def test_friction_that_falls_with_speed_agrees_too():
    values = {"torque_Nm": 0.03, "extra_at_rest_Nm": 0.03, "speed_rad_per_s": 0.4}
    law, t = lambda u: 0.03 + 0.03 * np.exp(-((u / 0.4) ** 2)), np.linspace(0, 2.0, 81)
    expected = swing(Rods(BASE, G / L1, (lambda u: 0.0, law)), hanging(0.6, 0.6), t)
    result = simulate(BASE, L1, G, hanging(0.6, 0.6), t, 2e-4, effect_params({"stribeck_joint2": values}))
    np.testing.assert_allclose(result, expected, atol=2e-9)


@each_case
def test_is_of_fourth_order_across_stops_and_starts(first, second, start):
    t, steps = np.array([0.0, 1.5]), np.array([4e-3, 2e-3, 1e-3])
    exact = simulate(BASE, L1, G, start, t, 5e-5, coulomb(first, second))[-1]
    errors = [np.abs(simulate(BASE, L1, G, start, t, h, coulomb(first, second))[-1] - exact).max() for h in steps]
    assert errors[-1] < 1e-7
    assert errors[-1] < 1e-9 or np.polyfit(np.log(steps), np.log(errors), 1)[0] > 3.3


@each_case
def test_readings_of_lanes_and_scalar_steps_agree(first, second, start):
    t = np.linspace(0.1, 1.4, 131)
    states = simulate(BASE, L1, G, start, np.concatenate([[0.1 - PAD], t]), 2e-4, coulomb(first, second))
    read = predict(BASE, coulomb(first, second), CONSTANTS, segments([t]), np.atleast_2d(start))
    np.testing.assert_allclose(read, np.column_stack([states[1:, 0], states[1:, 1] - states[1:, 0]]), atol=3e-6)


def test_the_peaks_of_one_joint_fall_along_a_straight_line():
    # Closed form: each half swing of an oscillator loses 2 F / k; the outer rod is made too light to matter.
    stiffness, friction = 0.4, 5e-4
    base = np.array([0.02, 1e-9, 0.0, stiffness, 0.0, 0.0])
    half = np.pi * np.sqrt(base[0] / stiffness)
    params = effect_params({"coulomb_joint1": {"torque_Nm": friction}})
    first = 9.5 * friction / stiffness
    peaks = simulate(base, L1, G, hanging(first, 0), half * np.arange(9), 1e-3, params)[:, 0] - np.pi
    expected = np.array([9.5, -7.5, 5.5, -3.5, 1.5, 0.5])
    np.testing.assert_allclose(peaks[:6], expected * friction / stiffness, rtol=5e-4)
    assert (peaks[6:] == peaks[6]).all()
    assert peaks[6] == pytest.approx(peaks[5])


def test_a_sticking_joint_does_not_creep_for_minutes():
    params = coulomb(0.15, 0.05)
    t = np.concatenate([[0.0], np.linspace(20, 200, 10)])
    states = simulate(BASE, L1, G, hanging(0.7, -0.9), t, 2.5e-3, params)
    assert (states[1:] == states[1]).all()
    assert (states[1, 2:] == 0).all()
    assert np.abs(states[1, :2] - np.pi).max() > 1e-2
    read = predict(BASE, params, CONSTANTS, segments([np.arange(1, 181.0)]), [states[1]])
    assert np.ptp(read, axis=0).max() < 1e-12


def test_an_elbow_at_rest_does_not_creep_while_the_shoulder_swings():
    t = np.arange(0.0, 61.0)
    states = simulate(BASE * [1, 1, 1, 1, 0, 0], L1, G, hanging(0.4, 0.4), t, 2.5e-3, coulomb(0.0, 0.2))
    assert (joints(states)[:, 1] == 0).all()
    assert np.abs(states[:, 1] - states[:, 0]).max() < 1e-10
    assert np.ptp(states[:, 0]) > 0.5


def test_the_loss_of_energy_is_the_work_of_friction():
    a, b, d, e1, *_ = BASE
    base, t = BASE * [1, 1, 1, 1, 0, 0], np.linspace(0, 3, 30001)
    states = simulate(base, L1, G, hanging(0.5, 1.9), t, 1e-4, coulomb(0.05, 0.03))
    levels = np.array([energy(x[0], x[1], x[2], x[3], a, b, d, e1, d * G / L1) for x in states])
    assert (np.diff(levels) < 1e-13).all()
    turned = np.abs(np.diff(np.column_stack([states[:, 0], states[:, 1] - states[:, 0]]), axis=0)).sum(axis=0)
    assert levels[0] - levels[-1] == pytest.approx(turned @ [0.05, 0.03], rel=1e-5)


def test_agrees_with_mujoco():
    mujoco = pytest.importorskip("mujoco")
    (first, second, start), t = CASES["either joint for a while"], np.linspace(0, 1.5, 31)
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = RIG.nominal
    soft = 'solreffriction="4e-5 1" solimpfriction="0.9999 0.99999 1e-6"'
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><option gravity="0 0 {-G}" timestep="2e-5" integrator="implicitfast" tolerance="1e-14"/><worldbody>
    <body><joint axis="0 1 0" damping="{c1}" frictionloss="{first}" {soft}/>
    <inertial pos="0 0 {l1}" mass="{m1}" diaginertia="{J1} {J1} 1e-6"/>
    <body pos="0 0 {L1}"><inertial pos="0 0 0" mass="{mb}" diaginertia="1e-9 1e-9 1e-9"/></body>
    <body pos="0 0 {L1}"><joint axis="0 1 0" damping="{c2}" frictionloss="{second}" {soft}/>
    <inertial pos="0 0 {l2}" mass="{m2}" diaginertia="{J2} {J2} 1e-6"/></body></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qpos[:] = start[0], start[1] - start[0]
    result = [data.qpos.copy()]
    for now in t[1:]:
        while data.time < now - 1e-9:
            mujoco.mj_step(model, data)
        result.append(data.qpos.copy())
    states = simulate(BASE, L1, G, start, t, 2.5e-3, coulomb(first, second))
    np.testing.assert_allclose(states[:, :2] @ [[1, -1], [0, 1]], result, atol=2e-4)
    assert (joints(states) == 0)[1:].any(axis=0).all()


def test_directions_are_those_of_the_least_energy_of_acceleration():
    rng, n = np.random.default_rng(5), 2000
    a, b = rng.uniform(0.01, 1, (2, n))
    coupling = rng.uniform(-0.95, 0.95, n) * np.sqrt(a * b)
    torque, forward, backward = rng.normal(0, 1, (2, n)), rng.uniform(0, 1.5, (2, n)), rng.uniform(0, 1.5, (2, n))
    inertia, across = np.array([a + b + 2 * coupling, b]), b + coupling
    tau, speeds = np.array([torque[0] + torque[1], torque[1]]), np.zeros((2, n))
    for _ in range(3000):  # coordinate descent on the convex function itself
        for j in (0, 1):
            pull = tau[j] - across * speeds[1 - j]
            speeds[j] = (np.maximum(pull - forward[j], 0) + np.minimum(pull + backward[j], 0)) / inertia[j]
    for i in range(n):
        rods = ReducedRods._make([a[i], b[i], coupling[i], *torque[:, i], 0.0, 0.0, 0.0])
        result = slides(rods, (0.0, 0.0), tuple(forward[:, i]), tuple(backward[:, i]))
        if np.abs(speeds[speeds[:, i] != 0, i]).min(initial=1.0) > 1e-6:
            assert result == tuple(np.sign(speeds[:, i]))


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.dry])
def test_derivatives_are_smooth_across_stops_and_starts(name):
    """Forward differences of readings, as in a fit, are compared with central differences of a finer integration."""
    size = 300.0 if EFFECTS[name].stage == "load" else 20.0
    params = effect_params({name: {p.name: size * p.typical for p in EFFECTS[name].amplitudes}})
    t, start = np.arange(0.1, 1.3, 0.01), hanging(0.4, 0.9)
    fine, coarse = segments([t], step=2.5e-4), segments([t])
    for parameter in EFFECTS[name].amplitudes:
        i = param_index(name, parameter.name)
        moved = np.repeat(params[None], 4, 0)
        moved[:, i] *= 1 + np.array([0.0, 1e-5, 1e-4, -1e-4])
        step = params[i] * np.array([1e-5, 2e-4])
        result = predict_batch([BASE] * 4, moved, CONSTANTS, coarse, [[start]] * 4)
        exact = predict_batch([BASE] * 4, moved, CONSTANTS, fine, [[start]] * 4)
        forward, central = (result[1] - result[0]) / step[0], (exact[2] - exact[3]) / step[1]
        assert np.abs(forward - central).max() <= 2e-3 * np.abs(central).max(), parameter.name

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_from_ratios, base_parameters, ratios
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import sensitivities, swings
from dpr_lab.dynamics.simulate import simulate

Z = np.array([0.21, 0.19, 0.11, 0.09, 0.2, 0.0011, 0.0009, 0.0014, 0.0012])
L1, G = 0.4, 9.81
RATIOS = ratios(base_parameters(Z, L1, G))
START = np.array([0.1, 3.0, 0.5, -2.0])
T = np.concatenate([[0.0], np.sort(np.random.default_rng(2).uniform(0, 0.8, 25))])


def swing_sensitivity(values, L1, g, state, t, max_step=MAX_STEP):
    return sensitivities(values, L1, g, segments([t], step=max_step), np.atleast_2d(np.asarray(state, dtype=float)))


def complex_rk4(values, t, max_step):
    """The same Runge-Kutta step in complex numbers, with the mass matrix solved by NumPy."""
    a, d, e1, c1, c2 = values[:5]

    def slope(x):
        c, s = d * np.cos(x[0] - x[1]), d * np.sin(x[0] - x[1])
        drag = c2 * (x[2] - x[3])
        right = np.array(
            [
                -s * x[3] ** 2 - c1 * x[2] - drag + e1 * np.sin(x[0]),
                s * x[2] ** 2 + drag + d * G / L1 * np.sin(x[1]),
            ]
        )
        return np.concatenate([x[2:], np.linalg.solve(np.array([[a, c], [c, 1.0]]), right)])

    states = [np.asarray(values[5:])]
    for interval in np.diff(t):
        count = int(np.ceil(interval / max_step - 1e-9))
        h, x = interval / count, states[-1]
        for _ in range(count):
            k1 = slope(x)
            k2 = slope(x + h / 2 * k1)
            k3 = slope(x + h / 2 * k2)
            k4 = slope(x + h * k3)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
    return np.array(states)


def test_is_the_derivative_of_the_discrete_map():
    _, result = swing_sensitivity(RATIOS, L1, G, START, T, max_step=4e-3)
    values = np.concatenate([RATIOS, START])
    for j in range(9):
        moved = values.astype(complex)
        moved[j] += 1e-30j
        expected = complex_rk4(moved, T, 4e-3).imag / 1e-30
        np.testing.assert_allclose(result[:, :, j], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_trajectory_is_that_of_simulate():
    states, _ = swing_sensitivity(RATIOS, L1, G, START, T)
    np.testing.assert_allclose(states, simulate(base_from_ratios(RATIOS), L1, G, START, T), atol=1e-11)


def test_start_sensitivity_agrees_with_differences_of_dop853():
    a, d, e1, c1, c2 = RATIOS

    def slope(_, x):
        c, s = d * np.cos(x[0] - x[1]), d * np.sin(x[0] - x[1])
        drag = c2 * (x[2] - x[3])
        right = [
            -s * x[3] ** 2 - c1 * x[2] - drag + e1 * np.sin(x[0]),
            s * x[2] ** 2 + drag + d * G / L1 * np.sin(x[1]),
        ]
        return [x[2], x[3], *np.linalg.solve([[a, c], [c, 1.0]], right)]

    def end(start):
        return solve_ivp(slope, (0, 0.5), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]

    _, result = swing_sensitivity(RATIOS, L1, G, START, [0.0, 0.5])
    for j, move in enumerate(1e-5 * np.eye(4)):
        expected = (end(START + move) - end(START - move)) / 2e-5
        np.testing.assert_allclose(result[-1, :, 5 + j], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_segments_are_independent_of_each_other():
    times = [T, T[3:] + 7.0, T[:4]]
    starts = np.array([START, -START, 2 * START])
    states, slopes = sensitivities(RATIOS, L1, G, segments(times, range(3), step=MAX_STEP), starts)
    offsets = np.cumsum([0, *map(len, times)])
    for s, (t, start) in enumerate(zip(times, starts, strict=True)):
        alone = swing_sensitivity(RATIOS, L1, G, start, t)
        np.testing.assert_array_equal(states[offsets[s] : offsets[s + 1]], alone[0])
        np.testing.assert_array_equal(slopes[offsets[s] : offsets[s + 1]], alone[1])


def test_one_swing_distinguishes_five_ratios():
    _, slopes = swing_sensitivity(RATIOS, L1, G, [0.1, np.pi, 0.0, 0.0], np.linspace(0, 2, 201))
    scaled = slopes[:, :2, :5].reshape(-1, 5) * RATIOS
    assert np.linalg.cond(scaled) < 1e5


def test_ratios_are_checked():
    with pytest.raises(ValueError, match="ratios must have shape"):
        swing_sensitivity(RATIOS[:4], L1, G, START, T)


def test_states_alone_and_angles_alone_are_those_with_all_derivatives():
    cut = segments([T, T[:4]], [0, 1], step=4e-3)
    starts = np.array([START, -START])
    states, slopes = sensitivities(RATIOS, L1, G, cut, starts)
    np.testing.assert_array_equal(swings(RATIOS, L1, G, cut, starts), states)
    np.testing.assert_array_equal(sensitivities(RATIOS, L1, G, cut, starts, outputs=2)[1], slopes[:, :2])


def test_each_segment_may_swing_by_ratios_of_its_own():
    other = RATIOS * [1.1, 0.9, 1.05, 2.0, 0.5]
    cut = segments([T, T], [0, 1])
    states, slopes = sensitivities([RATIOS, other], L1, G, cut, [START, START])
    alone = swing_sensitivity(other, L1, G, START, T, cut.step[1])
    np.testing.assert_array_equal(states[len(T) :], alone[0])
    np.testing.assert_array_equal(slopes[len(T) :], alone[1])

import numba
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters, rows
from dpr_lab.dynamics.rollout import LANES, segment_errors, trajectory_errors
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.simulate import simulate

Z = np.array([0.2, 0.2, 0.1, 0.1, 0.208, 0.001, 0.001, 0.00133, 0.00133])
L1, G = 0.4, 9.81
POSES = np.array([[np.pi, 0.1, 0.0, 0.0], [0.1, 0.1, 0.0, 0.0], [0.1, np.pi, 0.0, 0.0]])
STEP = 0.005
T = STEP * np.arange(401)


def candidates(n, seed=0):
    return base_parameters(Z * np.random.default_rng(seed).uniform(0.8, 1.2, (n, 9)), L1, G)


def swings(base, t=T, step=STEP, poses=POSES):
    return np.array([simulate(base, L1, G, pose, t, step) for pose in poses])


@pytest.fixture(scope="module")
def reference():
    return swings(base_parameters(Z, L1, G))


def test_the_cost_of_the_own_trajectory_is_zero(reference):
    own = rows(base_parameters(Z, L1, G), L1, G)[None]
    # 1e-12 rad at each of 401 samples
    assert trajectory_errors(own, POSES, reference, STEP).max() < 401 * 1e-24


@pytest.mark.parametrize("columns", [2, 4])
def test_costs_are_those_of_the_scalar_simulation(reference, columns):
    base = candidates(37)
    expected = [((swings(one) - reference)[:, :, :columns] ** 2).sum(axis=(1, 2)) for one in base]
    result = trajectory_errors(rows(base, L1, G), POSES, reference[:, :, :columns], STEP)
    np.testing.assert_allclose(result, expected, rtol=1e-9)


def test_same_bits_for_any_number_of_threads_and_any_batch(reference):
    many = rows(candidates(2 * LANES + 7), L1, G)
    before = numba.get_num_threads()
    try:
        results = []
        for threads in sorted({1, min(2, before), before}):
            numba.set_num_threads(threads)
            results.append(trajectory_errors(many, POSES, reference, STEP))
    finally:
        numba.set_num_threads(before)
    for result in results[1:]:
        np.testing.assert_array_equal(result, results[0])
    for size in (1, LANES - 1, LANES, LANES + 1):
        np.testing.assert_array_equal(trajectory_errors(many[:size], POSES, reference, STEP), results[0][:size])


def test_a_failed_candidate_costs_inf_and_leaves_its_neighbours_alone(reference):
    good = rows(candidates(5), L1, G)
    bad = good.copy()
    bad[1] = np.nan
    bad[2, 1] = 40.0  # coupling beyond any inertia
    bad[3, 4] = np.inf
    costs = trajectory_errors(bad, POSES, reference, STEP)
    assert np.isposinf(costs[[1, 3]]).all()
    assert not np.isnan(costs).any()
    np.testing.assert_array_equal(costs[[0, 4]], trajectory_errors(good, POSES, reference, STEP)[[0, 4]])


@pytest.mark.parametrize("speed", [30.0, 60.0, 150.0, 600.0])
def test_beyond_the_guard_the_sines_are_exact(speed):
    # At 600 rad/s a rod turns 3 rad in a step: the series alone would be off by everything.
    start = np.array([[1.0, 2.0, speed, -0.7 * speed]])
    t = STEP * np.arange(3)
    base = base_parameters(Z, L1, G)
    target = swings(base, t, poses=start)[:, :, :2]
    cost = trajectory_errors(rows(base, L1, G)[None], start, target, STEP)
    assert cost[0, 0] < (1e-9 * np.abs(target).max()) ** 2


@pytest.mark.parametrize("gravity", [30.0, 300.0, 3000.0])
def test_from_rest_with_great_accelerations_the_sines_are_exact(gravity):
    # Slow at the start, but accelerations alone turn the rods further than the short series allow.
    start, t = np.array([[1.5, 1.0, 0.0, 0.0]]), STEP * np.arange(2)
    base = base_parameters(Z, L1, G * gravity)
    target = np.array([simulate(base, L1, G * gravity, start[0], t, STEP)])[:, :, :2]
    cost = trajectory_errors(rows(base, L1, G * gravity)[None], start, target, STEP)
    assert cost[0, 0] < (1e-12 * np.abs(target).max()) ** 2


def test_fast_spin_agrees_with_dop853():
    start, t = np.array([0.5, 1.0, 250.0, -180.0]), np.linspace(0, 0.05, 11)
    a, b, d, e1, c1, c2 = base_parameters(Z, L1, G)

    def slope(_, x):
        c, s = d * np.cos(x[0] - x[1]), d * np.sin(x[0] - x[1])
        drag = c2 * (x[2] - x[3])
        right = [
            -s * x[3] ** 2 - c1 * x[2] - drag + e1 * np.sin(x[0]),
            s * x[2] ** 2 + drag + d * G / L1 * np.sin(x[1]),
        ]
        return [x[2], x[3], *np.linalg.solve([[a, c], [c, b]], right)]

    exact = solve_ivp(slope, (0, t[-1]), start, "DOP853", t, rtol=1e-12, atol=1e-12).y.T
    fast = segments([t], step=5e-5)
    coarse = segments([t], step=1e-3)  # 0.25 rad a step: beyond the guard
    row = rows(base_parameters(Z, L1, G), L1, G)[None]
    assert segment_errors(row, fast, [start], exact[:, :2])[0, 0] < len(t) * 1e-14
    assert segment_errors(row, coarse, [start], exact[:, :2])[0, 0] < len(t) * 1e-4


def test_segments_at_uneven_instants_with_correlated_noise():
    rng = np.random.default_rng(3)
    base = base_parameters(Z, L1, G)
    times = [np.sort(rng.uniform(0, 0.5, n)) for n in (9, 30, 1)]
    starts = rng.normal(0, 1, (3, 4))
    pieces = segments(times, range(3), step=2e-3)
    targets = rng.normal(0, 1, (40, 2))
    covariance = np.array([[1e-6, 1e-6], [1e-6, 2e-6]])
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    result = segment_errors(rows(base, L1, G)[None], pieces, starts, targets, whitening)
    for s, (t, start) in enumerate(zip(times, starts, strict=True)):
        errors = simulate(base, L1, G, start, t, 2e-3)[:, :2] - targets[pieces.offsets[s] : pieces.offsets[s + 1]]
        expected = np.einsum("ki,ij,kj->", errors, np.linalg.inv(covariance), errors)
        assert result[0, s] == pytest.approx(expected, rel=1e-9)


def test_shapes_are_checked(reference):
    row = rows(candidates(2), L1, G)
    assert trajectory_errors(row[:0], POSES, reference, STEP).shape == (0, 3)
    with pytest.raises(ValueError, match="rows must have shape"):
        trajectory_errors(row[:, :5], POSES, reference, STEP)
    with pytest.raises(ValueError, match="reference must have shape"):
        trajectory_errors(row, POSES, reference[0], STEP)
    with pytest.raises(ValueError, match="initial states must have shape"):
        trajectory_errors(row, POSES[:2], reference, STEP)
    with pytest.raises(ValueError, match="targets must have shape"):
        segment_errors(row, segments([T]), POSES[:1], np.zeros((3, 2)))
    with pytest.raises(ValueError, match="at least one segment"):
        segments([])

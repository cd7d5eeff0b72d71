import functools
import math

import numpy as np
import pytest
from scipy.linalg import expm

from dpr_lab.acquisition.live_speed import LiveSpeed
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.errors import RunError
from dpr_lab.estimation.chain import CHAIN
from dpr_lab.estimation.likelihood import log_likelihood
from dpr_lab.estimation.live_velocity import LIVE, VelocityFilter
from dpr_lab.estimation.noise import NoiseFloor, noise_floor
from dpr_lab.estimation.velocity import smooth, tuned_snap
from dpr_lab.joint_angles import JointAngles
from dpr_lab.rig import load_rig
from dpr_lab.run import Run

RIG = load_rig("paper")
BASE = base_parameters(RIG.nominal, RIG.rig.L1, RIG.rig.g)
POSES = {"X1": [np.pi, 0.1, 0.0, 0.0], "X2": [0.1, 0.1, 0.0, 0.0], "X3": [0.1, np.pi, 0.0, 0.0]}


@functools.cache
def recording(pose, rate_hz, seconds=4):
    """A run of the rig `paper` with half a count of noise, and the true states from the release on."""
    t = np.arange(-rate_hz, seconds * rate_hz) / rate_hz
    truth = np.tile(POSES[pose], (len(t), 1))
    truth[t >= 0] = simulate(BASE, RIG.rig.L1, RIG.rig.g, POSES[pose], t[t >= 0], 5e-4)
    theta = np.column_stack([0 * t, truth[:, :2]])
    noise = np.random.default_rng(3).normal(0, RIG.encoders.noise_counts, theta.shape)
    counts = np.rint(RIG.positions(theta) + noise).astype(np.int64)
    return Run(pose, t, RIG.theta(counts), counts, pose, "paper", "", rate_hz), truth[t >= 0]


def rms(errors):
    return math.sqrt(np.mean(np.square(errors)))


def best_savitzky_golay(theta, truth, rate_hz):
    """Smallest error over all windows and orders, selected with knowledge of the true values."""
    from scipy.signal import savgol_filter  # slow to import

    return min(
        rms(savgol_filter(theta, window, order, deriv=1, delta=1 / rate_hz, axis=0) - truth)
        for window in range(5, 82, 4)
        for order in (2, 3, 4)
    )


@pytest.mark.parametrize("rate_hz", [200, 1000])
@pytest.mark.parametrize("pose", POSES)
def test_beats_differences_and_the_best_savitzky_golay(pose, rate_hz):
    run, truth = recording(pose, rate_hz)
    smoothed = smooth(run, noise_floor(run, RIG))
    error = rms(smoothed[:, 2:] - truth[:, 2:])
    angles = run.swing.theta[:, 1:]
    assert error < rms(np.gradient(angles, 1 / rate_hz, axis=0) - truth[:, 2:]) / 3
    assert error < best_savitzky_golay(angles, truth[:, 2:], rate_hz)
    assert rms(smoothed[:, :2] - truth[:, :2]) < rms(angles - truth[:, :2]) / 2


def test_dropped_samples_and_gaps_are_bridged():
    run, truth = recording("X3", 1000)
    t = run.t
    kept = np.random.default_rng(8).random(len(t)) > 0.1
    gap = (t > 2.0) & (t < 2.05)
    kept[gap] = False
    broken = Run("gaps", t[kept], run.theta[kept], None, "X3", "paper", "", 1000.0)
    noise = noise_floor(run, RIG)
    errors = smooth(broken, noise)[:, 2:] - truth[kept[t >= 0]][:, 2:]
    usual = rms(smooth(run, noise)[:, 2:] - truth[:, 2:])
    assert rms(errors) < 1.5 * usual
    edge = np.abs(t[kept & (t >= 0)] - 2.025) < 0.04
    assert np.abs(errors[edge]).max() < 10 * usual


@pytest.mark.slow
def test_uneven_instants_agree_with_the_joint_gaussian():
    """The smoother against the posterior of all states at once, by dense linear algebra."""
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5e-3, 3e-3, 15))
    t -= t[0]
    covariance = 1e-8 * np.array([[1.0, 1.0], [1.0, 2.0]])
    snap = np.array([1e8, 3e9])
    theta = np.column_stack([np.zeros(15), 0.3 * np.cos(20 * t), np.sin(15 * t)])
    run = Run("few", t, theta, None, None, "paper", "", 500.0)
    smoothed = smooth(run, NoiseFloor(np.array([1e-4, 1e-4]), JointAngles(relative2=True)), snap)

    angle = np.sqrt(np.diag(covariance))
    memory = np.sqrt(np.prod((angle**2 * np.median(np.diff(t)) / snap) ** (1 / 8)))
    prior = np.concatenate([np.array(LIVE.prior) * (angle[i] / memory ** np.arange(CHAIN)) ** 2 for i in (0, 1)])
    joint, paths = np.diag(prior), [np.eye(8)]
    blocks = [joint]
    for interval in np.diff(t):
        F, Q = van_loan(interval, snap)
        paths.append(F)
        blocks.append(F @ blocks[-1] @ F.T + Q)
    K = np.zeros((15 * 8, 15 * 8))
    for i in range(15):
        between = np.eye(8)
        for j in range(i, 15):
            between = paths[j] @ between if j > i else between
            K[8 * j : 8 * j + 8, 8 * i : 8 * i + 8] = between @ blocks[i]
            K[8 * i : 8 * i + 8, 8 * j : 8 * j + 8] = (between @ blocks[i]).T
    H = np.kron(np.eye(15), np.kron(np.eye(2), np.eye(CHAIN)[0]))
    mean = np.zeros(15 * 8)
    start = np.zeros(8)
    start[[0, CHAIN]] = theta[0, 1:]
    for j in range(15):
        start = paths[j] @ start
        mean[8 * j : 8 * j + 8] = start
    S = H @ K @ H.T + np.kron(np.eye(15), covariance)
    posterior = mean + K @ H.T @ np.linalg.solve(S, theta[:, 1:].ravel() - H @ mean)
    chosen = posterior.reshape(15, 8)[:, [0, CHAIN, 1, CHAIN + 1]]
    np.testing.assert_allclose(smoothed, chosen, rtol=1e-5, atol=1e-7)


def van_loan(interval, snap):
    """Transition and process noise of both chains by a matrix exponential."""
    A = np.kron(np.eye(2), np.eye(CHAIN, k=1))
    noise = np.zeros((8, 8))
    noise[[CHAIN - 1, 2 * CHAIN - 1], [CHAIN - 1, 2 * CHAIN - 1]] = snap
    block = expm(np.block([[-A, noise], [np.zeros((8, 8)), A.T]]) * interval)
    F = block[8:, 8:].T
    return F, F @ block[:8, 8:]


def test_likelihood_is_that_of_a_multivariate_normal():
    t = np.array([0.0, 0.4, 1.3, 1.5, 2.6, 3.0, 4.1, 5.0])
    theta = np.random.default_rng(1).normal(0, 2, len(t))
    prior = np.array([1.0, 30.0, 20.0, 10.0])
    cross = np.zeros((len(t), len(t)))
    for i, early in enumerate(t):
        F, Q = van_loan(early, np.full(2, 0.7))
        spread = (F @ np.kron(np.eye(2), np.diag(prior)) @ F.T + Q)[:CHAIN, :CHAIN]
        for j in range(i, len(t)):
            ahead = van_loan(t[j] - early, np.ones(2))[0][:CHAIN, :CHAIN]
            cross[i, j] = cross[j, i] = (ahead @ spread)[0, 0]
    S, residual = cross + np.eye(len(t)), theta - theta[0]

    def log_density(n):
        return -0.5 * (np.linalg.slogdet(S[:n, :n])[1] + residual[:n] @ np.linalg.solve(S[:n, :n], residual[:n]))

    expected = log_density(len(t)) - log_density(CHAIN)
    assert log_likelihood(t, theta, 0.7, prior) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("rate_hz", "factor"), [(30, 5.0), (80, 1.8), (4000, 200.0)])
def test_slow_and_fast_sampling_give_better_speeds_than_differences(rate_hz, factor):
    run, truth = recording("X3", rate_hz)
    error = rms(smooth(run, noise_floor(run, RIG))[:, 2:] - truth[:, 2:])
    assert error < rms(np.gradient(run.swing.theta[:, 1:], 1 / rate_hz, axis=0) - truth[:, 2:]) / factor


def test_tuned_noise_follows_the_swing():
    run, _ = recording("X1", 1000, 8)
    snap = tuned_snap(run, noise_floor(run, RIG))
    assert snap.shape == (8000, 2)
    assert (snap > 0).all()
    assert snap[:1000, 1].mean() > 3 * snap[-1000:, 1].mean()


@pytest.mark.parametrize("factor", [1.0, 1e6])
def test_tuned_noise_is_that_of_a_simulated_chain(rng, factor):
    """White noise of known strength in the fourth derivative, read with known noise: the memory is right within 1.5."""
    sigma, period, n = 1e-4, 1e-3, 2000
    snap = factor * np.array([1.0, 4.0]) * sigma**2 * period / (10 * period) ** (2 * CHAIN)
    F, Q = van_loan(period, snap)
    root, x, states = np.linalg.cholesky(Q), np.zeros(2 * CHAIN), []
    for _ in range(n):
        states.append(x[[0, CHAIN]])
        x = F @ x + root @ rng.standard_normal(2 * CHAIN)
    theta = np.array(states) + sigma * rng.standard_normal((n, 2))
    run = Run("chain", period * np.arange(n), np.column_stack([np.zeros(n), theta]), None, None, "paper", "", 1000.0)
    result = tuned_snap(run, NoiseFloor(np.full(2, sigma), JointAngles(relative2=False)))
    memory = (np.exp(np.log(result).mean(axis=0)) / snap) ** (1 / (2 * CHAIN))
    np.testing.assert_allclose(np.log(memory), 0.0, atol=math.log(1.5))


def test_live_speed_is_near_the_truth_and_only_looks_back():
    run, truth = recording("X2", 1000)
    noise = noise_floor(run, RIG)
    live = VelocityFilter(noise.covariance, run.rate_hz)
    angles, t = run.swing.theta[:, 1:], run.swing.t
    speeds = np.array([live.update(*sample) for sample in zip(t, angles, strict=True)])
    assert rms(speeds[50:] - truth[50:, 2:]) < 0.1
    again = VelocityFilter(noise.covariance, run.rate_hz)
    head = np.array([again.update(*sample) for sample in zip(t[:200], angles[:200], strict=True)])
    np.testing.assert_array_equal(head, speeds[:200])


def test_the_last_speeds_of_the_live_filter_are_those_of_the_smoother():
    """After a few samples, which depend on the prior of the filter."""
    t = np.arange(6) / 500
    run = Run("few", t, np.column_stack([0 * t, 0.3 * np.cos(20 * t), np.sin(15 * t)]), None, None, "paper", "", 500.0)
    noise, snap = NoiseFloor(np.array([1e-4, 1e-4]), JointAngles(relative2=True)), np.array([1e8, 3e9])
    live = VelocityFilter(noise.covariance, run.rate_hz, snap)
    *_, last = (live.update(time, angles) for time, angles in zip(t, run.theta[:, 1:], strict=True))
    np.testing.assert_allclose(last, smooth(run, noise, snap)[-1, 2:], rtol=1e-6)


@pytest.mark.parametrize("pose", ["X2", "X3"])
def test_a_tenth_or_ten_times_the_process_noise_makes_live_speeds_worse(pose):
    run, truth = recording(pose, LIVE.most_hz)
    covariance, errors = noise_floor(run, RIG).covariance, []
    for factor in (1.0, 0.1, 10.0):
        live = VelocityFilter(covariance, run.rate_hz, factor * LIVE.snap)
        speeds = np.array([live.update(*sample) for sample in zip(run.swing.t, run.swing.theta[:, 1:], strict=True)])
        errors.append(rms(speeds[50:] - truth[50:, 2:]))
    assert 1.1 * errors[0] < min(errors[1:])


def test_live_speeds_have_the_noise_of_both_encoders():
    """The encoder of joint 2 is relative, so the angle of the outer rod contains the noise of both."""
    run, _ = recording("X3", LIVE.most_hz, 1)
    s1, s2 = np.square(2 * np.pi / 16384 * np.hypot(RIG.encoders.noise_counts, 12**-0.5) * np.ones(2))
    live = VelocityFilter([[s1, s1], [s1, s1 + s2]], run.rate_hz)
    *_, last = (live.update(*sample) for sample in zip(run.swing.t, run.swing.theta[:, 1:], strict=True))
    np.testing.assert_allclose(LiveSpeed(RIG, run.rate_hz).after(run.t, run.theta), last, rtol=1e-9)


def test_live_filter_bridges_a_gap_and_refuses_to_go_back():
    run, truth = recording("X1", 1000)
    live = VelocityFilter(noise_floor(run, RIG).covariance, run.rate_hz)
    angles, t = run.swing.theta[:, 1:], run.swing.t
    for k in [*range(1000), *range(1040, 1200)]:
        speed = live.update(t[k], angles[k])
    np.testing.assert_allclose(speed, truth[1199, 2:], atol=0.2)
    with pytest.raises(ValueError, match="samples must come in order"):
        live.update(t[1199], angles[1199])


def test_a_run_without_samples_after_the_release_is_reported():
    run, _ = recording("X1", 200)
    with pytest.raises(RunError, match="0 samples after the release"):
        smooth(run.between(-1.0, 0.0), noise_floor(run, RIG))

import math
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import (
    NOISE,
    arm_noise,
    difference_std,
    noise_floor,
    rest_correlation,
    rounding_std,
    same_rounding,
)
from dpr_lab.rig import load_rig
from dpr_lab.run import FilmNoise, Run

RIG = load_rig("paper")
COUNT = 2 * math.pi / 16384


def recorded(t, theta, noise_counts, seed=0, rig=RIG, keep_counts=True):
    counts = np.rint(rig.positions(theta) + np.random.default_rng(seed).normal(0, noise_counts, theta.shape))
    counts = counts.astype(np.int64)
    return Run("test", t, rig.theta(counts), counts if keep_counts else None, "X1", "paper", "", 1000.0)


def smooth_swing(t):
    return np.stack([0 * t, np.pi + 0.8 * np.cos(6 * t), np.pi + np.sin(9 * t)], axis=1)


def release(t, noise_counts, **options):
    theta = np.where(t[:, None] < 0, smooth_swing(0 * t), smooth_swing(t))
    return recorded(t, theta, noise_counts, **options)


def with_joint2(kind):
    encoders = RIG.encoders.model_copy(update={"joint2": kind})
    return RIG.model_copy(update={"encoders": encoders})


def test_rest_gives_the_noise_of_each_encoder_and_its_covariance():
    noise = noise_floor(release(np.arange(-2000, 1000) / 1000, 1.5), RIG)
    expected = COUNT * math.sqrt(1.5**2 + 1 / 12)
    np.testing.assert_allclose(noise.std_joint, expected, rtol=0.05)
    s1, s2 = noise.std_joint**2
    np.testing.assert_allclose(noise.covariance, [[s1, s1], [s1, s1 + s2]], rtol=1e-12)


@pytest.mark.parametrize("counts", [0.1, 0.3])
@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("table", [False, True])
def test_noise_below_half_a_count_is_that_of_moving_readings(place, counts, table):
    """The rods rest at this place between two counts of a device, or between two steps of a table.

    At the centre of a count, rounding hides this noise. At the edge, the readings change by a whole count.
    """
    t = np.arange(-1000, 3000) / 1000
    angles = np.column_stack([np.sin(7 * t), np.pi + 0.8 * np.sin(6 * t), np.pi + np.sin(9 * t)])
    theta = np.where(t[:, None] < 0, [0.0, np.pi, np.pi], angles) + place * COUNT * np.array([1, 1, 2])
    run = recorded(t, theta, counts, keep_counts=not table)
    std = np.array([arm_noise(run, RIG), *noise_floor(run, RIG).std_joint]) / COUNT
    np.testing.assert_allclose(std, math.hypot(counts, 12**-0.5), rtol=0.1)


def test_covariance_is_that_of_the_absolute_angles():
    rest = release(np.arange(-20_000, 1) / 1000, 1.5)
    np.testing.assert_allclose(noise_floor(rest, RIG).covariance, np.cov(rest.rest[:, 1:].T), rtol=0.05)


def test_absolute_joint_2_is_uncorrelated():
    rig = with_joint2("absolute")
    covariance = noise_floor(release(np.arange(-2000, 1000) / 1000, 1.5, rig=rig), rig).covariance
    assert covariance[0, 1] == covariance[1, 0] == 0
    assert covariance[1, 1] == pytest.approx((COUNT * math.sqrt(1.5**2 + 1 / 12)) ** 2, rel=0.1)


def test_drift_of_a_hand_held_rod_is_not_noise():
    t = np.arange(-1000, 1) / 1000
    theta = smooth_swing(0 * t) + 0.002 * t[:, None]
    np.testing.assert_allclose(noise_floor(recorded(t, theta, 1.5), RIG).std_joint, COUNT * 1.53, rtol=0.1)


def test_silent_encoder_still_has_the_noise_of_its_counts():
    noise = noise_floor(release(np.arange(-500, 500) / 1000, 0.0), RIG)
    np.testing.assert_allclose(noise.std_joint, COUNT / math.sqrt(12))


@pytest.mark.parametrize("rate", [200, 1000])
def test_without_a_rest_the_noise_is_estimated_from_the_swing(rate):
    noise = noise_floor(release(np.arange(10 * rate) / rate, 2.0), RIG)
    np.testing.assert_allclose(noise.std_joint, COUNT * math.sqrt(4 + 1 / 12), rtol=0.08)


def test_differences_survive_uneven_instants_gaps_and_jumps():
    rng = np.random.default_rng(5)
    t = np.cumsum(rng.uniform(0.6e-3, 1.4e-3, 8000))
    t[3000:] += 0.3
    t[5000:] += 0.02
    values = smooth_swing(t)[:, 1:] + rng.normal(0, [1e-4, 3e-4], (8000, 2))
    values[[1000, 4000]] += 0.5
    np.testing.assert_allclose(difference_std(t, values), [1e-4, 3e-4], rtol=0.06)


def test_differences_across_a_gap_do_not_count():
    t = np.arange(6000) / 50
    t += 0.3 * (np.arange(6000) // 13)  # six of 13 windows of seven samples contain a gap
    values = smooth_swing(t)[:, 1:] + np.random.default_rng(5).normal(0, 1e-4, (6000, 2))
    np.testing.assert_allclose(difference_std(t, values), 1e-4, rtol=0.1)


def test_the_line_through_a_rest_costs_two_degrees_of_freedom():
    t = np.arange(-NOISE.rest_samples, 50) / 1000
    rest = np.tile([3e-4, -3e-4, -3e-4, 3e-4], NOISE.rest_samples // 4)  # orthogonal to every straight line
    theta = np.pi + np.zeros((len(t), 3))
    theta[t < 0, 1:] += rest[:, None]
    noise = noise_floor(Run("rest", t, theta, None, None, "paper", "", 1000.0), with_joint2("absolute"))
    np.testing.assert_allclose(noise.std_joint, 3e-4 * math.sqrt(100 / 98), rtol=1e-9)


def test_noiseless_table_falls_back_on_the_encoder():
    t = np.arange(200) / 200
    still = Run("table", t, np.full((200, 3), 3.0), None, None, "paper", "", 200.0)
    noise = noise_floor(still, RIG)
    np.testing.assert_allclose(noise.std_joint, COUNT / 2)  # nothing moves: the errors are not independent


COARSE = 2 * math.pi / 2048


def coarse_table(theta):
    """Table of angles that were rounded to the counts of another encoder, 500 Hz."""
    t = np.arange(len(theta)) / 500
    return Run("table", t, COARSE * np.rint(theta / COARSE), None, None, "paper", "", 500.0)


def test_a_table_on_the_grid_of_a_coarse_encoder_has_at_least_its_rounding():
    t = np.arange(2000) / 500
    moves = np.stack([1.2 * np.sin(0.15 * t), np.pi + 0.8 * np.cos(6 * t), np.pi + np.sin(9 * t)], axis=1)
    run = coarse_table(moves)  # the arm is so slow that most of its neighbouring readings are equal
    assert difference_std(run.t, run.theta[:, :1])[0] < 0.3 * COARSE / math.sqrt(12)
    assert 0.999 * COARSE / math.sqrt(12) < arm_noise(run, RIG) < COARSE / 2
    error = np.std(run.theta - moves, axis=0)
    np.testing.assert_allclose(error, COARSE / math.sqrt(12), rtol=0.1)
    assert (noise_floor(run, with_joint2("absolute")).std_joint > 0.999 * COARSE / math.sqrt(12)).all()


def test_a_rod_that_is_balanced_between_two_counts_has_errors_of_half_a_count():
    rng, t = np.random.default_rng(3), np.arange(4000) / 500
    swinging, near = 0.5 * np.sin(8 * t), 0.5 * COARSE + 0.1 * COARSE * rng.normal(size=len(t))
    theta = np.where(t < 1, swinging, near)[:, None] * np.ones(3)
    run = coarse_table(theta)
    error = float(np.std(run.theta[:, 1] - theta[:, 1]))
    assert error > 1.3 * COARSE / math.sqrt(12)
    assert error <= noise_floor(run, with_joint2("absolute")).std_joint[0] < 1.1 * COARSE / 2


def test_table_better_than_the_rigs_encoders_keeps_its_own_noise():
    t = np.arange(2000) / 1000
    theta = smooth_swing(t) + np.random.default_rng(0).normal(0, 1e-6, (2000, 3))
    run = Run("table", t, theta, None, None, "paper", "", 1000.0)
    assert noise_floor(run, RIG).std_joint[0] == pytest.approx(1e-6, rel=0.1)


def test_changes_far_below_a_count_of_the_rig_are_no_multiples_of_it():
    t = np.arange(2000) / 1000
    theta = np.pi + 0.003 * np.sin(6 * t)[:, None] + np.random.default_rng(0).normal(0, 1e-6, (2000, 3))
    assert np.abs(np.diff(theta, axis=0)).max() < COUNT / 10
    run = Run("table", t, theta, None, None, "paper", "", 1000.0)
    assert noise_floor(run, with_joint2("absolute")).std_joint == pytest.approx([1e-6, 1e-6], rel=0.1)


def test_whitening_makes_unit_variance():
    noise = noise_floor(release(np.arange(-2000, 1000) / 1000, 1.5), RIG)
    np.testing.assert_allclose(noise.whitening @ noise.covariance @ noise.whitening.T, np.eye(2), atol=1e-12)


def test_the_noise_of_a_film_is_that_of_its_rods():
    """A video shows rods, so the angle of a relative joint 2 contains the noise of both."""
    run = replace(release(np.arange(-300, 300) / 1000, 0.0), film_noise=FilmNoise((3e-3, 4e-3), 0.5))
    assert noise_floor(run, RIG).std_joint == pytest.approx([3e-3, 5e-3])
    assert rest_correlation(run, RIG, 3).tolist() == [0.125, 0.125]


def test_too_few_samples_are_reported():
    with pytest.raises(RunError, match="5 samples are too few"):
        noise_floor(release(np.arange(5) / 1000, 1.0), RIG)


def test_readings_within_one_step_share_their_rounding_error():
    rate, step = 500, 2 * math.pi / 2048
    t = np.arange(2 * rate) / rate
    moving = t < 1
    angle = np.where(moving, 0.5 * np.sin(8 * t), 0.3 * step)
    theta = step * np.round(angle / step)[:, None] * np.ones(3)
    run = Run("balanced", t, theta, None, None, RIG.name, "", float(rate), mounting="inner")
    still, shared = same_rounding(run, theta[:, :1], np.array([step]))
    assert still[~moving].all()
    assert not still[t < 0.9].any()
    assert (shared[t < 0.9] == 1).all()
    assert (shared[~moving] == (~moving).sum()).all()
    # noise of half a step moves the reading within 0.1 s: it is not still
    rng = np.random.default_rng(1)
    noisy = step * np.round(angle / step + rng.normal(0, 0.5, len(t)))[:, None]
    assert same_rounding(run, noisy, np.array([step]))[1].max() == 1


@pytest.mark.parametrize("window", [1, 2, 5, 64, 100, 101])
def test_the_rounding_error_grows_with_the_share_of_windows_within_one_step(window, rng):
    readings = np.round(np.cumsum(rng.normal(size=(300, 2)), axis=0) / 30, 1)
    steps = np.array([0.1, 0.2])
    still = [np.ptp(readings[begin : begin + window], axis=0) < 1.5 * steps for begin in range(301 - window)]
    expected = steps * np.sqrt(1 / 12 + np.mean(still, axis=0) / 6)
    assert rounding_std(readings, steps, window) == pytest.approx(expected, rel=1e-12)

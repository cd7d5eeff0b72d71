"""Jittered time stamps and late readings are detected where they occur, and not elsewhere."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dpr_lab.gap.screen import sensor_faults
from dpr_lab.gap.screen.differences import noise_by_speed
from dpr_lab.gap.screen.stamps.instants import even_instants, periodic_delay
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.faulty_loggers import log

Array = NDArray[np.float64]


def readings(instants: Array, noise: float, seed: int = 0) -> Array:
    """(n, 2) rad: two joints of several frequencies and amplitudes, read at instants (n,) with white noise."""
    swing = [
        1.5 * np.cos(6 * instants) * np.exp(-instants / 10) + 0.3 * np.sin(15.1 * instants + 1),
        1.2 * np.sin(9 * instants + 0.3 * np.sin(3 * instants)),
    ]
    exact = np.stack(swing, axis=1)
    return exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)


@pytest.mark.parametrize(
    ("period", "cycle", "delay", "noise"),
    [
        (1e-3, 26, 2.5e-3, 3e-4),
        (1e-3, 26, 3e-4, 3e-4),
        (2e-3, 10, 1e-3, 1e-3),
        (1e-2, 7, 5e-3, 3e-3),
        (5e-3, 2, 1e-3, 1e-3),
        (5e-3, 3, -5e-3, 1e-3),
        (1e-2, 8, 8e-3, 2e-4),
    ],
)
def test_every_nth_reading_that_is_late_is_found_with_its_delay(period, cycle, delay, noise):
    stamps = np.arange(3000) * period
    late = np.arange(len(stamps)) % cycle == 1
    fault = periodic_delay(stamps, readings(stamps + delay * late, noise))
    assert fault is not None
    assert fault.cycle == cycle
    if cycle > 2:  # of two readings in turn either may be the late one
        assert np.array_equal(fault.late, late)
        assert fault.delay_s == pytest.approx(delay, rel=0.1)
    assert abs(fault.delay_s) == pytest.approx(abs(delay), rel=0.1)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("period", [1e-3, 5e-3, 1e-2])
def test_even_readings_have_no_fault(period, seed):
    stamps = np.arange(2000) * period
    angles = readings(stamps, 1e-3, seed)
    assert periodic_delay(stamps, angles) is None
    assert even_instants(stamps, angles) is None


@pytest.mark.parametrize(("period", "jitter", "noise"), [(2e-3, 1e-4, 2e-4), (1e-2, 2e-3, 1e-3)])
def test_stamps_that_jitter_about_a_uniform_clock_are_corrected(period, jitter, noise):
    taken = np.arange(2000) * period
    stamps = taken + jitter * np.abs(np.random.default_rng(1).standard_normal(len(taken)))
    instants = even_instants(stamps, readings(taken, noise))
    assert instants is not None
    assert np.std(instants - taken) < 0.5 * np.std(stamps - taken)
    assert (np.diff(instants) > 0).all()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_stamps_of_a_busy_host_that_come_in_bursts_are_corrected(period, seed):
    taken = np.arange(1200) * period
    logged = log("host_stamps", taken, period, np.random.default_rng(seed))
    instants = even_instants(logged.stamps, readings(taken, 2e-4))
    assert instants is not None
    assert (np.diff(instants) > 0).all()
    assert np.std(instants - taken) < 0.25 * np.std(logged.stamps - taken)


def test_a_lost_sample_among_jittered_stamps_stays_lost():
    taken = np.delete(np.arange(1200) * 5e-3, [400, 800, 801])
    stamps = taken + 5e-4 * np.random.default_rng(1).exponential(1.0, len(taken))
    instants = even_instants(stamps, readings(taken, 2e-4))
    assert instants is not None
    assert np.median(np.abs(instants - taken - np.median(instants - taken))) < 1e-4
    assert instants[-1] - instants[0] == pytest.approx(taken[-1] - taken[0], abs=2.5e-3)


@pytest.mark.parametrize(("period", "jitter", "noise"), [(2e-3, 1e-4, 2e-4), (1e-2, 2e-3, 1e-3)])
def test_uneven_stamps_that_are_right_stay(period, jitter, noise):
    even = np.arange(2000) * period
    stamps = even + jitter * np.abs(np.random.default_rng(1).standard_normal(len(even)))
    assert even_instants(stamps, readings(stamps, noise)) is None


def test_a_few_wild_readings_are_no_cycle():
    stamps = np.arange(3000) * 2e-3
    angles = readings(stamps, 5e-4)
    angles[np.random.default_rng(3).integers(10, 2990, 6)] += 0.2
    assert periodic_delay(stamps, angles) is None


@pytest.mark.parametrize("noise", [1e-3, 5e-3])
@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_five_outliers_of_a_short_record_are_rarely_a_cycle(period, noise):
    """At most an eighth of the records; without the limit `remaining`, three quarters and more."""
    stamps, delays = np.arange(300) * period, []
    for seed in range(12):
        rng, outliers = np.random.default_rng(seed), np.zeros(300)
        outliers[rng.integers(10, 290, 5)] = noise * rng.uniform(20, 100, 5) * rng.choice([-1, 1], 5)
        delays.append(periodic_delay(stamps, readings(stamps, noise, seed) + np.outer(outliers, [1.0, 0.7])))
        delays.append(periodic_delay(stamps, slow_swing(stamps, noise, seed) + outliers[:, None]))
    assert sum(delay is not None for delay in delays) <= 3


@pytest.mark.parametrize(
    ("period", "noise", "cycle"), [(1e-3, 1e-4, 40), (1e-3, 1e-3, 10), (1e-2, 1e-3, 40), (1e-2, 5e-3, 20)]
)
def test_true_delays_of_a_short_record_of_one_rod_are_found(period, noise, cycle):
    """A limit `remaining` of 8 standard errors misses most of them."""
    stamps = np.arange(300) * period
    instants = stamps + 2 * period * (np.arange(300) % cycle == 3)
    delays = [periodic_delay(stamps, slow_swing(instants, noise, seed)) for seed in range(12)]
    assert sum(delay is not None and delay.cycle == cycle for delay in delays) >= 11


@pytest.mark.parametrize("still", [np.zeros((3000, 2)), np.ones((3000, 1))])
def test_rods_at_rest_have_no_instants_to_judge(still):
    stamps = np.arange(3000) * 1e-3 + 1e-4 * np.random.default_rng(0).random(3000)
    assert even_instants(stamps, still) is None
    assert periodic_delay(stamps, still) is None


@pytest.mark.parametrize("seed", range(5))
def test_instants_that_jitter_at_random_are_no_cycle(seed):
    taken = np.arange(3000) * 1e-3 + 3e-4 * np.random.default_rng(seed).standard_normal(3000)
    assert periodic_delay(np.arange(3000) * 1e-3, readings(taken, 1e-4, seed)) is None


@pytest.mark.parametrize("seed", range(5))
def test_uneven_instants_that_are_known_are_no_noise_that_grows_with_speed(seed):
    known = log("uneven", np.arange(2000) * 5e-3, 5e-3, np.random.default_rng(seed)).stamps
    assert noise_by_speed(known, readings(known, 3e-4, seed), np.full(2, 3e-4), 5e-3)[1] < 6.0


def few_late(n: int, period: float, rng: np.random.Generator) -> Array:
    """(n,) s: stamps of a slow host; seven of ten are exact, the others late by up to half a period."""
    lateness = np.where(rng.random(n) < 0.3, period * rng.exponential(0.15, n), 0.0)
    return np.arange(n) * period + np.minimum(lateness, 0.6 * period)


def slow_swing(instants: Array, noise: float, seed: int) -> Array:
    """(n, 1) rad: one rod that swings with a period of 1.5 s."""
    exact = 0.6 * np.exp(-instants / 40) * np.cos(4.2 * instants)
    return (exact + noise * np.random.default_rng(seed).standard_normal(len(instants)))[:, None]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("n", "noise"), [(300, 2e-3), (100, 1e-3)])
def test_few_late_stamps_of_a_short_slow_record_are_corrected(n, noise, seed):
    stamps, taken = few_late(n, 0.1, np.random.default_rng(seed)), np.arange(n) * 0.1
    instants = even_instants(stamps, slow_swing(taken, noise, seed))
    assert instants is not None
    assert np.std(instants - taken) < 0.5 * np.std(stamps - taken)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize(("n", "noise"), [(300, 2e-3), (300, 1e-2), (100, 1e-3), (60, 1e-4)])
def test_correct_stamps_of_a_short_slow_record_are_kept(n, noise, seed):
    stamps = few_late(n, 0.1, np.random.default_rng(seed))
    assert even_instants(stamps, slow_swing(stamps, noise, seed)) is None


def test_a_reading_of_the_rest_may_belong_to_the_swing_at_even_instants(
    paper: Rig, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    t = np.arange(-50, 300) / 100 - 0.003
    t[50] = 0.001
    angle = np.where(t < 0, 1.2, 1.2 * np.cos(6 * t))
    theta = np.pi + np.column_stack([0 * t - np.pi, angle, 1.1 * angle]) + rng.normal(0, 2e-4, (len(t), 3))
    run = Run("a", t, theta, None, None, paper.name, "", 100.0)
    monkeypatch.setattr(sensor_faults, "even_instants", lambda t, joints: t + 0.02)
    screened = sensor_faults.screen(run, paper)
    assert len(screened.t) == np.count_nonzero(t >= 0) + 1


def test_a_constant_speed_contains_no_noise_that_grows_with_speed() -> None:
    t = np.arange(3000) * 1e-3
    turning = np.stack([4 * np.pi / 1024 * np.arange(3000), np.full(3000, 0.1)], axis=1)
    error, significance = noise_by_speed(t, turning, np.full(2, 1e-3), 1e-3)
    assert np.isfinite([error, significance]).all()
    assert significance < 3

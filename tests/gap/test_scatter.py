"""Scatter between recordings: zero for noise alone, and the drawn scatter if the values differ."""

from dataclasses import dataclass

import numpy as np
import pytest

from dpr_lab.dynamics.segments import segments
from dpr_lab.gap.conclusion.scatter import between_recordings, left_out_values


def instants(count: int, readings: int) -> list[np.ndarray]:
    """Instants of each segment."""
    return [np.arange(readings) + 10.0 * i for i in range(count)]


class _Linear:
    """Linear fit of `k` values to recordings of 40 segments of 6 readings; each recording has different values."""

    def __init__(self, spread: float, runs: int, seed: int, k: int = 2) -> None:
        rng = np.random.default_rng(seed)
        per, m = 40, 6
        self.A = rng.normal(size=(runs * per, m, k)) * [1.0, 30.0]
        own = spread * rng.normal(size=(runs, k)) / [1.0, 30.0]
        readings = np.einsum("smk,sk->sm", self.A, np.repeat(own, per, axis=0)) + rng.normal(size=(runs * per, m))
        flat = self.A.reshape(-1, k)
        self.e = readings - (self.A @ np.linalg.lstsq(flat, readings.ravel())[0])
        self.chi2_by_segment = np.sum(self.e**2, axis=1)
        self.linear, self.free, self.inside, self.prior = self, range(k), range(k), np.zeros((0, k))
        self.segments = segments(instants(runs * per, m), run=np.repeat(np.arange(runs), per))


def test_noise_alone_shows_no_scatter() -> None:
    fits = [_Linear(0.0, runs=5, seed=seed) for seed in range(20)]
    assert sum(np.any(between_recordings(fit, fit)) for fit in fits) <= 1


def test_values_that_differ_show_their_covariance() -> None:
    fits = [_Linear(1.0, runs=8, seed=seed) for seed in range(20)]
    mean = np.mean([between_recordings(fit, fit) for fit in fits], axis=0)
    assert np.sqrt(np.diag(mean)) == pytest.approx([1.0, 1 / 30], rel=0.25)


def test_one_recording_is_its_quarters() -> None:
    """Values that change within the recording; over all of it they average out to a quarter of their variance."""
    fits = [_Linear(1.0, runs=4, seed=seed) for seed in range(20)]
    several = np.mean([between_recordings(fit, fit) for fit in fits], axis=0)
    for fit in fits:
        fit.segments = segments(instants(len(fit.e), 6))
    assert np.mean([between_recordings(fit, fit) for fit in fits], axis=0) == pytest.approx(several / 4)


def test_the_rig_file_limits_the_values_of_another_recording() -> None:
    fit = _Linear(1.0, runs=8, seed=1)
    free = between_recordings(fit, fit)
    fit.prior = np.array([[100.0, 0.0]])
    limited = between_recordings(fit, fit)
    assert limited[0, 0] == pytest.approx(1 / (1 / free[0, 0] + 100.0**2), rel=0.1)
    assert limited[1, 1] == pytest.approx(free[1, 1], rel=0.1)


def test_values_without_a_recording_are_those_of_a_fit_to_the_others() -> None:
    fit = _Linear(1.0, runs=3, seed=2)
    fit.free = [_Free(v) for v in (0.5, -0.02)]
    fit.values = np.array([0.5, -0.02])
    left_out = left_out_values(fit, fit)
    for run in range(3):
        others = fit.segments.run != run
        step = np.linalg.lstsq(fit.A[others].reshape(-1, 2), fit.e[others].ravel())[0]
        assert left_out[run] == pytest.approx(fit.values + step, rel=1e-9)


def test_a_single_recording_has_no_values_without_it() -> None:
    assert left_out_values(fit := _Linear(1.0, runs=1, seed=2), fit).shape == (0, 2)


def test_segments_that_cannot_be_linearised_leave_the_common_values() -> None:
    fit = _Linear(1.0, runs=2, seed=2)
    fit.free = [_Free(v) for v in (0.5, -0.02)]
    fit.values = np.array([0.5, -0.02])
    fit.A[-1] = np.nan
    assert left_out_values(fit, fit) == pytest.approx(np.array([[0.5, -0.02], [0.5, -0.02]]))


@dataclass
class _Free:
    """Fitted value within wide bounds."""

    value: float
    lower: float = -100.0
    upper: float = 100.0

"""Estimate the angular velocities of a recorded swing by a Kalman smoother.

The model of each rod is a chain of integrators driven by white noise in the fourth derivative of its angle,

    d/dt (theta, omega, alpha, jerk) = (omega, alpha, jerk, w),    E[w(t) w(s)] = snap delta(t - s).

This model requires no knowledge of the rig. Both rods are combined in one state vector, because their measurement noise
is correlated if the encoder of joint 2 is relative. Transition matrix and process noise are exact for any interval, so
uneven times and interruptions need no resampling. The size of the accelerations varies within a swing and decays. For a
complete recording, the strength `snap` is therefore estimated by maximum likelihood in sections (`tuned_snap`).

The filter has a memory of about T = (sigma^2 h / snap)^(1/8), with sigma the standard deviation of the noise and h the
sampling interval. Internally, angles are in units of sigma and times in units of T, or of h if this is longer. All
states then have similar sizes; in other units rounding destroys the covariance of the backward pass.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.estimation.likelihood import log_likelihood
from dpr_lab.estimation.live_velocity import CHAIN, LIVE, FilterUnits
from dpr_lab.estimation.noise import NoiseFloor
from dpr_lab.estimation.smoother import smooth_chains
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings for the estimate of the process noise."""

    memories: tuple[float, float, float] = (-1.0, 2.0, 0.25)
    """Grid on which the memory T of the filter is searched, as log10 of T in samples: first, last, step.

    The grid covers all cases from fast swings at 30 Hz to slow swings at 10 kHz.
    """
    section_s: float = 0.4
    """Length of a section with constant process noise, s: slightly less than half a period of a 0.4 m rod."""
    section_samples: int = 100
    """Minimum number of samples of a section; it suffices to estimate a memory of up to ten samples."""
    memories_per_section: int = 10
    """Minimum ratio of the length of a section to a memory that is estimated from the section."""


SETTINGS = FilterSettings()


def smooth(run: Run, noise: NoiseFloor, snap: ArrayLike | None = None) -> Array:
    """Estimate angles and velocities of the swing by Rauch-Tung-Striebel smoothing.

    Args:
        run: the run; only t >= 0 is used, because the release is not a smooth motion
        noise: noise floor from `dpr_lab.estimation.noise.noise_floor`
        snap: strength of the process noise, rad^2/s^7, as one number, (2,) or (n, 2); None: `tuned_snap` of this run

    Returns:
        (n, 4) theta1, theta2, omega1, omega2 at each sample of the swing, rad and rad/s

    Raises:
        RunError: the swing has fewer than two samples.
    """
    t, theta, period = _swing(run)
    strengths = tuned_snap(run, noise) if snap is None else np.asarray(snap, dtype=np.float64)
    strengths = np.array(np.broadcast_to(strengths, theta.shape))
    scale = FilterUnits.of(period, noise.covariance, np.exp(np.log(strengths).mean(axis=0)))
    x = smooth_chains(t / scale.time, theta / scale.angle, scale.noise, scale.scaled(strengths), np.array(LIVE.prior))
    units = np.concatenate([scale.angle, scale.angle / scale.time])
    return x[:, [0, CHAIN, 1, CHAIN + 1]] * units


def tuned_snap(run: Run, noise: NoiseFloor) -> Array:
    """Estimate the process noise of each rod by maximum likelihood, in sections.

    The likelihood of each section is computed for a grid of memories, and its maximum is refined by a parabola. The
    logarithm of the strength is interpolated between the centres of sections. The measurement noise of each rod is its
    marginal noise.

    Args:
        run: the run; only t >= 0 is used
        noise: noise floor from `dpr_lab.estimation.noise.noise_floor`

    Returns:
        (n, 2) strengths for each sample of the swing and each rod, rad^2/s^7

    Raises:
        RunError: the swing has fewer than two samples.
    """
    t, theta, period = _swing(run)
    variance = np.diag(noise.covariance)
    sections = _sections(len(t), period)
    longest = (sections[0].stop - sections[0].start) / SETTINGS.memories_per_section
    first, last, step = SETTINGS.memories
    grid = np.arange(first, last + step / 2, step)
    grid = grid[: max(3, np.searchsorted(grid, math.log10(longest)))]
    prior = np.array(LIVE.prior)

    def snap(log_memory: ArrayLike) -> Array:
        return variance * period / (period * 10 ** np.asarray(log_memory, dtype=np.float64)) ** (2 * CHAIN)

    def likelihoods(log_memory: float) -> list[list[float]]:
        scale = FilterUnits.of(period, np.diag(variance), snap(log_memory))
        instants, rods = t / scale.time, np.ascontiguousarray((theta / scale.angle).T)
        return [[log_likelihood(instants[s], rods[i, s], scale.snap[i], prior) for i in (0, 1)] for s in sections]

    best = _peaks(grid, np.array([likelihoods(log_memory) for log_memory in grid]))
    middles = [(s.start + s.stop) / 2 for s in sections]
    return snap(np.stack([np.interp(np.arange(len(t)), middles, best[:, i]) for i in (0, 1)], axis=1))


def _swing(run: Run) -> tuple[Array, Array, float]:
    """Return the times, s, and rod angles, rad, from the release on, and the median sampling interval, s."""
    swing = run.swing
    if len(swing.t) < 2:
        raise RunError(f"{run.name}: {len(swing.t)} samples after the release; at least 2 are needed for a velocity")
    return swing.t, swing.theta[:, 1:], float(np.median(np.diff(swing.t)))


def _sections(samples: int, period: float) -> list[slice]:
    length = max(SETTINGS.section_samples, round(SETTINGS.section_s / period))
    edges = np.linspace(0, samples, max(1, samples // length) + 1).astype(int)
    return [slice(start, stop) for start, stop in pairwise(edges)]


def _peaks(grid: Array, values: Array) -> Array:
    """Return the positions of the maxima of values (k, ...) on an even grid (k,).

    Each maximum is the vertex of a parabola through three points.
    """
    middle = values.argmax(axis=0)
    inner = np.clip(middle, 1, len(grid) - 2)
    left, top, right = (np.take_along_axis(values, (inner + side)[None], axis=0)[0] for side in (-1, 0, 1))
    curvature = left - 2 * top + right
    shift = np.where(curvature < 0, 0.5 * (left - right) / np.where(curvature < 0, curvature, 1.0), 0.0)
    return np.where(middle == inner, grid[inner] + shift * (grid[1] - grid[0]), grid[middle])

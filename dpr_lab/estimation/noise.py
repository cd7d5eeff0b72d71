"""How exact the recorded angles are: the noise floor below which no difference to a model means anything."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.run import Run

REST_SAMPLES = 100
"""Fewest samples of rest that are trusted: they give the standard deviation to 7 %."""

ORDER = 6
"""Order of the differences: a 5 Hz swing read at 200 Hz then leaks less than 1e-6 rad into them."""

ROUNDING = 1e-9
"""Deviation below which a table of angles has no noise, only rounding, rad."""

_MAD = 1.482602218505602  # standard deviation of a normal over its median absolute deviation


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Standard deviation of the encoder readings of the two rods."""

    std_joint: NDArray[np.float64]
    """(2,) joint 1 and joint 2 as its encoder sees it (relative to rod 1, or absolute), rad."""
    source: Literal["rest", "differences", "quantisation"]
    """What it was measured on: the rest before the release, the swing itself, or only the size of a count."""
    covariance: NDArray[np.float64]
    """(2, 2) of (theta1, theta2), rad^2; a relative joint 2 makes them correlated."""

    @property
    def whitening(self) -> NDArray[np.float64]:
        """(2, 2) W with W^T W the inverse covariance: W times an angle error has unit variance, 1/rad."""
        return np.linalg.inv(np.linalg.cholesky(self.covariance)).astype(np.float64)


def noise_covariance(run: Run, rig: Rig) -> NDArray[np.float64]:
    """(2, 2) covariance of the recorded (theta1, theta2), rad^2; see `noise_floor`."""
    return noise_floor(run, rig).covariance


def noise_floor(run: Run, rig: Rig) -> NoiseFloor:
    """Noise of a recording.

    Measured on the rest before the release where there is enough of it, else on high-order differences of the swing;
    never less than quantisation, count / sqrt(12), for a recording in counts. With J from joint to absolute angles,

        covariance = J diag(std_joint^2) J^T,    J = [[1, 0], [1, 1]] for a relative joint 2, else the identity.

    Raises:
        RunError: too few samples to tell.
    """
    quantised = np.abs(rig.radians_per_count[1:]) / math.sqrt(12)
    source: Literal["rest", "differences"]
    if len(run.rest) >= REST_SAMPLES:
        source, std = "rest", _rest_std(run.t[run.t < 0], _joints(run.rest, rig))
    else:
        source, std = "differences", difference_std(run.t, _joints(run.theta, rig))
    # A table of angles need not come from the rig's own encoders; only a noiseless one falls back on them.
    floor = quantised if run.counts is not None else np.where(std > ROUNDING, 0.0, quantised)
    std_joint = np.maximum(std, floor)
    return NoiseFloor(std_joint, source if (std > floor).any() else "quantisation", _covariance(std_joint, rig))


def difference_std(t: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of white noise on a smooth signal at uneven instants, robust to jumps.

    Divided differences over seven neighbours cancel any polynomial of degree five. At unit gain on white noise,

        r = sum_j w_j x_j / sqrt(sum_j w_j^2),    w_j = 1 / prod_{i != j} (t_j - t_i),

    their median absolute value gives the deviation. Neighbourhoods with a gap are left out.

    Args:
        t: (n,) increasing instants, s
        values: (n, m) signals

    Returns:
        (m,)

    Raises:
        RunError: fewer than seven samples without a gap.
    """
    if len(t) <= ORDER:
        raise RunError(f"{len(t)} samples are too few to tell the noise: record at least {ORDER + 1}")
    windows = sliding_window_view(t, ORDER + 1)
    span = windows[:, -1] - windows[:, 0]
    dense = span < 1.5 * np.median(span)
    instants = windows[dense] / np.median(np.diff(t))
    apart = instants[:, :, None] - instants[:, None, :]
    weights = 1 / np.prod(apart + np.eye(ORDER + 1), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    neighbours = sliding_window_view(values, ORDER + 1, axis=0)[dense]
    return _MAD * np.median(np.abs(np.einsum("kmj,kj->km", neighbours, weights)), axis=0)


def _joints(theta: NDArray[np.float64], rig: Rig) -> NDArray[np.float64]:
    """(n, 2) what the two rod encoders see, from (n, 3) absolute angles."""
    rods = theta[:, 1:].copy()
    if rig.encoders.joint2 == "relative":
        rods[:, 1] -= rods[:, 0]
    return rods


def _rest_std(t: NDArray[np.float64], joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Deviation about a straight line: a hand-held rod drifts a little."""
    line = np.vander(t - t.mean(), 2)
    coefficients, *_ = np.linalg.lstsq(line, joints, rcond=None)
    return np.sqrt(((joints - line @ coefficients) ** 2).sum(axis=0) / (len(t) - 2))


def _covariance(std_joint: NDArray[np.float64], rig: Rig) -> NDArray[np.float64]:
    J = np.array([[1.0, 0.0], [1.0 if rig.encoders.joint2 == "relative" else 0.0, 1.0]])
    return J @ np.diag(std_joint**2) @ J.T

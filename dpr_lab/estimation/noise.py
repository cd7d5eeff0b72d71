"""Estimate the noise floor of recorded angles.

A difference between model and readings is not significant if it is below the noise floor.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Flags
from dpr_lab.errors import RunError
from dpr_lab.fitting.uncompiled import NORMAL_MAD
from dpr_lab.joint_angles import JointAngles
from dpr_lab.rig import Rig
from dpr_lab.run import FilmNoise, Run

NORMAL_Q90 = 1.6448536269514722
"""90 % quantile of the absolute value of a standard normal variable."""

ORDER = 6
"""Order of the differences; a 5 Hz swing sampled at 200 Hz then contributes less than 1e-6 rad."""


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """Settings of the noise estimate."""

    rest_samples: int = 100
    """Minimum number of samples of a rest; 100 samples determine the standard deviation to 7 %."""
    rounding_rad: float = 1e-9
    """Maximum standard deviation of a table of angles that contains only rounding errors and no noise, rad."""
    rounded: float = 0.51
    """Standard deviation of readings at rest below which rounding may change the noise, in counts.

    At the edge between two counts the standard deviation is about 0.5, also for little noise.
    """
    correlated: float = 4.0
    """Minimum autocorrelation of readings at rest that counts as significant, in standard errors."""
    most_alike: float = 0.98
    """Maximum autocorrelation of the noise of readings. Larger values indicate a trembling hand."""
    wild: float = 8.0
    """Maximum deviation of a reading at rest, in standard deviations. A larger deviation is a fault of the logger.

    The standard deviation follows from the 90 % quantile of the absolute deviations.
    """
    on_grid: float = 0.7
    """Minimum absolute mean of exp(2 pi i change / step) for which readings are multiples of a step.

    The mean is nearly zero for readings that are not rounded.
    """
    still_s: float = 0.1
    """Minimum time for which a reading stays within one step if its rounding errors are dependent, s.

    A swing reverses within a shorter time.
    """


NOISE = NoiseSettings()


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Standard deviation of the encoder readings of the two rods."""

    std_joint: Array
    """(2,) standard deviation of joint 1, and of joint 2 as read by its encoder (relative or absolute), rad."""
    joints: JointAngles
    """Mounting of the encoder of joint 2."""

    @property
    def covariance(self) -> Array:
        """(2, 2) covariance of (theta1, theta2), rad^2: J diag(std_joint^2) J^T.

        J is the derivative of the absolute angles with respect to the joint angles. If the encoder of joint 2 is
        relative, the errors of both angles are correlated.
        """
        J = self.joints.to_rods_matrix
        return J @ np.diag(self.std_joint**2) @ J.T

    @property
    def whitening(self) -> Array:
        """(2, 2) matrix W, 1/rad, that whitens an error of (theta1, theta2).

        W^T W is the inverse covariance.
        """
        return np.linalg.inv(np.linalg.cholesky(self.covariance)).astype(np.float64)


def noise_floor(run: Run, rig: Rig, *, still: bool = True) -> NoiseFloor:
    """Estimate the noise of a recording.

    The estimate uses the rest before the release if it is long enough, and otherwise high-order differences of the
    swing. The result is at least the standard deviation of the rounding (`rounding_std`), and for a video at least the
    noise of the tracked angles.

    Args:
        run: the recording
        rig: rig of the recording
        still: whether readings that stay within one step increase the estimate; not needed with `same_rounding`

    Raises:
        RunError: there are too few samples.
    """
    joints = rig.encoders.joint_angles
    if len(run.rest) >= NOISE.rest_samples:
        readings = joints.of_rods(run.swing.theta[:, 1:])
        steps = _steps_of(run, readings, rig.radians_per_count[1:])
        std = _rest_std(run.t[run.t < 0], joints.of_rods(run.rest[:, 1:]), steps)
        std = _in_motion(run, readings, std, steps)
    else:
        std = difference_std(run.t, joints.of_rods(run.theta[:, 1:]))
    floor = _rounding(run, joints.of_rods(run.swing.theta[:, 1:]), rig.radians_per_count[1:], std, still)
    if run.at_edges and run.setup.alone:  # with two encoders, only the encoder that counts is at an edge
        floor[0] = 0.0
    std_joint = np.maximum(std, floor)
    if run.film_noise is not None:
        std_joint = np.maximum(std_joint, _film_std(run.film_noise, joints))
    return NoiseFloor(std_joint, joints)


def _film_std(film: FilmNoise, joints: JointAngles) -> Array:
    """Return the (2,) standard deviations of the joint angles of a video, rad.

    If a single rod was tracked, its standard deviation is used for both rods.
    """
    rods = np.asarray(film.std) * np.ones(2)
    to_joints = np.linalg.inv(joints.to_rods_matrix)
    return np.sqrt(to_joints**2 @ rods**2)


def arm_noise(run: Run, rig: Rig, *, still: bool = True) -> float:
    """Estimate the standard deviation of a reading of the arm's encoder, rad.

    The estimate uses the rest before the release if there is one, and otherwise high-order differences.
    """
    rest, swing = run.rest[:, 0], run.swing
    quiet = len(rest) >= NOISE.rest_samples
    if quiet:
        steps = _steps_of(run, swing.theta[:, :1], rig.radians_per_count[:1])
        std = _in_motion(run, swing.theta[:, :1], np.std(rest, keepdims=True), steps)
    else:
        std = difference_std(swing.t, swing.theta[:, :1])
    return float(np.maximum(std, _rounding(run, swing.theta[:, :1], rig.radians_per_count[:1], std, still))[0])


def _in_motion(run: Run, readings: Array, at_rest: Array, steps: Array) -> Array:
    """Return the (m,) standard deviations of moving readings (n, m), rad.

    The readings are multiples of `steps` (m,); a step is 0 if they are not rounded. Noise below half a step hardly
    changes the rounded readings of a rod at rest, and at the edge between two steps even little noise changes them by a
    whole step. In motion the variance of the rounding is added to that of the noise. The differences of the swing show
    the sum.
    """
    hidden = (at_rest > NOISE.rounding_rad) & (at_rest < NOISE.rounded * steps)
    if len(readings) <= ORDER or not hidden.any():
        return at_rest
    most = np.sqrt(at_rest**2 + steps**2 / 12)
    # of integers, the median difference would be a coarse measure
    moving = np.quantile(np.abs(_differences(run.swing.t, readings)), 0.9, axis=0) / NORMAL_Q90
    return np.where(hidden, np.clip(moving, steps / math.sqrt(12), most), at_rest)


def same_rounding(run: Run, readings: Array, counts: Array) -> tuple[Flags, Array]:
    """Find readings within one rounding step, and count the readings with equal rounding errors.

    If a controller balances a rod within one step, many successive samples are equal. They share one error of up to
    half a step, so together they contain the information of one reading.

    Args:
        run: the recording
        readings: (n, m) readings of its swing, rad
        counts: (m,) counts of the encoders in the rig file, rad

    Returns:
        (n, m) mask of the readings that stay within one step, and (n, m) length of the sequence of equal readings to
        which such a reading belongs; the length is 1 for other readings
    """
    steps = _steps_of(run, readings, counts)
    window = _still_window(run)
    still, shared = np.zeros(readings.shape, dtype=np.bool_), np.ones(readings.shape)
    if len(readings) < window:
        return still, shared
    begins = _still(readings, steps, window)
    for begin in range(window):
        still[begin : begin + len(begins)] |= begins
    for joint, values in enumerate(readings.T):
        edges = np.flatnonzero(np.diff(values, prepend=np.inf))
        lengths = np.diff(edges, append=len(values))
        shared[:, joint] = np.where(still[:, joint], np.repeat(lengths, lengths), 1.0)
    return still, shared


def _still_window(run: Run) -> int:
    """Return the number of samples for which successive rounding errors count as dependent.

    All of them must lie within one rounding step.
    """
    return max(2, round(NOISE.still_s * run.rate_hz))


def _still(readings: Array, steps: Array, window: int) -> Flags:
    """Return an (n - window + 1, m) mask of windows that stay within one step.

    The readings have the shape (n, m).
    """
    ranges = highest(readings, window) + highest(-readings, window)
    return np.asarray(ranges < 1.5 * steps)


def highest(values: NDArray[Any], width: int) -> NDArray[Any]:
    """Return the (n - width + 1, ...) maxima over windows of `width` rows.

    The maxima are combined recursively from those over windows of half the width.
    """
    if width == 1:
        return values
    half = -(-width // 2)
    of_halves = highest(values, half)
    return np.maximum(of_halves[: len(of_halves) - width + half], of_halves[width - half :])


def _rounding(run: Run, readings: Array, counts: Array, std: Array, still: bool) -> Array:
    """Return the (m,) standard deviations of the rounding of readings (n, m), rad.

    A table of angles may come from other encoders than those of the rig file. It counts as rounded only if its own
    readings show a step, or if it has no noise at all.
    """
    steps = counts = np.abs(counts)
    if run.counts is None:
        steps = np.maximum(_steps(readings, counts), np.where(std > NOISE.rounding_rad, 0.0, counts))
    return rounding_std(readings, steps, _still_window(run)) if still else steps / math.sqrt(12)


def _steps_of(run: Run, readings: Array, counts: Array) -> Array:
    """Return the (m,) rounding step of the readings: a count of a device, or the step that a table shows."""
    return np.abs(counts) if run.counts is not None else _steps(readings, np.abs(counts))


def _steps(readings: Array, counts: Array) -> Array:
    """Return the (m,) rounding steps of readings (n, m): all changes of a reading are multiples of its step.

    A count of the rig and the smallest change are tried. A step is 0 if neither fits.
    """
    steps = np.zeros(readings.shape[1])
    for joint, changes in enumerate(np.abs(np.diff(readings, axis=0)).T):
        moved = changes[changes > NOISE.rounding_rad]
        for step in (counts[joint], moved.min(initial=np.inf)):
            # a change much smaller than a step has a phase near zero, like a multiple of the step, but is not a
            # multiple
            of_step = np.where(moved > 0.5 * step, np.exp(2j * np.pi * moved / step), 0.0)
            if len(moved) and abs(of_step.mean()) > NOISE.on_grid:
                steps[joint] = max(steps[joint], step)
    return steps


def rounding_std(readings: Array, steps: Array, window: int) -> Array:
    """Return the (m,) standard deviation of the rounding errors of readings (n, m).

    The readings of column j are multiples of `steps[j]`. While a reading changes by more than a step from sample to
    sample, the errors of its samples are independent, and the result is step / sqrt(12). If a reading stays within one
    step for `window` samples, it may be near the edge between two values, with errors of up to step / 2. An example is
    the reading of a rod that a controller balances.
    """
    if len(readings) < window:
        return steps / math.sqrt(12)
    still = _still(readings, steps, window).mean(axis=0)
    return steps * np.sqrt(1 / 12 + (1 / 4 - 1 / 12) * still)


def difference_std(t: Array, values: Array) -> Array:
    """Return the standard deviation of white noise on a smooth signal at uneven times.

    The estimate is robust to jumps. Divided differences over seven neighbours x_j, taken at the times t_j, cancel
    any polynomial of degree five. At unit gain on white noise they are

        r = sum_j w_j x_j / sqrt(sum_j w_j^2),    w_j = 1 / prod_{i != j} (t_j - t_i).

    The median of |r| gives the standard deviation. Windows with missing samples are excluded.

    Args:
        t: (n,) increasing times, s
        values: (n, m) signals

    Returns:
        (m,) standard deviations in the unit of the signals

    Raises:
        RunError: there are fewer than seven samples.
    """
    return NORMAL_MAD * np.median(np.abs(_differences(t, values)), axis=0)


def _differences(t: Array, values: Array) -> Array:
    """Return the (windows, m) differences r of `difference_std`."""
    if len(t) <= ORDER:
        raise RunError(f"{len(t)} samples are too few to estimate the noise: record at least {ORDER + 1}")
    windows = sliding_window_view(t, ORDER + 1)
    span = windows[:, -1] - windows[:, 0]
    dense = span < 1.5 * np.median(span)
    weights = difference_weights(windows[dense], float(np.median(np.diff(t))))
    neighbours = sliding_window_view(values, ORDER + 1, axis=0)[dense]
    return np.einsum("kmj,kj->km", neighbours, weights)


def difference_weights(windows: Array, period: float) -> Array:
    """Return (windows, 7) weights of sixth-order divided differences, with unit gain on white noise.

    Args:
        windows: (windows, 7) increasing times, s
        period: usual interval, s
    """
    normalised = (windows - windows[:, :1]) / period
    weights = np.ones_like(normalised)
    for j in range(ORDER + 1):
        for i in range(ORDER + 1):
            if i != j:
                weights[:, j] *= normalised[:, j] - normalised[:, i]
    weights = 1 / weights
    return weights / np.linalg.norm(weights, axis=1, keepdims=True)


def rest_correlation(run: Run, rig: Rig, apart: int = 1) -> Array:
    """Return the (2,) autocorrelation of the noise of joints 1 and 2 at a lag of `apart` samples.

    A value is 0 if it is not significant. For white noise the estimate is 0 +- 1 / sqrt(n). A tracker or a filter
    causes a larger value. For a video the value is that of a first-order process with the autocorrelation of the rod
    lengths.
    """
    if run.film_noise is not None:
        return np.full(2, run.film_noise.correlation**apart)
    rest = rig.encoders.joint_angles.of_rods(run.rest[:, 1:])
    if len(rest) < max(NOISE.rest_samples, 2 * apart):
        return np.zeros(2)
    t = run.t[run.t < 0]
    deviation = _from_line(np.vander(t - t.mean(), 2), rest, np.ones(len(rest), dtype=bool))
    correlation = (deviation[apart:] * deviation[:-apart]).mean(axis=0) / np.maximum(
        (deviation**2).mean(axis=0), NOISE.rounding_rad**2
    )
    return np.where(
        correlation > NOISE.correlated / np.sqrt(len(rest)), np.clip(correlation, 0.0, NOISE.most_alike), 0.0
    )


def _rest_std(t: Array, joints: Array, counts: Array) -> Array:
    """Return the standard deviation of each joint at rest, rad.

    The deviations are taken from a straight line, because a rod that is held by hand drifts. Outliers are excluded; a
    change by one count is not an outlier.
    """
    line = np.vander(t - t.mean(), 2)
    return np.array([_std_about_line(line, joint, 1.5 * count) for joint, count in zip(joints.T, counts, strict=True)])


def _std_about_line(line: Array, values: Array, least: float) -> float:
    used = np.ones(len(values), dtype=bool)
    deviation = _from_line(line, values, used)
    for _ in range(2):
        usual = float(np.quantile(np.abs(deviation[used]), 0.9)) / NORMAL_Q90
        tame = np.abs(deviation) <= max(NOISE.wild * usual, least)
        if not usual or tame[used].all():
            break
        used, deviation = tame, _from_line(line, values, tame)
    return float(np.sqrt((deviation[used] ** 2).sum() / (used.sum() - 2)))


def _from_line(line: Array, values: Array, used: Flags) -> Array:
    return values - line @ np.linalg.lstsq(line[used], values[used], rcond=None)[0]

"""Estimate the noise and the camera tilt of a video from the lengths of the rods in the picture.

The true length of a rod is constant. The scatter of the distance between its ends in the picture is therefore the noise
of a tracked point. This noise, divided by the length, is the noise of the angle in rad. If the camera does not look
along the joint axes, the length in the picture also varies with the pose (weak perspective). This variation is
described by a constant and two harmonics of the angles. It is not noise.

Source: Hartley & Zisserman (2004), Multiple View Geometry in Computer Vision, section 6.3: affine cameras.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.errors import RunError
from dpr_lab.shown import percent

WANTED = "pivot, elbow and tip (the pivot may be omitted if it does not move); for a single rod its tip"


@dataclass(frozen=True, slots=True)
class LengthSettings:
    """Settings for analysing the lengths of rods."""

    scatter: float = 0.1
    """Maximum scatter of a rod's length, relative to the length. With a larger scatter the points are not the ends of
    one rod."""
    wild: float = 4.0
    """Limit of the deviation of a length from its fit, in standard deviations. Larger deviations are clipped."""
    correlated: float = 4.0
    """Minimum autocorrelation of the lengths that counts as significant, in standard errors."""
    most_alike: float = 0.98
    """Upper bound on the autocorrelation of the lengths of neighbouring frames."""
    wrong: tuple[float, float] = (8.0, 0.01)
    """Two limits on the deviation of a length: in standard deviations, and relative to the length. If both are
    exceeded, the tracker followed another object in this frame."""
    frames_per_unknown: float = 3.0
    """Minimum number of frames with independent errors per coefficient of the fit of length against pose."""
    by_pose: float = 10.0
    """Minimum F statistic of the fit of length against pose for which the camera counts as tilted."""


LENGTHS = LengthSettings()


@dataclass(frozen=True, slots=True)
class RodLength:
    """Variation of the length of a rod in the picture."""

    std: float
    """Standard deviation of the rod's angle, rad: the relative standard deviation of the length at a given pose."""
    correlation: float
    """Correlation of the errors of neighbouring frames; 0 if it is not significant."""
    varies: float
    """Range of the part of the length that depends on the pose, relative to the length; 0 if it is not significant."""
    wrong: Flags
    """(n,) mask of the frames in which the tracker followed another object, according to the length."""


def rod_length(path: Path, axis: str, rods: Sequence[Array]) -> RodLength:
    """Analyse the length of the last rod in `rods` in the picture.

    Args:
        path: table of the points
        axis: name of the rod's angle
        rods: (n, 2) vectors from start to end of each rod, up to the analysed rod; NaN if a point was not detected

    Raises:
        RunError: the points are not the ends of a rod.
    """
    from scipy.stats import median_abs_deviation

    lengths = np.hypot(*rods[-1].T)
    valid = lengths[np.isfinite(lengths)]
    if not len(valid) or not np.median(valid) > 0:
        raise RunError(f"{path}: the ends of the rod of {axis} were never detected together")
    length = float(np.median(valid))
    scatter = float(median_abs_deviation(valid, scale="normal"))  # pyright: ignore[reportArgumentType]
    if scatter > LENGTHS.scatter * length:
        raise RunError(
            f"{path}: the rod of {axis} changes its length by {percent(scatter / length)}: these points"
            f" are not its ends; select them with --take {WANTED}"
        )
    deviation = np.clip(lengths - length, -LENGTHS.wild * scatter, LENGTHS.wild * scatter)
    by_pose = _by_pose(rods, deviation)
    deviation -= by_pose
    off = np.abs(lengths - length - by_pose)
    scatter, varies = (
        float(median_abs_deviation(deviation[np.isfinite(deviation)], scale="normal")),  # pyright: ignore[reportArgumentType]
        float(np.ptp(by_pose)),
    )
    alike = _autocorrelation(deviation)
    significant = alike > LENGTHS.correlated / np.sqrt(len(valid))
    correlation = min(alike, LENGTHS.most_alike) if significant else 0.0
    wrong = off > max(LENGTHS.wrong[0] * scatter, LENGTHS.wrong[1] * length)
    return RodLength(scatter / length, correlation, varies / length, wrong)


def _autocorrelation(values: Array) -> float:
    """Compute the lag-1 autocorrelation; pairs with a NaN are ignored."""
    power, products = float(np.nanmean(values**2)), values[1:] * values[:-1]
    return float(np.nanmean(products)) / power if power > 0 and np.isfinite(products).any() else 0.0


def _by_pose(rods: Sequence[Array], lengths: Array) -> Array:
    """Compute the part of the apparent length that depends on the directions of the rods.

    The length is that of the last rod. The result is (n,), or 0 if the dependence is not significant. Two harmonics of
    each direction are fitted by least squares. n errors with autocorrelation r have the effective number
    n (1 - r) / (1 + r).
    """
    angles = np.arctan2(*np.stack(rods).transpose(2, 0, 1))
    harmonics = [wave(k * angle) for angle in angles for k in (1, 2) for wave in (np.cos, np.sin)]
    A = np.column_stack([np.ones(len(lengths)), *harmonics])
    A[~np.isfinite(A).all(axis=1)] = 0.0
    valid = A.any(axis=1) & np.isfinite(lengths)
    by_pose = A @ np.linalg.lstsq(A[valid], lengths[valid], rcond=1e-6)[0]
    correlation = max(_autocorrelation(lengths - by_pose), 0.0)
    independent, unknowns = valid.sum() * (1 - correlation) / (1 + correlation), A.shape[1]
    if independent < LENGTHS.frames_per_unknown * unknowns:
        return np.zeros(len(lengths))
    explained, left = np.var(by_pose[valid]), np.var(lengths[valid] - by_pose[valid])
    F = explained / unknowns * (independent - unknowns)
    return np.asarray(by_pose) if F > LENGTHS.by_pose * left else np.zeros(len(lengths))

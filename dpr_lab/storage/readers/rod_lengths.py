"""Lengths of rods in a video: their scatter is the noise of the angles, their dependence on the pose a tilted camera.

The length of a rod is constant, so the scatter of the distance of its ends is the noise of a point in the picture.
Divided by the length it is the noise of the angle. If the camera does not look along the joint axes, the length in the
picture also varies with the pose: by a constant and two harmonics of the angles (weak perspective), which are not
noise.

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
    """Limits for the lengths of rods."""

    scatter: float = 0.1
    """Maximum relative scatter of a rod's length; above it the points are not the ends of the rod."""
    wild: float = 4.0
    """Deviation of a length, in standard deviations, beyond which it is limited."""
    correlated: float = 4.0
    """Minimum significant autocorrelation of the lengths, in standard errors."""
    most_alike: float = 0.98
    """Maximum autocorrelation of the lengths of neighbouring frames."""
    wrong: tuple[float, float] = (8.0, 0.01)
    """Deviation of a length, in standard deviations and relative to the length. If both are exceeded, the tracker
    followed something else in this frame.
    """
    frames_per_unknown: float = 3.0
    """Minimum number of frames with independent errors for each coefficient of the length as a function of the pose."""
    by_pose: float = 10.0
    """Minimum F statistic for which a length depends on the pose: the camera is tilted."""


LENGTHS = LengthSettings()


@dataclass(frozen=True, slots=True)
class RodLength:
    """Variation of the length of a rod in the picture."""

    std: float
    """Standard deviation of the rod's angle, rad: that of the length at a given pose, relative to the length."""
    correlation: float
    """Autocorrelation of the errors of neighbouring frames; 0 if it is not significant."""
    varies: float
    """Range of the length as a function of the pose, relative to the length; 0 if it is not significant."""
    wrong: Flags
    """(n,) frames in which the length shows that the tracker followed something else."""


def rod_length(path: Path, axis: str, rods: Sequence[Array]) -> RodLength:
    """Variation of the length of the last of some rods.

    Args:
        path: table of the points
        axis: name of its angle
        rods: (n, 2) from start to end of each rod up to this one, NaN if a point was not detected

    Raises:
        RunError: the points are not the ends of a rod.
    """
    from scipy.special import ndtri
    from scipy.stats import median_abs_deviation

    lengths = np.hypot(*rods[-1].T)
    valid = lengths[np.isfinite(lengths)]
    if not len(valid) or not np.median(valid) > 0:
        raise RunError(f"{path}: the ends of the rod of {axis} were never detected together")
    length = float(np.median(valid))
    scatter = float(median_abs_deviation(valid, scale=ndtri(0.75)))
    if scatter > LENGTHS.scatter * length:
        raise RunError(
            f"{path}: the rod of {axis} changes its length by {percent(scatter / length)}: these points"
            f" are not its ends; select them with --take {WANTED}"
        )
    away = np.clip(lengths - length, -LENGTHS.wild * scatter, LENGTHS.wild * scatter)
    by_pose = _by_pose(rods, away)
    away -= by_pose
    off = np.abs(lengths - length - by_pose)
    scatter, varies = float(median_abs_deviation(away[np.isfinite(away)], scale=ndtri(0.75))), float(np.ptp(by_pose))
    alike = _autocorrelation(away)
    significant = alike > LENGTHS.correlated / np.sqrt(len(valid))
    correlation = min(alike, LENGTHS.most_alike) if significant else 0.0
    wrong = off > max(LENGTHS.wrong[0] * scatter, LENGTHS.wrong[1] * length)
    return RodLength(scatter / length, correlation, varies / length, wrong)


def _autocorrelation(values: Array) -> float:
    """Correlation of neighbouring values; neighbours with a NaN are ignored."""
    power, products = float(np.nanmean(values**2)), values[1:] * values[:-1]
    return float(np.nanmean(products)) / power if power > 0 and np.isfinite(products).any() else 0.0


def _by_pose(rods: Sequence[Array], lengths: Array) -> Array:
    """(n,) part of the lengths (n,) of the last rod that depends on the directions of the rods; 0 if not significant.

    Two harmonics of each direction, by least squares. Only (1 - r) / (1 + r) n of n errors with the autocorrelation r
    are independent.
    """
    angles = np.arctan2(*np.stack(rods).transpose(2, 0, 1))
    harmonics = [wave(k * angle) for angle in angles for k in (1, 2) for wave in (np.cos, np.sin)]
    A = np.column_stack([np.ones(len(lengths)), *harmonics])
    A[~np.isfinite(A).all(axis=1)] = 0.0
    valid = A.any(axis=1) & np.isfinite(lengths)
    by_pose = A @ np.linalg.lstsq(A[valid], lengths[valid], rcond=1e-6)[0]
    alike = max(_autocorrelation(lengths - by_pose), 0.0)
    independent, unknowns = valid.sum() * (1 - alike) / (1 + alike), A.shape[1]
    if independent < LENGTHS.frames_per_unknown * unknowns:
        return np.zeros(len(lengths))
    explained, left = np.var(by_pose[valid]), np.var(lengths[valid] - by_pose[valid])
    F = explained / unknowns * (independent - unknowns)
    return np.asarray(by_pose) if F > LENGTHS.by_pose * left else np.zeros(len(lengths))

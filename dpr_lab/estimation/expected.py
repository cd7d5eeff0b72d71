"""What releases from the rig file's poses would tell, before any is recorded."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.base import BASE, added_base, base_parameters, ratios
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.estimation.least_squares import Conditions, information
from dpr_lab.estimation.segments import Segment, cut
from dpr_lab.rig import JOINTS, Pose, Rig
from dpr_lab.run import Run

DURATION_S = 10.0
"""Length of a release, s."""

SEGMENT_S = 1.0
"""Segments that a real rig's model can be expected to follow, s; longer ones would tell more."""


def expected_information(Z: ArrayLike, rig: Rig) -> NDArray[np.float64]:
    """Fisher information of the ratios, and of b with a known mass clamped on, in one release from each of the poses.

    Args:
        Z: (9,) parameters, SI
        rig: lengths, encoders, poses, link and any added mass

    Returns:
        (5, 5) or (6, 6) in the order of `dpr_lab.estimation.least_squares.UNKNOWNS`; all zero without poses
    """
    base, added = base_parameters(Z, rig.rig.L1, rig.rig.g), added_base(rig.added_mass, rig.rig.L1, rig.rig.g)
    known = expected_conditions(rig, added)
    _, slopes = known.ratios(np.append(ratios(base), base[BASE.index("b")])[: known.unknowns], 0)
    return slopes.T @ ratio_information(base + added, rig, list(rig.poses.values())) @ slopes


def ratio_information(base: ArrayLike, rig: Rig, poses: Sequence[Pose]) -> NDArray[np.float64]:
    """(5, 5) Fisher information that one release from each pose holds of the ratios of these base parameters, (6,)."""
    return information(ratios(base), expected_segments(base, rig, poses), expected_conditions(rig))


def expected_segments(base: ArrayLike, rig: Rig, poses: Sequence[Pose]) -> list[Segment]:
    """Simulated releases without noise, cut into segments of `SEGMENT_S`."""
    t = np.arange(round(DURATION_S * rig.link.rate_hz)) / rig.link.rate_hz
    segments: list[Segment] = []
    for pose in poses:
        states = simulate(base, rig.rig.L1, rig.rig.g, [*pose.theta[1:], 0.0, 0.0], t)
        theta = np.insert(states[:, :2], 0, pose.theta0, axis=1)
        run = Run("expected", t, theta, None, None, rig.name, rig.sha256, rig.link.rate_hz)
        segments += cut(0, run, states, SEGMENT_S)
    return segments


def expected_conditions(rig: Rig, added: NDArray[np.float64] | None = None) -> Conditions:
    """What a fit to `expected_segments` takes as known, with the rig file's encoder noise.

    A count is off by the encoder's noise and by rounding, which is uniform: variance noise_counts^2 + 1/12.
    """
    slopes = rig.theta(np.eye(JOINTS)) - rig.theta(np.zeros(JOINTS))
    covariance = (rig.encoders.noise_counts**2 + 1 / 12) * (slopes.T @ slopes)[1:, 1:]
    whitening = np.linalg.inv(np.linalg.cholesky(covariance)).astype(np.float64)
    return Conditions(rig.rig.L1, rig.rig.g, (whitening,), () if added is None else (added,))


def information_root(information: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """F with F^T F = information: how whitened readings answer to the unknowns.

    Args:
        information: (n, n), singular where the recordings are blind
        scale: (n,) size of each unknown, so that no unit costs digits

    Returns:
        (n, n)
    """
    eigenvalues, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T / scale

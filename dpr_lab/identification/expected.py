"""Compute the expected information of releases from the poses of a rig file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, added_base, ratios, whole_parameters
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import swings
from dpr_lab.estimation.noise import NoiseFloor
from dpr_lab.fitting.estimate import SCALE, Estimate, unknown_ratios
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods import ratios_of_run
from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.identification.ratio_fit import information, rods_estimate, segmented
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class Releases:
    """Assumptions about future releases."""

    duration_s: float = 10.0
    """Duration of each recording, s: the default of `dpr-lab capture`."""
    segment_s: float = 1.0
    """Length of segments, s, that a model should be able to follow on a real rig.

    Longer segments contain more information.
    """


RELEASES = Releases()


def expected_information(Z: ArrayLike, rig: Rig, releases: Releases = RELEASES) -> Array:
    """Compute the Fisher information of one release from each pose of a rig.

    The unknowns are the ratios, and b if the rig has an added mass.

    Args:
        Z: (9,) parameters, SI
        rig: lengths, encoders, poses, link and any added mass
        releases: duration of recordings and segments

    Returns:
        (5, 5) or (6, 6) in the order of `dpr_lab.fitting.estimate.UNKNOWN_RATIOS`; all zero without poses
    """
    whole, setup = whole_parameters(Z, rig.L1, rig.g), Setup(added=rig.added_mass)
    _, slopes = ratios_of_run(unknown_ratios(whole), setup, rig.L1, rig.g)
    determined = slopes[:, : SCALE + 1 if rig.added_mass else len(RATIOS)]
    base = whole[:-1] + added_base(rig.added_mass, rig.L1, rig.g)
    return determined.T @ ratio_information(base, rig, list(rig.poses.values()), releases) @ determined


def ratio_information(base: ArrayLike, rig: Rig, poses: Sequence[Pose], releases: Releases = RELEASES) -> Array:
    """Compute the Fisher information (5, 5) on the ratios in one release from each pose.

    `base` contains the base parameters (6,).
    """
    if not poses:
        return np.zeros((len(RATIOS), len(RATIOS)))
    return information(*expected_releases(base, rig, poses, releases))


def expected_releases(
    base: ArrayLike, rig: Rig, poses: Sequence[Pose], releases: Releases = RELEASES
) -> tuple[Problem, Estimate]:
    """Return the fitting problem of noise-free simulated releases, with the true parameters.

    The releases are cut into segments. The standard deviation of a reading is `Rig.reading_std`.
    """
    joints, rate_hz = rig.encoders.joint_angles, rig.link.rate_hz
    std = rig.reading_std[1:]
    t = np.arange(round(releases.duration_s * rate_hz)) / rate_hz
    starts = np.array([[*pose.theta[1:], 0.0, 0.0] for pose in poses])
    layout = segments([t] * len(poses), run=range(len(poses)), step=MAX_STEP)
    swung = swings(ratios(base), rig.L1, rig.g, layout, starts)
    runs = []
    for pose, states in zip(poses, np.split(swung, len(poses)), strict=True):
        theta = np.insert(states[:, :2], 0, pose.theta0, axis=1)
        run = Run("expected", t, theta, None, None, rig.name, rig.sha256, rate_hz)
        runs.append(PreprocessedRun(run, NoiseFloor(std, "quantisation", joints), states))
    problem, initial = segmented(runs, rig, releases.segment_s)
    return problem, rods_estimate(unknown_ratios(base), initial)


def information_root(information: Array, scale: Array) -> Array:
    """Compute a root F of an information matrix: F^T F = information.

    F is the sensitivity of whitened readings to the unknowns.

    Args:
        information: (n, n) information; it is singular if the recordings do not determine all unknowns
        scale: (n,) size of each unknown, for numerical scaling

    Returns:
        (n, n) root
    """
    eigenvalues, vectors = np.linalg.eigh(scale[:, None] * information * scale)
    return np.sqrt(np.maximum(eigenvalues, 0.0))[:, None] * vectors.T / scale

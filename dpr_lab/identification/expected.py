"""Expected information of releases from the poses of a rig file."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import swings
from dpr_lab.estimation.noise import NoiseFloor
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods import ratios_of_run
from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.identification.ratio_fit import information, rods_estimate, segmented
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.setup import BOTH, Setup


@dataclass(frozen=True, slots=True)
class Releases:
    """Assumptions about future releases."""

    duration_s: float = 10.0
    """Duration of each recording, s: the default of `dpr-lab capture`."""
    segment_s: float = 1.0
    """Length of the segments over which a model is assumed to follow a real rig, s.

    Longer segments contain more information.
    """


RELEASES = Releases()


def mounted_releases(Z: ArrayLike, rig: Rig, releases: Releases = RELEASES) -> tuple[Problem, Estimate]:
    """Return the fitting problem of simulated releases of the mounted rods from all poses of a rig.

    The result also contains the true parameters and initial states.

    Args:
        Z: (9,) parameters, SI
        rig: mounted rods, lengths, encoders, poses, link and any added mass
        releases: duration of recordings and segments
    """
    mounting, whole = rig.rods.mounting, whole_parameters(Z, rig.L1, rig.g)
    setups = [
        Setup(mounting, rig.added_mass, round(pose.theta[2] - pose.theta[1], 1) if mounting == "clamped" else 0.0)
        for pose in rig.poses.values()
    ]
    return expected_releases(whole, rig, list(rig.poses.values()), releases, setups)


def ratio_information(base: ArrayLike, rig: Rig, poses: Sequence[Pose], releases: Releases = RELEASES) -> Array:
    """Compute the Fisher information (5, 5) on the ratios from one release of both rods from each pose.

    The information is zero without poses.

    Args:
        base: (6,) base parameters
        rig: lengths, gravity, encoders and link
        poses: poses of the releases
        releases: duration of recordings and segments
    """
    if not poses:
        return np.zeros((len(RATIOS), len(RATIOS)))
    return information(*expected_releases(base, rig, poses, releases))


def expected_releases(
    base: ArrayLike, rig: Rig, poses: Sequence[Pose], releases: Releases = RELEASES, setups: Sequence[Setup] = ()
) -> tuple[Problem, Estimate]:
    """Return the fitting problem of simulated releases without noise, and the true parameters.

    The releases are divided into segments. The standard deviation of a reading is `Rig.reading_std`. `setups` contains
    the mounting of each release, by default both rods.
    """
    joints, rate_hz = rig.encoders.joint_angles, rig.link.rate_hz
    std, unknown, setups = rig.reading_std[1:], unknown_ratios(base), setups or [BOTH] * len(poses)
    t = np.arange(round(releases.duration_s * rate_hz)) / rate_hz
    layout = segments([t] * len(poses), run=range(len(poses)), setups=setups, step=MAX_STEP)
    starts = layout.turning_as_one(np.array([[*pose.theta[1:], 0.0, 0.0] for pose in poses]))
    of_runs = np.array([ratios_of_run(unknown, setup, rig.L1, rig.g)[0] for setup in setups])
    swung = swings(of_runs, rig.L1, rig.g, layout, starts)
    runs = []
    for pose, setup, states in zip(poses, setups, np.split(swung, len(poses)), strict=True):
        theta = np.insert(states[:, :2], 0, pose.theta0, axis=1)
        run = Run(
            "expected", t, theta, None, None, rig.name, rig.sha256, rate_hz,
            mounting=setup.mounting, added_mass=setup.added,
        )  # fmt: skip
        runs.append(PreprocessedRun(run, NoiseFloor(std, joints), states))
    problem, initial = segmented(runs, rig, releases.segment_s)
    return problem, rods_estimate(unknown, initial)


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

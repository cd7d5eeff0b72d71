"""Candidate releases: evenly spread start poses, neighbouring poses, all permitted mountings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.gap.screen.pieces import PIECES
from dpr_lab.planning.acting import allowed_rods, arm_states
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import CandidateRelease, MountedParts
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import AddedMass


@dataclass(frozen=True, slots=True)
class Search:
    """Settings of the search for start poses."""

    spread: int = 40
    """Number of evenly spread poses with which the search starts."""
    screened_s: float = 10.0
    """Duration of the releases by which the evenly spread poses are compared, s."""
    alone_s: float = PIECES.from_s - 1.0
    """Maximum duration of a first release, s; a diagnosis does not divide such a recording into pieces."""
    best: int = 3
    """Number of the best poses that are refined."""
    neighbours: int = 4
    """Number of neighbours of each refined pose."""
    near_rad: float = 0.3
    """Standard deviation of the angles between a pose and its neighbours, rad. The second round uses half of this
    value."""
    finalists: int = 2
    """Number of the best releases for which the duration is optimised."""
    placements: int = 2
    """Number of random placement errors over which the information of the best releases is averaged."""
    quiet_deg: tuple[float, ...] = (5.0, 15.0, 40.0)
    """Amplitudes of additional candidates about hanging, deg.

    One rod or both are displaced, and the swing comes to rest.
    """

    repeated: float = 0.5
    """Fraction by which the value of a release falls if it repeats another release, because a model error affects
    both releases."""
    alike_rad: float = 0.5
    """Distance between two start poses, rad, at which the reduction by `repeated` has mostly disappeared."""


SEARCH = Search()


def spread_poses(limits: PlanLimits, count: int, rng: np.random.Generator) -> Array:
    """Return (n, 2) reachable start angles, rad.

    An evenly spread set of poses is followed by small deflections from hanging.
    """
    from scipy.stats.qmc import Sobol  # slow to import

    points = Sobol(2, rng=rng).random_base2(int(np.ceil(np.log2(count))) + 4)
    spread = 2 * np.pi * points
    reached = spread[limits.poses.reachable(spread)]
    if len(reached) < count:  # few of the points are within a narrow range
        low, high = np.array([limits.poses.theta1_rad, limits.poses.theta2_rad]).T
        narrow = low + (high - low) * points
        reached = narrow[limits.poses.reachable(narrow)]
    quiet = np.pi + np.radians([[a * s1, a * s2] for a in SEARCH.quiet_deg for s1, s2 in ((1, 1), (0, 1), (1, 0))])
    return np.concatenate([reached[:count], quiet[limits.poses.reachable(quiet)]])


def near(
    release: CandidateRelease, limits: PlanLimits, width: float, count: int, rng: np.random.Generator
) -> list[CandidateRelease]:
    """Draw releases with random reachable start poses near the start pose of a given release.

    Args:
        release: the given release
        limits: limits of the plan
        width: standard deviation of each angle, rad
        count: maximum number of releases
        rng: source of randomness
    """
    theta = np.array([release.theta1, release.theta2]) + width * rng.standard_normal((4 * count, 2))
    theta = theta[limits.poses.reachable(theta)][:count] % (2 * np.pi)
    return [replace(release, theta1=a, theta2=b) for a, b in theta.tolist()]


def placements(release: CandidateRelease, std: float, count: int, rng: np.random.Generator) -> list[CandidateRelease]:
    """Copy a release with random placement errors of the start pose.

    Args:
        release: the release
        std: standard deviation of each angle, rad
        count: number of copies
        rng: source of randomness
    """
    errors = std * rng.standard_normal((count, 2))
    return [replace(release, theta1=release.theta1 + a, theta2=release.theta2 + b) for a, b in errors.tolist()]


def bent(release: CandidateRelease) -> CandidateRelease:
    """Set the angle of an absent rod to the angle of the mounted rod."""
    return replace(release, theta2=release.theta1) if release.setup.alone else release


def novelty(release: CandidateRelease, made: Sequence[CandidateRelease]) -> float:
    """Return the fraction of its value that a release keeps after the releases `made`.

    The fraction is 1 if no release in `made` is similar.
    """
    alike = [
        np.exp(-0.5 * (_apart(release, other) / SEARCH.alike_rad) ** 2)
        for other in made
        if (other.mounted, other.arm, other.signal) == (release.mounted, release.arm, release.signal)
    ]
    return 1.0 - SEARCH.repeated * float(max(alike, default=0.0))


def _apart(first: CandidateRelease, second: CandidateRelease) -> float:
    """Return the distance between two start poses, rad; full turns do not count."""
    return float(np.hypot(*((first.start - second.start + np.pi) % (2 * np.pi) - np.pi)[:2]))


def mountings(rig: Rig, limits: PlanLimits) -> Iterator[MountedParts]:
    """Yield the permitted mountings for free swings; the current mounting comes first."""
    masses: Sequence[AddedMass | None] = [rig.added_mass, None, *limits.masses]
    arms = dict.fromkeys(state == "held" for state in arm_states(rig, limits) if state != "driven")
    for held in arms:
        for mounting in allowed_rods(rig, limits):
            for mass in dict.fromkeys(masses):
                absent = {"inner": "outer", "outer": "inner"}.get(mounting)
                if (mass is None or mass.rod != absent) and (held or mounting in ("both", "inner")):
                    yield MountedParts(mounting, mass, held)


def mounted_now(rig: Rig) -> MountedParts:
    """Return the mounting that the rig file states."""
    return MountedParts(rig.rods.mounting, rig.added_mass, rig.arm.mode not in ("free", "driven"))


def longest_s(limits: PlanLimits, alone: bool) -> float:
    """Return the maximum duration of a release, s; `alone` is true for the first release.

    A first release is diagnosed alone. A diagnosis divides a single recording of 20 s or more into pieces and fits only
    every second piece. A first release is therefore shorter, unless the limits do not permit a shorter recording.
    """
    times = limits.recording
    return max(min(times.longest_s, SEARCH.alone_s), times.shortest_s) if alone else times.longest_s


def minutes(release: CandidateRelease, before: MountedParts, limits: PlanLimits) -> float:
    """Return the time of a release, minutes, with the change from the mounting `before`."""
    cost = limits.minutes.place + release.duration_s / 60
    if release.added != before.added:
        cost += limits.minutes.mass
    if release.mounted.arm_held != before.arm_held:
        cost += limits.minutes.arm
    if release.mounting != before.mounting:
        elbow = {release.mounting, before.mounting} == {"both", "clamped"}
        cost += limits.minutes.clamp if elbow else limits.minutes.mount
    return cost


def cheapest_minutes(rig: Rig, limits: PlanLimits) -> float:
    """Return the time of the shortest release that keeps the current added mass, minutes."""
    now, shortest = mounted_now(rig), limits.recording.shortest_s
    return min(
        minutes(CandidateRelease(0.0, 0.0, shortest, mounting, now.added, arm=arm), now, limits)
        for mounting in allowed_rods(rig, limits)
        for arm in arm_states(rig, limits)
    )

"""Candidate releases: evenly spread start poses, neighbours of good poses, and all permitted mountings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, without_turns
from dpr_lab.gap.screen.pieces import PIECES
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
    """Maximum duration of a first release, s; a diagnosis divides a longer single recording into pieces."""
    best: int = 3
    """Number of the best poses that are refined."""
    neighbours: int = 4
    """Number of neighbours of each refined pose."""
    near_rad: float = 0.3
    """Standard deviation of the angles between a pose and its neighbours, rad; in the second round, half of it."""
    finalists: int = 2
    """Number of the best releases for which the duration is optimised."""
    placements: int = 2
    """Number of random placement errors over which the information of the best releases is averaged."""
    quiet_deg: tuple[float, ...] = (5.0, 15.0, 40.0)
    """Deflections from hanging of additional candidates, deg, with one or both rods deflected.

    These swings come to rest early.
    """
    least_deg: float = 2.0
    """Minimum deflection from hanging of a released rod, deg, unless the limits of the plan permit only less."""
    upright_deg: float = 10.0
    """Minimum distance of a start pose from an unstable equilibrium, deg, unless the limits permit only less.

    Closer to the equilibrium, placement error and static friction determine when and to which side the rods fall.
    """
    repeated: float = 0.5
    """Fraction by which the value of a release decreases if it repeats another one. A model error affects both."""
    least_bits: float = 1e-9
    """Minimum value of a release, bits, before its reduction by `repeated`; a new pose then precedes a repeated one."""
    alike_rad: float = 0.5
    """Standard deviation of the Gaussian by which `repeated` decreases with the distance of two start poses, rad."""


SEARCH = Search()


def swinging(releases: Sequence[CandidateRelease], e: Sequence[float] = (1.0, 1.0)) -> list[CandidateRelease]:
    """Return the releases that start far enough from an equilibrium.

    If there are none, return those that start away from upright or, if there are none either, all releases.

    Near an equilibrium static friction holds the rods, although the linearised model predicts information.

    Args:
        releases: the releases
        e: gravity torques e1 and e2 of the rods, N m; only their ratio is used
    """
    least, upright = np.radians([SEARCH.least_deg, SEARCH.upright_deg])
    falling = [release for release in releases if upright_rad(release, e) >= upright] or releases
    return [release for release in falling if hanging_rad(release, e) >= least] or list(falling)


def upright_rad(release: CandidateRelease, e: Sequence[float]) -> float:
    """Return the distance of a start pose from the nearest unstable equilibrium, rad.

    Two free rods have three unstable equilibria. A single rod, or rods with a clamped elbow, have one, with the centre
    of mass above the joint. `e` contains the gravity torques of both rods, N m.
    """
    theta = release.start[:2]
    if release.mounting != "both":
        return float(np.abs(np.angle(e @ np.exp(1j * theta))))
    unstable = np.array([(0.0, 0.0), (0.0, np.pi), (np.pi, 0.0)])
    return float(np.abs(without_turns(theta - unstable)).max(axis=1).min())


def hanging_rad(release: CandidateRelease, e: Sequence[float]) -> float:
    """Return the distance of a start pose from the stable equilibrium, rad.

    In this equilibrium both rods hang or, with a clamped elbow, their centre of mass is below the joint.
    """
    if release.mounting != "both":
        return np.pi - upright_rad(release, e)
    return float(np.abs(without_turns(release.start[:2] - np.pi)).max())


def spread_poses(limits: PlanLimits, count: int, rng: np.random.Generator) -> Array:
    """Return (n, 2) reachable start angles, rad: at most `count` evenly spread poses, then deflections from hanging."""
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
    release: CandidateRelease,
    limits: PlanLimits,
    width: float,
    count: int,
    rng: np.random.Generator,
    e: Sequence[float] = (1.0, 1.0),
) -> list[CandidateRelease]:
    """Draw releases with random reachable start poses near the start pose of a given release.

    Args:
        release: the given release
        limits: limits of the plan
        width: standard deviation of each angle, rad
        count: maximum number of releases
        rng: source of randomness
        e: gravity torques of the rods, as for `swinging`
    """
    theta = [release.theta1, release.theta2] + width * rng.standard_normal((4 * count, 2))
    return swinging(release.moved(theta[limits.poses.reachable(theta)] % (2 * np.pi)), e)[:count]


def placements(release: CandidateRelease, std: float, count: int, rng: np.random.Generator) -> list[CandidateRelease]:
    """Copy a release with random placement errors of the start pose.

    Args:
        release: the release
        std: standard deviation of each angle, rad
        count: number of copies
        rng: source of randomness
    """
    return release.moved([release.theta1, release.theta2] + std * rng.standard_normal((count, 2)))


def novelty(release: CandidateRelease, made: Sequence[CandidateRelease]) -> float:
    """Return the remaining fraction of the value of a release after the releases `made`.

    The fraction is 1 if no release in `made` is similar.
    """
    apart = min((apart_rad(release, other) for other in made), default=np.inf)
    return 1.0 - SEARCH.repeated * float(np.exp(-0.5 * (apart / SEARCH.alike_rad) ** 2))


def value(bits: float, release: CandidateRelease, made: Sequence[CandidateRelease]) -> float:
    """Return the value of a release that adds `bits`, reduced if it repeats one of the releases `made`."""
    return novelty(release, made) * max(bits, SEARCH.least_bits)


def apart_rad(release: CandidateRelease, other: CandidateRelease) -> float:
    """Return the distance of two start poses, rad; infinite for different mountings, arm states or signals."""
    same_kind = _kind(other) == _kind(release)
    return float(np.hypot(*without_turns(release.start[:2] - other.start[:2]))) if same_kind else np.inf


def repetition(
    release: CandidateRelease,
    planned: Sequence[CandidateRelease],
    recorded: Sequence[CandidateRelease],
    placement_rad: float,
) -> str:
    """Return the end of the text of a release that repeats another one; empty for a new start pose.

    Poses whose distance is less than `placement_rad`, the standard deviation of the placement, count as equal.
    """
    made = [(f"release {number}", other) for number, other in enumerate(planned, 1)]
    made += [("a recorded release", other) for other in recorded]
    return next((f" (repeats {name})" for name, other in made if apart_rad(release, other) < placement_rad), "")


def _kind(release: CandidateRelease) -> tuple[MountedParts, str, str]:
    return release.mounted, release.arm, release.signal


def mountings(rig: Rig, limits: PlanLimits) -> Iterator[MountedParts]:
    """Yield the permitted mountings for free swings; the current one comes first if it is permitted."""
    masses: Sequence[AddedMass | None] = [rig.added_mass, None, *limits.masses]
    arms = dict.fromkeys(state == "held" for state in limits.arm_states(rig) if state != "driven")
    for held in arms:
        for mounting in limits.allowed_rods(rig):
            for mass in dict.fromkeys(masses):
                absent = {"inner": "outer", "outer": "inner"}.get(mounting)
                if (mass is None or mass.rod != absent) and (held or mounting in ("both", "inner")):
                    yield MountedParts(mounting, mass, held)


def mounted_now(rig: Rig) -> MountedParts:
    """Return the mounted parts that the rig file states."""
    return MountedParts(rig.rods.mounting, rig.added_mass, rig.arm.mode not in ("free", "driven"))


def longest_s(limits: PlanLimits, alone: bool) -> float:
    """Return the maximum duration of a release, s; `alone` is true for the first release.

    A first release is diagnosed alone. A diagnosis divides a single recording of 20 s or more into pieces and fits only
    every second piece. A first release is therefore shorter, unless the limits do not permit a shorter recording.
    """
    times = limits.recording
    return max(min(times.longest_s, SEARCH.alone_s), times.shortest_s) if alone else times.longest_s


def minutes(release: CandidateRelease, before: MountedParts, limits: PlanLimits) -> float:
    """Return the time that a release takes, minutes, including the change from the mounting `before`."""
    steps, elbow = limits.minutes, {release.mounting, before.mounting} == {"both", "clamped"}
    cost = steps.place + release.duration_s / 60 + steps.mass * (release.added != before.added)
    cost += steps.arm * (release.mounted.arm_held != before.arm_held)
    return cost + (steps.clamp if elbow else steps.mount) * (release.mounting != before.mounting)


def cheapest_minutes(rig: Rig, limits: PlanLimits) -> float:
    """Return the time of the shortest release that keeps the current added mass, minutes."""
    now, shortest = mounted_now(rig), limits.recording.shortest_s
    return min(
        minutes(CandidateRelease(0.0, 0.0, shortest, mounting, now.added, arm=arm), now, limits)
        for mounting in limits.allowed_rods(rig)
        for arm in limits.arm_states(rig)
    )

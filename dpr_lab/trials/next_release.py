"""Selection of the next release of a sequential trial: by plan, from a fixed menu, or at random."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.gap.advice.expected_recordings import MENU
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.limits import PlanLimits, RecordingTimes
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class SequentialSettings:
    """Settings common to all strategies."""

    duration_s: float = 10.0
    """Duration of every release."""
    most: int = 6
    """Releases after which a plant counts as undecided."""


SEQUENTIAL = SequentialSettings()

LIMITS = PlanLimits(recording=RecordingTimes(shortest_s=SEQUENTIAL.duration_s, longest_s=SEQUENTIAL.duration_s))
"""Kinds of releases in a plan: free swings of both rods, as for the random poses."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Runs and results before the next release."""

    rig: Rig
    runs: Sequence[Run]
    diagnosis: Diagnosis | None
    """Diagnosis of these runs; None before the first one."""
    rng: np.random.Generator
    proposal: Plan | None = None
    """Plan after these runs; None before the first one."""


Chooser = Callable[[Situation], tuple[CandidateRelease, Plan | None]]


def proposed(rig: Rig, runs: Sequence[Run] = (), diagnosis: Diagnosis | None = None) -> Plan:
    """The next release, and whether any release separates the open causes."""
    return plan(rig, runs, diagnosis, limits=LIMITS, count=2)


def planned(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """The first release of a plan."""
    proposal = now.proposal or proposed(now.rig)
    first = proposal.releases[0]
    return CandidateRelease(first.theta1_rad, first.theta2_rad, SEQUENTIAL.duration_s), proposal


def from_menu(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """The poses of the rig file, then those of the menu of recommended recordings, in order."""
    poses = [CandidateRelease(pose.theta1, pose.theta2, SEQUENTIAL.duration_s) for pose in now.rig.poses.values()]
    menu = [CandidateRelease(*choice.theta, SEQUENTIAL.duration_s, added=choice.added) for choice in MENU]
    return (*poses, *menu)[len(now.runs) % (len(poses) + len(menu))], None


def at_random(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """A random pose, uniformly distributed."""
    theta1, theta2 = now.rng.uniform(0.0, 2 * np.pi, 2).tolist()
    return CandidateRelease(theta1, theta2, SEQUENTIAL.duration_s), None


CHOOSERS: dict[str, Chooser] = {"plan": planned, "menu": from_menu, "random": at_random}
"""Name of a strategy -> function that selects the next release."""

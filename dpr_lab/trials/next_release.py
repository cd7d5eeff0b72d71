"""Ways to choose the next release of a sequential trial: by plan, from a fixed menu, or at random."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.gap.advice.expected_recordings import MENU
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.limits import PlanLimits, RecordingTimes
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import Release
from dpr_lab.planning.result import Plan
from dpr_lab.rig import Rig
from dpr_lab.run import Run

DURATION_S = 10.0
"""Duration of every release, whoever chooses it."""

LIMITS = PlanLimits(recording=RecordingTimes(shortest_s=DURATION_S, longest_s=DURATION_S))
"""Of the plans: free swings of both rods, as those of the random poses."""


@dataclass(frozen=True, slots=True)
class Situation:
    """What an experimenter has before the next release."""

    rig: Rig
    runs: Sequence[Run]
    diagnosis: Diagnosis | None
    """Of these runs; None before the second one."""
    rng: np.random.Generator


Chooser = Callable[[Situation], tuple[Release, Plan | None]]


def planned(now: Situation) -> tuple[Release, Plan | None]:
    """The first release of a plan; before any diagnosis, the next one of the plan from the rig file."""
    before = len(now.runs) if now.diagnosis is None else 0
    made = plan(
        now.rig,
        now.runs if now.diagnosis else (),
        now.diagnosis,
        limits=LIMITS,
        count=before + (2 if now.diagnosis else 1),
    )
    chosen = made.releases[before]
    return Release(chosen.theta1_rad, chosen.theta2_rad, DURATION_S), made


def from_menu(now: Situation) -> tuple[Release, Plan | None]:
    """The poses of the rig file, then those of the menu of recommended recordings, in order."""
    poses = [Release(*pose.theta[1:].tolist(), DURATION_S) for pose in now.rig.poses.values()]
    menu = [Release(*one.theta, DURATION_S, added=one.added) for one in MENU]
    return (*poses, *menu)[len(now.runs) % (len(poses) + len(menu))], None


def at_random(now: Situation) -> tuple[Release, Plan | None]:
    """Any pose, all equally probable."""
    theta1, theta2 = now.rng.uniform(0.0, 2 * np.pi, 2).tolist()
    return Release(theta1, theta2, DURATION_S), None


CHOOSERS: dict[str, Chooser] = {"plan": planned, "menu": from_menu, "random": at_random}
"""Name of a strategy -> how it chooses the next release."""

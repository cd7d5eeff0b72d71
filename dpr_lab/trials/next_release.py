"""Choice of the next release in a sequential trial: planned, from a menu, or random."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.gap.advice.expected_recordings import MENU, MENU_OF_ONE_ROD
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.limits import ArmPlan, PlanLimits, RecordingTimes
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import ArmState, CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class SequentialSettings:
    """Settings that all strategies have in common."""

    duration_s: float = 10.0
    """Duration of every release, s; the strategy `free` chooses its own durations."""
    most: int = 6
    """Maximum number of releases of a plant; the causes then count as undecided."""


SEQUENTIAL = SequentialSettings()


EQUAL_TIMES = RecordingTimes(shortest_s=SEQUENTIAL.duration_s, longest_s=SEQUENTIAL.duration_s)


def limits_of(rig: Rig, largest_input: float | None = None, times: RecordingTimes = EQUAL_TIMES) -> PlanLimits:
    """Return the limits of the plans in a sequential trial.

    They permit the kinds of releases that the other strategies use.

    Args:
        rig: the rig; the mounted rods and the mode of the arm do not change
        largest_input: largest input of the arm's motor, that of the input signal of the device; None without a motor
        times: permitted durations
    """
    return PlanLimits(recording=times, arm=ArmPlan(modes=(arm_of(rig),), input=largest_input))


def arm_of(rig: Rig) -> ArmState:
    """Return the state of the arm in every release of a rig."""
    return rig.arm.mode if rig.arm.mode in ("free", "driven") else "held"


@dataclass(frozen=True, slots=True)
class Situation:
    """Situation before the next release of a sequential trial."""

    rig: Rig
    runs: Sequence[Run]
    diagnosis: Diagnosis | None
    """Diagnosis of the runs recorded so far; None before the first run."""
    rng: np.random.Generator
    limits: PlanLimits
    proposal: Plan | None = None
    """Plan computed after the runs recorded so far; None before the first run."""


Chooser = Callable[[Situation], tuple[CandidateRelease, Plan | None]]


def planned(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """Choose the first release of a plan."""
    proposal = now.proposal or plan(now.rig, limits=now.limits, count=2)
    first = proposal.releases[0]
    release = _release(now.rig, first.theta1_rad, first.theta2_rad)
    return replace(release, duration_s=first.duration_s, torques=first.torques, signal=first.signal), proposal


def from_menu(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """Choose the next release of a fixed list: the poses of the rig file, then the menu of recommended recordings."""
    poses = [_release(now.rig, pose.theta1, pose.theta2) for pose in now.rig.poses.values()]
    alone = now.rig.rods.mounting in ("inner", "outer")
    menu = [
        replace(_release(now.rig, choice.theta1_rad, choice.theta2_rad), added=choice.added_mass or now.rig.added_mass)
        for choice in (MENU_OF_ONE_ROD if alone else MENU).values()
    ]
    return (*poses, *menu)[len(now.runs) % (len(poses) + len(menu))], None


def at_random(now: Situation) -> tuple[CandidateRelease, Plan | None]:
    """Choose a random start pose with a uniform distribution of both angles."""
    theta1, theta2 = now.rng.uniform(0.0, 2 * np.pi, 2).tolist()
    return _release(now.rig, theta1, theta2), None


def _release(rig: Rig, theta1: float, theta2: float) -> CandidateRelease:
    """Return a release with the current setup of the rig; a driven arm follows the input signal of the device."""
    mounting = rig.rods.mounting
    return CandidateRelease(theta1, theta2, SEQUENTIAL.duration_s, mounting, rig.added_mass, arm=arm_of(rig))


@dataclass(frozen=True, slots=True)
class Strategy:
    """Strategy by which the releases of a sequential trial are chosen."""

    choose: Chooser
    """Function that selects the next release."""
    times: RecordingTimes = EQUAL_TIMES
    """Permitted durations of a planned release."""


STRATEGIES: dict[str, Strategy] = {
    "plan": Strategy(planned),
    "free": Strategy(planned, RecordingTimes()),
    "menu": Strategy(from_menu),
    "random": Strategy(at_random),
}
"""All strategies by name; `free` is a plan that also chooses the duration, between 10 and 30 s."""

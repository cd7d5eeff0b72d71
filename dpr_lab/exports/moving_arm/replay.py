"""Simulate a recording with a moving-arm model by segments, for replays in other programs.

The initial states of the segments are fitted.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.errors import RunError
from dpr_lab.exports.programs import REPLAY, Replay
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.moving_arm.engine import engine_constants, engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ArmReplaySettings:
    """Settings of a replay by segments."""

    segment_s: float = 1.0
    """Duration of a segment, s. Each segment starts from its own fitted state, because an arm with two rods soon moves
    chaotically."""
    segments: int = 10
    """Maximum number of segments of each run."""
    iterations: int = 30
    """Maximum number of iterations of the fit of initial states."""


ARM_REPLAY = ArmReplaySettings()


@dataclass(frozen=True, slots=True)
class FollowedSegments:
    """A run and its simulation by a model, in segments with fitted initial states."""

    run: str
    t: Array
    """(n,) instants of all segments in sequence, s since the release."""
    measured: Array
    """(n, 3) readings of joints 0, 1 and 2, rad; nan where a reading is missing."""
    simulated: Array
    """(n, 3) simulated joint angles, rad."""
    offsets: Integers
    """(segments + 1,) index of the first sample of each segment, and of the end."""
    initial: Array
    """(segments, 6) states theta0, theta1, theta2 and their speeds at the start of each segment."""
    noise: Array
    """(3,) noise of the readings of each joint, rad; nan if a joint has no readings."""


def run_problem(run: Run, rig: Rig, model: MovingArmModel, segment_s: float) -> tuple[Problem, Array]:
    """Set up the fitting problem of a run with the constants of a model.

    The result contains the problem and the initial states (segments, 6), which are estimated from the readings.

    Raises:
        RunError: the run belongs to another rig, or the mode of the arm differs between run and model.
    """
    name = str(run.file or run.name)
    if run.arm_mode not in ("free", "driven"):
        raise RunError(f"{name}: its arm is {run.arm_mode}: give a run with a free or driven arm, as in the model")
    if model.input == "acceleration":
        raise RunError(f"{name}: its arm is driven by an acceleration, which the replay does not support")
    model.refuse_run(run, rig)
    problem, initial = Recordings((record(run, rig),), rig).cut(segment_s)
    return replace(problem, model=RodsWithEffects(engine_constants(model, rig))), initial


def follow_with_arm(run: Run, rig: Rig, model: MovingArmModel, segment_s: float) -> FollowedSegments:
    """Simulate a run with a model by segments; only the initial states are fitted.

    Raises:
        RunError: the mode of the arm differs between run and model, or the model cannot follow the readings.
    """
    problem, initial = run_problem(run, rig, model, segment_s)
    unknown, params = engine_values(model, rig)
    fitted = descend(problem, Estimate.of(unknown, params, initial), (), iterations=ARM_REPLAY.iterations).estimate
    simulated = problem.predict(fitted)
    if not np.isfinite(simulated).all():
        raise RunError(f"{run.file or run.name}: the model cannot follow these readings")
    return FollowedSegments(
        run.name,
        problem.t,
        arm_first(problem, problem.measured),
        arm_first(problem, simulated),
        problem.segments.offsets,
        fitted.initial[:, FOLLOW.order],
        np.roll(noise_of(problem), 1),
    )


def arm_first(problem: Problem, readings: Array) -> Array:
    """Return readings (n, 3) in the order of joints 0, 1 and 2; nan where the recording has no reading."""
    return np.roll(np.where(problem.read, readings, np.nan), 1, axis=1)  # joints 1, 2, 0 before


def noise_of(problem: Problem) -> Array:
    """Return the noise (joints,) of the readings of each joint, rad; nan if a joint has no readings."""
    weights = (column[column > 0] for column in problem.weight.T)
    return np.array([1.0 / np.median(column) if len(column) else np.nan for column in weights])


def arm_replays(run: Run, rig: Rig, model: MovingArmModel) -> list[Replay]:
    """Cut a recording into segments with fitted initial states.

    See `follow_with_arm` for the errors.
    """
    followed = follow_with_arm(run, rig, model, ARM_REPLAY.segment_s)
    to_rods = rig.encoders.joint_angles.to_rods
    swings = []
    for (first, last), x0 in zip(pairwise(followed.offsets.tolist()), followed.initial, strict=True):
        t = followed.t[first:last]
        start = segment_start(float(t[0]))
        inputs = _inputs(run, rig, REPLAY.steps(start, float(t[-1])))
        measured, simulated = (
            np.column_stack([joints[first:last, 0], to_rods(joints[first:last, 1:])])
            for joints in (followed.measured, followed.simulated)
        )
        swings.append(Replay(run.name, t, measured, simulated, start, x0, followed.noise, inputs))
    return swings[: ARM_REPLAY.segments]


def _inputs(run: Run, rig: Rig, steps: Array) -> Array:
    """Return the mean input (m - 1, 1) of the arm's drive in each step."""
    drives = record(run, rig).setup.torques
    if drives is None or drives.on_arm is None:
        return np.zeros((len(steps) - 1, 1))
    return (drives.arm_means(steps) / drive_gain(rig).value)[:, None]

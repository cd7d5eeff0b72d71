"""Replay recordings in the program of an export, from fitted initial states.

A recording with a moving arm is replayed by segments.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.errors import RunError
from dpr_lab.exports import FORMATS
from dpr_lab.exports.programs import REPLAY, Replay
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.compare import follow, free_run_from
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.engine import engine_constants, engine_values
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig
from dpr_lab.run import Run


def release(run: Run, rig: Rig, model: Model, until: float | None = None) -> Replay:
    """Fit the initial state of a run, and simulate the run with a model.

    The simulation ends at `until`, s since the release. If `until` is None, it ends at the predictability horizon, but
    after at most `REPLAY.length_s`.
    """
    followed = follow(run, rig, model)
    first = float(followed.preprocessed.run.t[0])
    freely = free_run_from(followed, first)
    end = min(freely.horizon_s, first + REPLAY.length_s) if until is None else until
    stride = max(1, round(followed.preprocessed.run.rate_hz / REPLAY.rate_hz))
    samples = np.flatnonzero(freely.t <= end)[::stride]
    start = segment_start(first) if model.effects else first
    steps = REPLAY.steps(start, end)
    drives = followed.preprocessed.run.setup.torques
    pushed = np.zeros((len(steps), 2)) if drives is None else drives.mean_before(steps)
    measured = followed.preprocessed.run.theta[samples, 1:]
    if followed.preprocessed.run.setup.alone:
        measured[:, 1] = np.nan
    return Replay(
        run.name,
        freely.t[samples],
        measured,
        freely.theta[samples],
        start,
        followed.estimate.initial[0],
        np.sqrt(np.diag(followed.preprocessed.noise.covariance)),
        np.stack([pushed.sum(axis=1), pushed[:, 1]], axis=1)[1:],
    )


def replays(runs: Sequence[Run], rig: Rig, model: AnyModel, like: Sequence[Replay] | None = None) -> tuple[Replay, ...]:
    """Simulate runs with a model from fitted initial states.

    If `like` is given, each simulation ends at the last time of the replay of the same run in `like`. This does not
    apply to a moving arm.

    Raises:
        RunError: a run is too short, or no initial state fits a run.
    """
    if isinstance(model, MovingArmModel):
        return tuple(swing for run in runs for swing in arm_replays(run, rig, model))
    ends = [None] * len(runs) if like is None else [float(swing.t[-1]) for swing in like]
    return tuple(release(run, rig, model, until) for run, until in zip(runs, ends, strict=True))


def replayed(name: str, model: AnyModel, rig: Rig, swings: Sequence[Replay]) -> list[Array]:
    """Replay recordings in the program of an export format.

    The result contains, for each recording, the absolute angles (n, 2) of the rods, or (n, 3) of arm and rods, rad.

    Raises:
        ConfigError: the program is not installed.
        DprError: the program failed.
    """
    export = FORMATS[name]
    with tempfile.TemporaryDirectory() as folder:
        for file, content in export.written(model, rig).items():
            (Path(folder) / file).write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        simulate = export.runs_in(Path(folder) / export.main, model, rig)
        joints = [simulate(swing) for swing in swings]
    to_rods = rig.encoders.joint_angles.to_rods
    return [np.column_stack([trajectory[:, :-2], to_rods(trajectory[:, -2:])]) for trajectory in joints]


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
    """Return the fitting problem of a run with the constants of a model, and estimated initial states.

    The initial states (segments, 6) are estimated from the readings: theta1, theta2, their speeds, theta0, its speed.

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
    """Simulate a recording with a moving arm by segments with fitted initial states.

    The result contains at most `ARM_REPLAY.segments` segments. See `follow_with_arm` for the errors.
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

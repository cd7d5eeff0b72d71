"""Replay recordings in the program of an export, from fitted initial states."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.exports import FORMATS
from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.moving_arm.replay import arm_replays
from dpr_lab.exports.programs import REPLAY, Replay
from dpr_lab.identification.compare import follow, free_run_from
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig
from dpr_lab.run import Run


def release(run: Run, rig: Rig, model: Model, until: float | None = None) -> Replay:
    """Fit an initial state and simulate the release up to `until`.

    The default is the predictability horizon.
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
    """Simulate runs with a model at the times of other replays, `like`.

    Raises:
        RunError: a run is too short, or no initial state fits a run.
    """
    if isinstance(model, MovingArmModel):
        return tuple(swing for run in runs for swing in arm_replays(run, rig, model))
    ends = [None] * len(runs) if like is None else [float(swing.t[-1]) for swing in like]
    return tuple(release(run, rig, model, until) for run, until in zip(runs, ends, strict=True))


def replayed(name: str, model: AnyModel, rig: Rig, swings: Sequence[Replay]) -> list[Array]:
    """Replay recordings in the program of a format.

    The result contains, for each recording, the angles (n, 2) of the rods or (n, 3) of arm and rods, rad.

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

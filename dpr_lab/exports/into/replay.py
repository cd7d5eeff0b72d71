"""Replay recordings in MuJoCo with the numbers of the user's file.

An MJCF file that has no joints other than those of the rods and of a moving arm is simulated directly with its own
integrator. The time step is at most 0.5 ms, so that integration errors are negligible. For all other files, equivalent
bodies with the numbers of the file are simulated. All further joints are fixed at zero. One reason is that MuJoCo
cannot read SDFormat.

Recordings of a moving arm are replayed in segments of 1 s. The recorded input of the drive acts as a torque on the arm.
"""

import runpy
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError
from dpr_lab.exports.into.target import PatchedModel
from dpr_lab.exports.mjcf import CALLBACK
from dpr_lab.exports.programs import Replay
from dpr_lab.exports.replay import replays
from dpr_lab.exports.xml import rendered
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.simulator_models.mjcf import compile_mjcf


@dataclass(frozen=True, slots=True)
class FileReplay:
    """Rms errors of the replays of one recording, up to the predictability horizon, rad.

    The errors are taken over both rods. For a moving arm, they are taken over arm and rods, in segments of 1 s with
    fitted initial states.
    """

    run: str
    """Name of the recording."""
    until_s: float
    """Predictability horizon, s since the release; for a moving arm, the end of the last segment."""
    before_rad: float
    """Error with the user's file, rad."""
    after_rad: float
    """Error with the changed file, rad. Its difference from `lab_rad` is caused by the format."""
    lab_rad: float
    """Error of the corrected model, simulated by dpr-lab, rad."""
    passive_rad: float | None = None
    """Error with the changed file and the module of passive forces, rad; null without this module."""


def replay_files(
    before: Path, after: PatchedModel, joints: Sequence[str], model: AnyModel, rig: Rig, runs: Sequence[Run]
) -> list[FileReplay]:
    """Replay recordings with the user's file and with the changed file.

    Args:
        before: the user's file
        after: the changed file
        joints: joints of the rods, and of a moving arm
        model: the corrected model, which determines initial states and horizons
        rig: rig of the model
        runs: the recordings

    Raises:
        ConfigError: MuJoCo is not installed, or cannot simulate a file.
        RunError: the model cannot follow a recording.
    """
    moving = isinstance(model, MovingArmModel)
    unit = drive_gain(rig).value if moving else 1.0  # torque per recorded input in the user's file
    file, patched = (Simulation.of(before, text, joints, rig.g, moving) for text in (None, after.text))
    gain = unit * patched.gear / file.gear  # the known torques were computed with the gear of the user's file
    forced = patched.with_module(after.passive.module, rig, gain) if after.passive.module else None
    file_replays = []
    for run in runs:
        swings = replays([run], rig, model)
        simulated = [
            [swing.simulated for swing in swings],
            [file.angles(swing, unit) for swing in swings],
            [patched.angles(swing, gain) for swing in swings],
            *([[forced(swing) for swing in swings]] if forced else []),
        ]
        lab, *errors = (_rms(swings, angles) for angles in simulated)
        passive = errors[2] if forced else None
        file_replays.append(FileReplay(swings[0].run, float(swings[-1].t[-1]), errors[0], errors[1], lab, passive))
    return file_replays


def _rms(swings: Sequence[Replay], simulated: Sequence[Array]) -> float:
    """Compute the root mean square error over all segments of a recording, rad."""
    squares = [swing.error(angles) for swing, angles in zip(swings, simulated, strict=True)]
    return float(np.average(squares, weights=[np.isfinite(swing.measured).sum() for swing in swings]) ** 0.5)


@dataclass(frozen=True, slots=True)
class Simulation:
    """A file that is loaded in MuJoCo."""

    model: Any
    joints: tuple[str, ...]
    """Names of the joints: first that of a moving arm, then those of the rods."""
    zero: Array
    """(n,) angles of these joints with the rods hanging and the arm at zero, rad."""
    direction: Array
    """(n,) signs of the joints, 1 or -1."""
    gear: Array
    """Gear ratios of the motors, 1 without a motor: (2,) for the rods, or (1,) for a moving arm."""
    longest_step_s: float = 5e-4

    @classmethod
    def of(cls, path: Path, text: bytes | None, joints: Sequence[str], g: float, moving: bool = False) -> "Simulation":
        """Load the user's file, or its changed text.

        Raises:
            ConfigError: MuJoCo is not installed, or the file cannot be read.
        """
        read = read_model(path, text)
        chain = double_pendulum(read, joints, g if read.gravity is None else None)
        parts = [*([chain.arm] if moving and chain.arm else []), *chain.rods]
        names = tuple(part.joint.name for part in parts)
        zero = np.array([part.hanging for part in parts])
        direction = np.array([float(part.direction) for part in parts])
        gear = np.array([part.gear or 1.0 for part in (parts[:1] if moving else parts)])
        if read.format == "MJCF":
            model = compile_mjcf(path, text).model
            if model.nv == len(parts):
                return cls(model, names, zero, direction, gear)
        names = tuple(f"joint{number}" for number in range(1 - moving, 1 + len(chain.rods)))
        zero = np.array([*([0.0] if moving else []), np.pi, 0.0])[: len(parts)]
        return cls(
            _compiled(rendered("chain.xml", chain=chain, arm=chain.arm if moving else None, pi=np.pi)),
            names,
            zero,
            np.ones(len(parts)),
            gear,
        )

    def angles(self, swing: Replay, gain: Array | float = 1.0) -> Array:
        """Simulate a replay, and return the angles (n, 2) of the rods or (n, 3) of arm and rods, rad.

        `gain` multiplies the known torques. For a moving arm, `gain` is the torque per input of the drive.
        """
        mujoco = import_module("mujoco")
        data = mujoco.MjData(self.model)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ACTUATION)  # torques are applied directly
        step = min(float(self.model.opt.timestep), self.longest_step_s)
        self.model.opt.timestep = step
        addresses = [int(self.model.joint(name).qposadr[0]) for name in self.joints]
        count, moving = len(self.joints), len(self.gear) == 1
        hanging, to_joints = np.full(count, np.pi), np.eye(count)
        hanging[:moving] = 0.0
        if count > 1 + moving:
            to_joints[-1, -2] = -1.0
        theta, omega = (half[:count] for half in np.split(swing.x0, 2))
        data.qpos[addresses] = self.zero + self.direction * (to_joints @ (theta - hanging))
        data.qvel[addresses] = self.direction * (to_joints @ omega)
        n = int(np.ceil((swing.t[-1] - swing.start) / step)) + 1
        path, driven = np.empty((n + 1, count)), addresses[: len(self.gear)]
        for i in range(n + 1):
            path[i] = data.qpos[addresses]
            torques = gain * np.array(swing.driven(swing.start + i * step, None))
            data.qfrc_applied[driven] = self.direction[: len(driven)] * torques
            mujoco.mj_step(self.model, data)
        rods = hanging + (self.direction * (path - self.zero)) @ np.linalg.inv(to_joints).T
        times = swing.start + step * np.arange(n + 1)
        angles = [np.interp(swing.t, times, column) for column in rods.T]
        # without a rod on joint 2, theta2 = theta1
        return np.column_stack([*angles, *(angles[-1:] if count == 1 + moving else [])])

    def with_module(self, module: str, rig: Rig, gain: Array) -> Callable[[Replay], Array]:
        """Return a function that simulates as `angles` does, with the passive forces of a module."""
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / CALLBACK).write_text(module, encoding="utf-8")
            names = runpy.run_path(str(Path(folder) / CALLBACK))
        kind, readings = names["EngineSwing"], names["readings"]
        kind.compiled = self.model
        upright = np.pi - self.direction[0] * self.zero[0], -self.direction[1] * self.zero[1]
        joints = zip(self.joints, upright, self.direction.tolist(), strict=True)
        readings.__globals__.update(JOINTS=dict(enumerate(joints, 1)))

        def angles(swing: Replay) -> Array:
            def torques(t: float, state: object) -> list[float]:
                return (gain * swing.driven(t, state)).tolist()

            read = readings(swing.x0, swing.t, start=swing.start, kind=kind, torques=torques)
            return rig.encoders.joint_angles.to_rods(read)

        return angles


def _compiled(text: str) -> Any:
    try:
        mujoco = import_module("mujoco")
    except ModuleNotFoundError as missing:
        raise ConfigError("replaying the file needs MuJoCo: pip install 'dpr-lab[exports]'") from missing
    return mujoco.MjModel.from_xml_string(text)

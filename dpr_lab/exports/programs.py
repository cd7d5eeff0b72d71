"""Replay recordings in the programs that run an export: Python, MuJoCo and FMPy.

Each program simulates a recording from its fitted initial state.
"""

import json
import runpy
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError, DprError
from dpr_lab.exports import sdf
from dpr_lab.exports.bodies import in_words
from dpr_lab.exports.fmu import ports_of
from dpr_lab.exports.mjcf import CALLBACK, XML, mjcf, passive
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """Settings for replaying recordings."""

    length_s: float = 10.0
    """Maximum duration of a replay, s. A replay ends earlier at the predictability horizon."""
    rate_hz: float = 200.0
    """Rate at which readings are compared, Hz."""
    step_s: float = 1e-3
    """Time step of the programs, s; torques are constant during a step."""

    def steps(self, start: float, end: float) -> Array:
        """Return the instants of the steps from the start to beyond the end, s."""
        return start + self.step_s * np.arange(np.ceil((end - start) / self.step_s) + 2)


REPLAY = ReplaySettings()


@dataclass(frozen=True, slots=True)
class Replay:
    """A recording and its fitted initial state, which are replayed in a program."""

    run: str
    t: Array
    """(n,) times since the release, s."""
    measured: Array
    """(n, 2) measured theta1 and theta2, rad; (n, 3) theta0, theta1 and theta2 of a moving arm, nan without a
    reading."""
    simulated: Array
    """Angles simulated by dpr-lab, in the shape of `measured`, rad."""
    start: float
    """Start of the simulation, s since the release."""
    x0: Array
    """(4,) initial angles and speeds; (6,) of a moving arm."""
    noise_rad: Array
    """(2,) or (3,) standard deviation of the noise of a reading, rad."""
    torques: Array
    """(m, 2) mean known torques of joints 1 and 2 in each step from the start, N m; zero without drives. For a moving
    arm, (m, 1) mean inputs of its drive."""

    @property
    def lab(self) -> float:
        """Mean square error of the simulation by dpr-lab, rad^2."""
        return self.error(self.simulated)

    def driven(self, t: float, state: object) -> list[float]:
        """Return the input at time t: torques of both joints, N m, or the arm's input."""
        step = int((t - self.start) / REPLAY.step_s + 1e-6)  # a program may use shorter steps
        return self.torques[min(step, len(self.torques) - 1)].tolist()

    def error(self, theta: Array) -> float:
        """Compute the mean square error of simulated angles, rad^2."""
        away = (self.measured - theta)[np.isfinite(self.measured)]
        return float(np.mean(away**2))


Simulator = Callable[[Replay], Array]
"""Function that simulates a swing in a program. It returns the angles (n, 2) of joints 1 and 2 at the times of the
swing, as the encoders of the rig measure them, or (n, 3) including the arm, rad."""

Program = Callable[[Path, AnyModel, Rig], Simulator]
"""Function of the main exported file, its model and its rig that returns the simulator of this program."""


def in_python(file: Path, model: AnyModel, rig: Rig) -> Simulator:
    """Return a function that replays recordings in the generated Python module.

    The module is executed in this process.
    """
    readings = runpy.run_path(str(file))["readings"]
    return lambda replay: readings(replay.x0, replay.t, start=replay.start, torques=replay.driven)


def in_mujoco(file: Path, model: AnyModel, rig: Rig) -> Simulator:
    """Return a function that replays recordings in MuJoCo with the generated callback of passive forces."""
    return _engine(file, {})


def in_urdf(file: Path, model: AnyModel, rig: Rig) -> Simulator:
    """Return a function that replays recordings in MuJoCo, which can read URDF."""
    file.with_name(CALLBACK).write_text(passive(model, rig), encoding="utf-8")
    return _engine(file, {"passive": None, "GRAVITY": model.rig.g})


def in_sdf(file: Path, model: AnyModel, rig: Rig) -> Simulator:
    """Return a function that replays recordings in MuJoCo with the numbers of the file.

    MuJoCo cannot read SDFormat. Drake reads SDFormat but ignores Coulomb friction.
    """
    expressed = in_words(model, rig, sdf.WORDS)
    held = model.model_copy(update={"effects": {name: model.effects[name] for name in expressed}})
    file.with_name(XML).write_text(mjcf(held, rig), encoding="utf-8")
    file.with_name(CALLBACK).write_text(passive(model, rig), encoding="utf-8")
    return _engine(file.with_name(XML), {"passive": None})


def _engine(file: Path, other: Mapping[str, Any]) -> Simulator:
    try:
        names = runpy.run_path(str(file.with_name(CALLBACK)))
    except ModuleNotFoundError as missing:
        raise ConfigError("a replay in MuJoCo requires the package mujoco: pip install 'dpr-lab[exports]'") from missing
    kind, readings = names["EngineSwing"], names["readings"]
    kind.file = str(file)
    readings.__globals__.update(other)

    def simulate(replay: Replay) -> Array:
        try:
            return readings(replay.x0, replay.t, start=replay.start, kind=kind, torques=replay.driven)
        except ValueError as error:
            raise ConfigError(f"MuJoCo refuses {file.name} of {replay.run}: {error}") from error

    return simulate


_FMU = """
import json, os, sys
import fmpy, numpy as np
swing = json.load(sys.stdin)
drives = np.array(list(map(tuple, swing["drives"])), [(name, float) for name in ("time", *swing["inputs"])])
starts, encoders = swing["starts"], swing["encoders"]
done = fmpy.simulate_fmu(
    swing["file"], start_time=swing["start"], stop_time=swing["t"][-1] + 1e-3, step_size=1e-3, output_interval=1e-3,
    output=encoders, input=drives, start_values=dict(zip(starts, swing["x0"])),
)
print(json.dumps([np.interp(swing["t"], done["time"], done[name]).tolist() for name in encoders]), flush=True)
os._exit(0)  # a unit that embeds Python is not unloaded cleanly from a Python process
"""


def in_fmu(file: Path, model: AnyModel, rig: Rig) -> Simulator:
    """Return a function that replays recordings in FMPy, in a separate process."""

    def read(replay: Replay) -> Array:
        steps = replay.start + REPLAY.step_s * np.arange(len(replay.torques))
        swing = {"file": str(file), "start": replay.start, "t": replay.t.tolist(), "x0": replay.x0.tolist()}
        swing["drives"] = np.column_stack([steps, replay.torques]).tolist()
        ports = ports_of(model)
        swing |= {"inputs": ports.inputs, "starts": ports.starts, "encoders": ports.encoders}
        done = subprocess.run(
            [sys.executable, "-c", _FMU], input=json.dumps(swing), capture_output=True, text=True, cwd=file.parent
        )
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:] or ["it printed no message"]
            raise DprError(f"the FMU did not run in FMPy (pip install 'dpr-lab[exports]'): {last[0]}")
        return np.array(json.loads(done.stdout.splitlines()[-1])).T

    return read

"""Recordings replayed where an export runs: Python, MuJoCo, an FMU; from the start state that the lab fitted."""

import json
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.errors import ConfigError, DprError
from dpr_lab.exports import FORMATS
from dpr_lab.exports.bodies import in_words
from dpr_lab.exports.mjcf import CALLBACK, XML, mjcf, passive
from dpr_lab.identification.compare import follow, free_run_from
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """How a recording is replayed."""

    length_s: float = 10.0
    """At most; less where the swing cannot be predicted so far."""
    rate_hz: float = 200.0
    """At which readings are compared."""
    step_s: float = 1e-3
    """Of the programs, through which torques are held."""


REPLAY = ReplaySettings()


@dataclass(frozen=True, slots=True)
class Replay:
    """One recording and a model's start in it."""

    run: str
    t: Array
    """(n,) since the release, s."""
    measured: Array
    """(n, 2) theta1, theta2, rad."""
    simulated: Array
    """(n, 2) by the lab, rad."""
    start: float
    """Of the simulation, s since the release."""
    x0: Array
    """(4,) the state there."""
    noise_rad: Array
    """(2,) noise floor."""
    torques: Array
    """(m, 2) mean known torques of joints 1 and 2 through each step from the start on, N m; zero without drives."""

    @property
    def lab(self) -> float:
        """Mean square of what the lab's simulation is off, rad^2."""
        return float(np.mean((self.measured - self.simulated) ** 2))

    def driven(self, t: float, state: object) -> list[float]:
        """Torques of joints 1 and 2 through the step that begins then, N m."""
        return self.torques[min(round((t - self.start) / REPLAY.step_s), len(self.torques) - 1)].tolist()

    def off(self, theta: Array) -> float:
        """The same of another simulation."""
        return float(np.mean((self.measured - theta) ** 2))


def release(run: Run, rig: Rig, model: Model, until: float | None = None, settings: ReplaySettings = REPLAY) -> Replay:
    """Fit a start state and simulate, until an instant or as far as the swing can be predicted."""
    followed = follow(run, rig, model)
    first = float(followed.preprocessed.run.t[0])
    freely = free_run_from(followed, first)
    end = min(freely.horizon_s, first + settings.length_s) if until is None else until
    apart = max(1, round(followed.preprocessed.run.rate_hz / settings.rate_hz))
    some = np.flatnonzero(freely.t <= end)[::apart]
    start = segment_start(first) if model.effects else first
    steps = start + settings.step_s * np.arange(np.ceil((end - start) / settings.step_s) + 2)
    drives = followed.preprocessed.run.setup.torques
    pushed = np.zeros((len(steps), 2)) if drives is None else drives.mean_before(steps)
    return Replay(
        run.name,
        freely.t[some],
        followed.preprocessed.run.theta[some, 1:],
        freely.theta[some],
        start,
        followed.estimate.initial[0],
        np.sqrt(np.diag(followed.preprocessed.noise.covariance)),
        np.stack([pushed.sum(axis=1), pushed[:, 1]], axis=1)[1:],
    )


def replayed(name: str, model: Model, rig: Rig, swings: Sequence[Replay]) -> list[Array]:
    """(n, 2) rods' angles of each swing, rad, in the program of a format.

    Raises:
        ConfigError: what runs it is not installed.
        DprError: it did not run.
    """
    with tempfile.TemporaryDirectory() as folder:
        for file, content in FORMATS[name].written(model, rig).items():
            (Path(folder) / file).write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        read = _PROGRAMS[name](Path(folder) / FORMATS[name].main, model, rig)
        return [rig.encoders.joint_angles.to_rods(read(item)) for item in swings]


Program = Callable[[Path, Model, Rig], Callable[[Replay], Array]]
"""Of the file that it reads first, what is written there, and its rig."""


def _python(file: Path, model: Model, rig: Rig) -> Callable[[Replay], Array]:
    readings = runpy.run_path(str(file))["readings"]
    return lambda item: readings(item.x0, item.t, start=item.start, torques=item.driven)


def _mujoco(file: Path, model: Model, rig: Rig) -> Callable[[Replay], Array]:
    return _engine(file, {})


def _urdf(file: Path, model: Model, rig: Rig) -> Callable[[Replay], Array]:
    file.with_name(CALLBACK).write_text(passive(model, rig), encoding="utf-8")
    return _engine(file, {"passive": None, "GRAVITY": model.rig.g, "FIRST": 0})


def _sdf(file: Path, model: Model, rig: Rig) -> Callable[[Replay], Array]:
    """What the file holds, in MuJoCo: Drake, which reads the file itself, leaves dry friction out."""
    expressed = in_words(model, rig, FORMATS["sdf"].words)
    held = model.model_copy(update={"effects": {name: model.effects[name] for name in expressed}})
    file.with_name(XML).write_text(mjcf(held, rig), encoding="utf-8")
    file.with_name(CALLBACK).write_text(passive(model, rig), encoding="utf-8")
    return _engine(file.with_name(XML), {"passive": None, "FIRST": 0})


def _engine(file: Path, other: Mapping[str, Any]) -> Callable[[Replay], Array]:
    try:
        names = runpy.run_path(str(file.with_name(CALLBACK)))
    except ModuleNotFoundError as missing:
        raise ConfigError("replaying in MuJoCo needs it installed: pip install dpr-lab[exports]") from missing
    kind, readings = names["EngineSwing"], names["readings"]
    kind.file = str(file)
    readings.__globals__.update(other)
    return lambda item: readings(item.x0, item.t, start=item.start, kind=kind, torques=item.driven)


_FMU = """
import json, os, sys
import fmpy, numpy as np
swing = json.load(sys.stdin)
drives = np.array(list(map(tuple, swing["drives"])), [(name, float) for name in ("time", "torque1", "torque2")])
starts, encoders = ("theta1_start", "theta2_start", "omega1_start", "omega2_start"), ("encoder1", "encoder2")
done = fmpy.simulate_fmu(
    swing["file"], start_time=swing["start"], stop_time=swing["t"][-1] + 1e-3, step_size=1e-3, output_interval=1e-3,
    output=encoders, input=drives, start_values=dict(zip(starts, swing["x0"])),
)
print(json.dumps([np.interp(swing["t"], done["time"], done[name]).tolist() for name in encoders]), flush=True)
os._exit(0)  # a unit that embeds Python is not unloaded cleanly from a Python process
"""


def _fmu(file: Path, model: Model, rig: Rig) -> Callable[[Replay], Array]:
    def read(item: Replay) -> Array:
        steps = item.start + REPLAY.step_s * np.arange(len(item.torques))
        swing = {"file": str(file), "start": item.start, "t": item.t.tolist(), "x0": item.x0.tolist()}
        swing["drives"] = np.column_stack([steps, item.torques]).tolist()
        done = subprocess.run(
            [sys.executable, "-c", _FMU], input=json.dumps(swing), capture_output=True, text=True, cwd=file.parent
        )
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:] or ["it printed nothing"]
            raise DprError(f"the FMU did not run in FMPy (pip install dpr-lab[exports]): {last[0]}")
        return np.array(json.loads(done.stdout.splitlines()[-1])).T

    return read


_PROGRAMS: Mapping[str, Program] = {
    "python": _python,
    "mjcf": _mujoco,
    "urdf": _urdf,
    "sdf": _sdf,
    "fmu": _fmu,
    "fmu2": _fmu,
}

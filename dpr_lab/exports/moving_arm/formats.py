"""Formats of a model with a moving arm, and the programs that replay recordings with the written files."""

import json
import runpy
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.exports.moving_arm import xml_files
from dpr_lab.exports.moving_arm.bodies import arm_bodies
from dpr_lab.exports.moving_arm.fmu import fmu
from dpr_lab.exports.moving_arm.python_module import python_module
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig

Array = NDArray[np.float64]

Replay = Callable[[Array, Array, Array], Array]
"""(6,) initial state, (n,) instants (s) and (n,) inputs held until the next -> (n, 3) absolute angles, rad."""


@dataclass(frozen=True, slots=True)
class ArmFormat:
    """One export format."""

    program: str
    """Name of the program."""
    main: str
    """Name of the file."""
    content: Callable[[MovingArmModel, Rig], str | bytes]
    """Content of the file."""
    replay: Callable[[Path, MovingArmModel, Rig], Replay]
    """Program with the file loaded."""


def _xml(write: Callable[..., str]) -> Callable[[MovingArmModel, Rig], str]:
    return lambda model, rig: write(arm_bodies(model, rig), model.rig.name, model.input, model.scale_sentence)


def _in_python(file: Path, model: MovingArmModel, rig: Rig) -> Replay:
    simulate = runpy.run_path(str(file))["simulate"]
    return lambda x0, t, inputs: simulate(x0, t, inputs)[:, :3]


def _in_mujoco(file: Path, model: MovingArmModel, rig: Rig) -> Replay:
    """MuJoCo, which reads MJCF and URDF; URDF has no actuator, and the torque is then applied to the joint."""
    try:
        mujoco: Any = import_module("mujoco")
    except ModuleNotFoundError as missing:
        raise ConfigError("replaying in MuJoCo needs it installed: pip install dpr-lab[exports]") from missing
    engine = mujoco.MjModel.from_xml_path(str(file))
    engine.opt.gravity[:] = 0.0, 0.0, -model.rig.g
    engine.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    gain, outer = arm_bodies(model, rig).gain, model.mounted == "both"

    def replay(x0: Array, t: Array, inputs: Array) -> Array:
        data = mujoco.MjData(engine)
        data.qpos[:2], data.qvel[:2] = x0[:2], x0[3:5]
        if outer:
            data.qpos[2], data.qvel[2] = x0[2] - x0[1], x0[5] - x0[4]
        theta = np.zeros((len(t), 3))
        for i in range(len(t)):
            theta[i, :2] = data.qpos[:2]
            theta[i, 2] = data.qpos[1] + data.qpos[2] if outer else 0.0
            if i + 1 < len(t):
                count = max(1, int(np.ceil((t[i + 1] - t[i]) / 5e-4 - 1e-9)))
                engine.opt.timestep = (t[i + 1] - t[i]) / count
                if engine.nu:
                    data.ctrl[0] = inputs[i]
                else:
                    data.qfrc_applied[0] = gain * inputs[i]
                mujoco.mj_step(engine, data, count)
        return theta

    return replay


def _in_sdf(file: Path, model: MovingArmModel, rig: Rig) -> Replay:
    """Replay in MuJoCo with the same bodies, because no simulator from PyPI reads all of SDFormat."""
    same = file.with_name("same_bodies.xml")
    same.write_text(_xml(xml_files.mjcf)(model, rig), encoding="utf-8")
    return _in_mujoco(same, model, rig)


_FMU = """
import json, os, sys
import fmpy, numpy as np
swing = json.load(sys.stdin)
ends = zip(np.subtract(swing["t"][1:], 1e-7), swing["inputs"])  # each value is held until the next
rows = sorted([*zip(swing["t"], swing["inputs"]), *ends])
drive = np.array(rows, [("time", float), ("drive", float)])
angles = ("theta0", "theta1", "theta2")
names = [f"{name}_start" for name in ("theta0", "theta1", "theta2", "omega0", "omega1", "omega2")]
step = swing["step"]
done = fmpy.simulate_fmu(
    swing["file"], start_time=swing["t"][0], stop_time=swing["t"][-1] + step, step_size=step, output_interval=step,
    output=angles, input=drive, start_values=dict(zip(names, swing["x0"])),
)
print(json.dumps([np.interp(swing["t"], done["time"], done[name]).tolist() for name in angles]), flush=True)
os._exit(0)  # a unit that embeds Python is not unloaded cleanly from a Python process
"""


def _in_fmu(file: Path, model: MovingArmModel, rig: Rig) -> Replay:
    """FMPy, in a separate process; its steps are at most as long as the shortest interval of the recording."""

    def replay(x0: Array, t: Array, inputs: Array) -> Array:
        since = t - t[0]
        swing = {"file": str(file), "t": since.tolist(), "inputs": inputs.tolist(), "x0": x0.tolist()}
        swing["step"] = min(1e-3, float(np.diff(t).min()))
        done = subprocess.run(
            [sys.executable, "-c", _FMU], input=json.dumps(swing), capture_output=True, text=True, cwd=file.parent
        )
        if done.returncode:
            last = done.stderr.strip().splitlines()[-1:] or ["it printed nothing"]
            raise DprError(f"the FMU did not run in FMPy (pip install dpr-lab[exports]): {last[0]}")
        return np.array(json.loads(done.stdout.splitlines()[-1])).T

    return replay


ARM_FORMATS: dict[str, ArmFormat] = {
    "python": ArmFormat("Python", "corrected_model.py", lambda model, rig: python_module(model), _in_python),
    "mjcf": ArmFormat("MuJoCo", "corrected_model.xml", _xml(xml_files.mjcf), _in_mujoco),
    "urdf": ArmFormat("URDF", "corrected_model.urdf", _xml(xml_files.urdf), _in_mujoco),
    "sdf": ArmFormat("SDFormat", "corrected_model.sdf", _xml(xml_files.sdf), _in_sdf),
    "fmu": ArmFormat("FMI 3", "corrected_model.fmu", lambda model, rig: fmu(model), _in_fmu),
    "fmu2": ArmFormat("FMI 2", "corrected_model_fmi2.fmu", lambda model, rig: fmu(model, "2.0"), _in_fmu),
}
"""Name of a format -> its definition; the names are those of `dpr_lab.exports.FORMATS`."""

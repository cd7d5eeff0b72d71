"""MJCF models with one planted error, and recordings of the true model in MuJoCo, or in Drake for SDFormat."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import import_module

import mujoco
import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]

ROBOT = """<mujoco model="own">
  <!-- drawn > weighed: "keep" me -->
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" damping="0.002"/>
      <inertial pos="0 0 -0.12" mass="0.3" diaginertia="0.002 0.0021 0.0005"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" damping="0.001"/>
        <inertial pos="0 0 -0.125" mass="0.15" diaginertia="0.0008 0.0008 0.00002"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
COUNTS = 16384 / (2 * np.pi)
STARTS = ((np.pi / 2, np.pi / 3), (2.0, 2.6), (np.pi - 1.2, np.pi + 0.8))
"""Absolute angles of the rods at the releases, rad."""
HELD_OUT = (np.pi - 1.5, np.pi - 0.4)
SHOULDER, ELBOW = 'damping="0.002"', 'damping="0.001"'


@dataclass(frozen=True, slots=True)
class Planted:
    """Planted error: the value in the file and the true value."""

    wrong: str
    right: str
    cause: str
    """Quantity of the first cause."""
    joint: str
    before: str = ROBOT
    """The file. The true model contains `right` instead of `wrong`."""

    @property
    def truth(self) -> str:
        """The true model, which is recorded."""
        assert self.before.count(self.wrong) == 1
        return self.before.replace(self.wrong, self.right)


PLANTED = {
    "frictionloss missing": Planted(ELBOW, ELBOW + ' frictionloss="0.004"', "Coulomb friction", "elbow"),
    "frictionloss missing, shoulder": Planted(
        SHOULDER, SHOULDER + ' frictionloss="0.006"', "Coulomb friction", "shoulder"
    ),
    "frictionloss wrong": Planted(
        'frictionloss="0.002"',
        'frictionloss="0.006"',
        "Coulomb friction",
        "elbow",
        ROBOT.replace(ELBOW, ELBOW + ' frictionloss="0.002"'),
    ),
    "armature missing": Planted(ELBOW, ELBOW + ' armature="0.0004"', "rotor inertia (armature)", "elbow"),
    "damping wrong": Planted(SHOULDER, 'damping="0.005"', "damping", "shoulder"),
    "damping wrong, elbow": Planted(ELBOW, 'damping="0.0004"', "damping", "elbow"),
    "spring missing": Planted(SHOULDER, SHOULDER + ' stiffness="0.08"', "spring stiffness", "shoulder"),
    "inertial frame shifted": Planted(
        'pos="0 0 -0.125"', 'pos="0 0 -0.135"', "centre of mass of the body along the rod", "elbow"
    ),
    "inertial frame shifted, upper": Planted(
        'pos="0 0 -0.12"', 'pos="0 0 -0.13"', "centre of mass of the body along the rod", "shoulder"
    ),
    "rod too short": Planted('pos="0 0 -0.3"', 'pos="0 0 -0.315"', "error of length L1 or gravity", "shoulder"),
}

SOFTENED = "frictionloss missing, shoulder"
"""Case in which Stribeck friction remains an alternative, because MuJoCo softens Coulomb friction (`solref`, `solimp`).
"""


def swing(
    text: str, rig: Rig, start: tuple[float, float], t: Array, step: float = 2.5e-4, controls: Array | None = None
) -> Array:
    """Absolute angles (n, 2) of the rods after a release, rad.

    The inputs `controls` (n, 2) are held between instants.
    """
    if text.startswith("<sdf"):
        return swing_in_drake(text, rig, start, t)
    model = mujoco.MjModel.from_xml_string(text)  # type: ignore[attr-defined]
    model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_RK4  # type: ignore[attr-defined]
    data = mujoco.MjData(model)  # type: ignore[attr-defined]
    data.qpos[:] = rig.positions([0.0, *start])[1:] / COUNTS
    angles = []
    for i in range(len(t)):
        angles.append(rig.theta([0.0, *(data.qpos * COUNTS)])[1:])
        if controls is not None:
            data.ctrl[:] = controls[i]
        mujoco.mj_step(model, data, round((t[1] - t[0]) / step))  # type: ignore[attr-defined]
    return np.array(angles)


def swing_in_drake(text: str, rig: Rig, start: tuple[float, float], t: Array) -> Array:
    """The same simulation in Drake, which reads SDFormat but ignores its Coulomb friction."""
    plant = import_module("pydrake.multibody.plant").MultibodyPlant(0.0)
    import_module("pydrake.multibody.parsing").Parser(plant).AddModelsFromString(text, "sdf")
    plant.Finalize()
    simulator = import_module("pydrake.systems.analysis").Simulator(plant)
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    context = simulator.get_mutable_context()
    plant.SetPositions(context, rig.positions([0.0, *start])[1:] / COUNTS)
    angles = []
    for instant in t - t[0]:
        simulator.AdvanceTo(instant)
        angles.append(rig.theta([0.0, *(plant.GetPositions(context) * COUNTS)])[1:])
    return np.array(angles)


def controls(seed: int, t: Array) -> Array:
    """Sums of sines (n, 2) for the motors of shoulder and elbow, with gears of about 10 and 5; zero before t = 0."""
    rng = np.random.default_rng([29, seed])
    hz, phase = rng.uniform(0.3, 3.0, (3, 2)), rng.uniform(0, 2 * np.pi, (3, 2))
    waves = np.sin(2 * np.pi * hz * t[:, None, None] + phase).sum(axis=1)
    return np.where(t[:, None] >= 0, waves * [0.012, 0.006], 0.0)


def recordings(
    text: str,
    rig: Rig,
    seconds: float = 10.0,
    rate_hz: int = 200,
    gears: Sequence[float] | None = None,
    starts: Sequence[tuple[float, float]] = STARTS,
) -> list[Run]:
    """Record a release from each start with 14-bit encoders. If `gears` of the file are given, torques act."""
    runs = []
    for number, start in enumerate(starts):
        rng = np.random.default_rng(number)
        t = np.arange(-rate_hz, round(seconds * rate_hz) + 1) / rate_hz
        theta = np.zeros((len(t), 3))
        theta[t < 0, 1:] = start
        inputs = controls(number, t)
        theta[t >= 0, 1:] = swing(text, rig, start, t[t >= 0], controls=None if gears is None else inputs[t >= 0])
        counts = np.rint(rig.positions(theta) + rng.normal(0, 0.3, theta.shape)).astype(np.int64)
        run = Run(f"r{number}", t, rig.theta(counts), counts, None, rig.name, "", rate_hz)
        runs.append(run if gears is None else replace(run, torques=inputs * gears, torque_kind="commanded"))
    return runs


def held_out_error(text: str, truth: str, rig: Rig) -> float:
    """Root mean square difference of free runs of 3 s from a pose that was not recorded, rad."""
    t = np.arange(0, 3, 0.005)
    return float(np.sqrt(np.mean((swing(text, rig, HELD_OUT, t) - swing(truth, rig, HELD_OUT, t)) ** 2)))

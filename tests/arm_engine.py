"""Rigs with a moving arm and one fault, in MuJoCo or by scipy: no code is shared with the package's dynamics.

Faults are those of section 3 of docs/theory.md at joint 0 and of the drive: `FAULTS` maps the name of an effect to what
draws its size. With backlash of the arm's gear the motor is a body of its own, with a share of the arm's inertia and
all of its viscous friction; the gear is a tendon with limits, and the encoder reads the motor.
"""

from dataclasses import dataclass, field

import numpy as np

from dpr_lab.rig import Rig
from dpr_lab.run import Run

COUNT = 2 * np.pi / 8192
"""Step of the simulated encoders, rad. Their noise is a third of the step."""

MODEL = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.0005" gravity="0 0 {g!r}" integrator="RK4" iterations="50" tolerance="1e-12"/>
  <default><joint solreffriction="0.001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"/></default>
  <worldbody><body>
    <joint name="arm" type="hinge" axis="0 0 1" damping="{own0!r}" stiffness="{k0!r}" springref="{q0!r}"
      frictionloss="{f0!r}" limited="true" range="-1000 {stop!r}" solreflimit="0.002 1"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="{J0!r} {J0!r} {J0!r}"/>
    <body pos="{L0!r} 0 0">
      <joint type="hinge" axis="-1 0 0" damping="{c1!r}" frictionloss="{f1!r}"/>
      <inertial pos="0 0 {l1!r}" mass="{m1!r}" diaginertia="{J1!r} {J1!r} 1e-12"/>
      {outer}
    </body>
  </body>
  {motor}</worldbody>
  {gear}
</mujoco>
"""

MOTOR = """<body>
    <joint name="motor" type="hinge" axis="0 0 1" damping="{c0!r}"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="{Jr!r} {Jr!r} {Jr!r}"/>
  </body>
"""

GEAR = """
  <tendon>
    <fixed limited="true" range="{low!r} {high!r}" solreflimit="0.001 1" solimplimit="0.9999 0.9999 0.001 0.5 2">
      <joint joint="motor" coef="1"/><joint joint="arm" coef="-1"/>
    </fixed>
  </tendon>
"""

OUTER = """
      <body pos="0 0 {L1!r}">
        <inertial pos="0 0 0" mass="{mb!r}" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
      <body pos="0 0 {L1!r}">
        <joint type="hinge" axis="-1 0 0" damping="{c2!r}" frictionloss="{f2!r}"/>
        <inertial pos="0 0 {l2!r}" mass="{m2!r}" diaginertia="{J2!r} {J2!r} 1e-12"/>
      </body>
"""


@dataclass(frozen=True)
class Plant:
    """Rig with an arm and its fault, in SI units."""

    rods: dict[str, float]
    """Parameters l1, m1, c1, J1 and, for two rods, l2, m2, mb, c2, J2."""
    J0: float
    c0: float
    L0: float
    L1: float
    g: float = 9.81
    gain: float = 1.0
    """Ratio of torque to input."""
    fault: str = ""
    size: dict[str, float] = field(default_factory=dict)
    rotor: float = 0.01
    """Ratio of the inertia of a motor behind backlash to J0. It is added to J0."""
    stop: float = 1000.0
    """Largest angle of the arm, where a rigid stop holds it, rad."""

    @property
    def both(self) -> bool:
        """Whether both rods are mounted."""
        return "l2" in self.rods

    @property
    def motor_share(self) -> float:
        """Share of a motor behind backlash in the inertia of arm and motor."""
        return self.rotor * self.J0 / (self.A + self.rotor * self.J0)

    @property
    def A(self) -> float:
        """Total inertia about the arm's axis, kg m^2."""
        return self.J0 + sum(self.rods.get(name, 0.0) for name in ("m1", "m2", "mb")) * self.L0**2

    def drive(self, t: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Torque of the drive at the instants t, from the logged input u, which is held between samples."""
        own, size = self.fault, self.size
        late = size["delay_s"] if own == "input_delay" else 0.0
        torque = self.gain * u[np.clip(np.searchsorted(t, t - late + 1e-9, side="right") - 1, 0, None)]
        if own == "torque_scale_joint0":
            torque = torque * (1.0 + size["excess"])
        if own == "torque_offset_joint0":
            torque = torque + size["offset_Nm"]
        if own == "dead_zone_joint0":
            torque = torque - np.clip(torque, -size["width_Nm"], size["width_Nm"])
        if own == "saturation_joint0":
            torque = np.clip(torque, -size["limit_Nm"], size["limit_Nm"])
        return torque

    def extra(self, q: float, speed: float, torque: float) -> float:
        """Additional torque on the arm at its angle q and its speed."""
        own, size = self.fault, self.size
        if own == "detent_joint0":
            return size["peak_Nm"] * np.sin(size["order"] * q + 0.7)
        if own == "torque_ripple_joint0":
            return torque * size["share"] * np.sin(size["order"] * q + 0.4)
        if own == "hard_stop_joint0":
            return -size["stiffness"] * (max(q - size["range_rad"], 0.0) + min(q + size["range_rad"], 0.0))
        if own == "air_drag_joint0":
            return -size["coefficient"] * speed * abs(speed)
        return 0.0


def swing(plant: Plant, start: np.ndarray, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Simulate encoder angles (n, 3) of theta0, theta1, theta2 at evenly spaced instants with MuJoCo, from a state
    (6,)."""
    import mujoco

    size = plant.size if plant.fault.startswith(("coulomb", "spring")) else {}
    friction = {f"f{j}": size.get("torque_Nm", 0.0) * (plant.fault == f"coulomb_joint{j}") for j in range(3)}
    of_spring = plant.fault == "spring_joint0"
    spring = {"k0": size["stiffness"] if of_spring else 0.0, "q0": size["rest"] if of_spring else 0.0}
    values = {**plant.rods, **friction, **spring, "J0": plant.J0, "c0": plant.c0, "L0": plant.L0, "L1": plant.L1}
    values["stop"] = plant.stop
    outer = OUTER.format(**values) if plant.both else ""
    loose = plant.fault == "backlash_joint0"
    half = 0.5 * plant.size["play_rad"] if loose else 0.0
    values |= {"own0": 0.0 if loose else plant.c0, "Jr": plant.rotor * plant.J0, "low": -half, "high": half}
    parts = {"motor": MOTOR.format(**values), "gear": GEAR.format(**values)} if loose else {"motor": "", "gear": ""}
    model = mujoco.MjModel.from_xml_string(MODEL.format(**values, g=-plant.g, outer=outer, **parts))
    data, joints = mujoco.MjData(model), 3 if plant.both else 2
    data.qpos[:joints] = [start[0], start[1], start[2] - start[1]][:joints]
    data.qvel[:joints] = [start[3], start[4], start[5] - start[4]][:joints]
    driven = -1 if loose else 0
    data.qpos[driven], data.qvel[driven] = start[0], start[3]
    substeps = round((t[1] - t[0]) / model.opt.timestep)
    fine = t[0] + model.opt.timestep * np.arange(len(t) * substeps)
    held = np.repeat(u, substeps)
    torque, theta = plant.drive(fine, held), np.empty((len(t), 3))
    for i in range(len(fine)):
        if i % substeps == 0:
            q = data.qpos
            theta[i // substeps] = q[driven], q[1], q[1] + (q[2] if plant.both else 0.0)
        data.qfrc_applied[driven] = torque[i] + plant.extra(data.qpos[0], data.qvel[0], torque[i])
        mujoco.mj_step(model, data)
    return theta


def drawn_plant(rng: np.random.Generator, both: bool, fault: str, reach: float, largest: float) -> Plant:
    """Draw a plant with a fault of visible size."""
    if both:
        rods = {
            "l1": 0.2,
            "m1": 0.12,
            "c1": 4e-4,
            "J1": 1.5e-3,
            "l2": 0.15,
            "m2": 0.08,
            "mb": 0.1,
            "c2": 2e-4,
            "J2": 8e-4,
        }
        J0, c0, L0, L1 = 0.006, 0.01, 0.2, 0.3
    else:
        rods = {"l1": 0.15, "m1": 0.1, "c1": 2e-4, "J1": 8e-4}
        J0, c0, L0, L1 = 0.003, 0.004, 0.2, 0.3
    rods = {name: value * rng.uniform(0.9, 1.1) for name, value in rods.items()}
    some = rng.uniform(0.7, 1.4)
    size = {
        "coulomb_joint0": {"torque_Nm": 0.1 * some * largest},
        "coulomb_joint1": {"torque_Nm": 0.03 * some * largest},
        "spring_joint0": {"stiffness": 0.3 * some * largest / reach, "rest": float(rng.uniform(-0.3, 0.3))},
        "torque_scale_joint0": {"excess": float(rng.choice([-0.2, 0.2])) * some},
        "input_delay": {"delay_s": 0.008 * some},
        "torque_offset_joint0": {"offset_Nm": float(rng.choice([-0.1, 0.1])) * some * largest},
        "dead_zone_joint0": {"width_Nm": 0.12 * some * largest},
        "saturation_joint0": {"limit_Nm": 0.5 * some * largest},
        "detent_joint0": {"peak_Nm": 0.1 * some * largest, "order": float(rng.integers(3, 12))},
        "torque_ripple_joint0": {"share": 0.15 * some, "order": float(rng.integers(3, 12))},
        "hard_stop_joint0": {"stiffness": 3.0 * largest, "range_rad": 0.5 * some * reach},
        "encoder_scale_joint0": {"excess": 0.02 * some},
        "air_drag_joint0": {"coefficient": 0.01 * some * largest},
        "backlash_joint0": {"play_rad": 0.03 * some},
        "backlash_joint1": {"play_rad": 0.03 * some},
    }.get(fault, {})
    return Plant(rods, J0 * rng.uniform(0.8, 1.2), c0 * rng.uniform(0.7, 1.3), L0, L1, fault=fault, size=size)


def rig_of(plant: Plant, mode: str) -> Rig:
    """Rig file in which all parts are measured, with an accuracy of one per cent."""
    parameters = {name: {"nominal": v, "measured": v, "std": 0.01 * v} for name, v in plant.rods.items()}
    return Rig.model_validate(
        {
            "rig": {"name": "drawn", "L0": plant.L0, "L1": plant.L1, "g": plant.g},
            "rods": {"mounted": "both" if plant.both else "inner"},
            "parameters": parameters,
            "arm": {"mode": mode, "A": {"nominal": 1.2 * plant.A, "lower": 1e-6, "upper": 1.0}},
            **({"motor": {"input": "torque"}} if mode == "driven" else {}),
            "encoders": {"counts_per_rev": [8192, 8192, 8192], "noise_counts": 0.3},
            "poses": {"P1": {"theta1": 2.0, "theta2": 2.0}},
        }
    )


def recorded(plant: Plant, rig: Rig, mode: str, rng: np.random.Generator, seconds: float, largest: float) -> list[Run]:
    """Record three runs."""
    runs = []
    t = np.arange(0.0, seconds, 0.002)
    for k in range(3):
        rates, phases = rng.uniform(4.0, 12.0, 3), rng.uniform(0, 6.28, 3)
        u = largest / 2.5 * np.sin(np.outer(t, rates) + phases).sum(axis=1) * (mode == "driven")
        u += 0.2 * largest * (mode == "driven") * rng.choice([-1.0, 1.0], len(t) // 50 + 1)[np.arange(len(t)) // 50]
        spin = rng.uniform(-3, 3) if mode == "free" else 0.0
        start = np.array([0.0, np.pi + rng.uniform(0.8, 2), np.pi + rng.uniform(-2, 2), spin, 0.0, 0.0])
        if not plant.both:
            start[2] = start[1]
        theta = swing(plant, start, t, u)
        joints = np.column_stack([theta[:, 0], theta[:, 1], theta[:, 2] - theta[:, 1]])
        if plant.fault == "backlash_joint1":
            held = joints[0, 1]
            for i, angle in enumerate(joints[:, 1]):
                held = joints[i, 1] = np.clip(
                    held, angle - plant.size["play_rad"] / 2, angle + plant.size["play_rad"] / 2
                )
        if plant.fault == "encoder_scale_joint0":
            joints[:, 0] *= 1.0 + plant.size["excess"]
        joints = COUNT * np.round(joints / COUNT + rng.normal(0, 0.3, joints.shape))
        theta = np.column_stack([joints[:, 0], joints[:, 1], joints[:, 1] + joints[:, 2] * plant.both])
        runs.append(
            Run(
                name=f"run{k}", t=t, theta=theta, counts=None, pose=None, rig_name=rig.name, rig_sha256="",
                rate_hz=500.0, mounting=rig.rods.mounted, arm_mode=mode, arm_input=u if mode == "driven" else None,
            )
        )  # fmt: skip
    return runs

"""Convert the input of the drive of an arm to a torque on the arm.

The torque is known only up to a factor if the rig file does not determine the gain of the drive.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import prescribed_arm
from dpr_lab.identification.moving_arm.unknowns import nominal_gain, rod_inertias, scale_parameters
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.setup import Setup, Torques


@dataclass(frozen=True, slots=True)
class DriveGain:
    """Torque on the arm per unit of the input, with its uncertainty."""

    value: float
    """Gain, N m per unit of the input; arbitrary if the rig file does not determine it."""
    known: bool
    """Whether the gain follows from measured constants, or from the unit of an input that is a torque."""
    relative_std: float = 0.0
    """Relative standard deviation of the gain from measured constants."""


def drive_gain(rig: Rig) -> DriveGain:
    """Return the gain of the drive according to the rig file."""
    motor, value = rig.motor, nominal_gain(rig)
    if motor is None or value == 0.0:
        return DriveGain(float(rod_inertias(rig.nominal, rig)[1]), False)
    constants = {"current": [motor.kt], "voltage": [motor.kt, motor.R]}.get(motor.input, [])
    measured = [
        constant.std / constant.measured for constant in constants if constant and constant.std and constant.measured
    ]
    return DriveGain(value, len(measured) == len(constants), math.hypot(*measured))


def rods_measured(rig: Rig) -> bool:
    """Check whether all parameters that determine the inertia of the rods were measured."""
    return all(rig.parameters[name].std for name in scale_parameters(rig))


def setup_of(run: Run, rig: Rig) -> Setup:
    """Return the setup of a run: its mounting, known inputs, and mode of the arm.

    If an acceleration drives the arm, the torque on the arm is unknown. The encoder of the arm then gives a prescribed
    motion.

    Raises:
        RunError: the arm is driven, but the rig file does not describe the input of its motor.
    """
    if run.arm_mode == "free":
        return replace(run.setup, arm_moves=True)
    if run.arm_mode != "driven":
        return run.setup
    name = str(run.file or run.name)
    if rig.motor is None or run.arm_input is None:
        raise RunError(f"{name}: its arm is driven: the rig file needs [motor] with the input")
    if rig.motor.input == "acceleration":
        return replace(run.setup, arm=prescribed_arm(run.t, run.theta[:, 0], rig, name))
    gain = drive_gain(rig)
    torques = Torques(
        run.t + run.input_delay_s,
        np.zeros((len(run.t), 2)),
        on_arm=gain.value * run.arm_input,
        scaled=gain.known and not rods_measured(rig),
    )
    return replace(run.setup, torques=run.between_rows(torques), arm_moves=True)

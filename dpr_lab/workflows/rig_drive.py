"""Tables `[arm]` and `[motor]` of a new rig file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.rig_toml import Bounds, Measure, inline_table, toml_number

if TYPE_CHECKING:
    from dpr_lab.rig_tables import ArmMode


@dataclass(frozen=True, slots=True)
class MotorMeasures:
    """Constants of the motor at the arm."""

    input: Literal["torque", "current", "voltage", "acceleration"]
    """Quantity of the drive's input that recordings contain."""
    kt: Measure | None = None
    """Torque constant, N m/A."""
    ke: Measure | None = None
    """Back-EMF constant, V s/rad."""
    R: Measure | None = None
    """Resistance, ohm."""
    gear: float = 1.0
    """Turns of the motor per turn of the arm."""


@dataclass(frozen=True, slots=True)
class DriveBounds:
    """Bounds for values that were not measured."""

    inertia: tuple[float, float, float] = (1.0, 2.0, 30.0)
    """Lower bound, nominal value and upper bound of the arm's inertia, in units of m L0^2 of the rods at its end."""
    factor: float = 3.0
    """Ratio between the bounds and the nominal value of a quantity from a data sheet or a model."""


BOUNDS = DriveBounds()


def about(value: float) -> Bounds:
    """Bounds and nominal value for a value from a data sheet or a model."""
    return value / BOUNDS.factor, value, BOUNDS.factor * value


def arm_table(mode: "ArmMode", values: Mapping[str, Bounds], digits: int = 4) -> str:
    """Text of the table `[arm]`: the mode, and the given bounds of A, c0, k0 and f0.

    A is the inertia with the rods at the end of the arm.
    """
    lines = [f"{key} = {inline_table(bounds, digits=digits)}" for key, bounds in values.items()]
    meaning = "  # A: inertia about its axis with the rods at its end, kg m^2" if "A" in values else ""
    return "\n".join([f'[arm]{meaning}\nmode = "{mode}"', *lines, "", ""])


def motor_table(motor: MotorMeasures, digits: int = 4) -> str:
    """Text of the table `[motor]`."""
    constants = {"kt": motor.kt, "ke": motor.ke, "R": motor.R}
    lines = [f'[motor]\ninput = "{motor.input}"  # quantity of the input column']
    lines += [f"{key} = {inline_table(about(m.value), m.std)}" for key, m in constants.items() if m is not None]
    if motor.gear != 1.0:
        lines.append(f"gear = {toml_number(motor.gear, digits)}  # turns of the motor per turn of the arm")
    return "\n".join([*lines, "", ""])


def drive_tables(mode: "ArmMode", length: float | None, carried: float, motor: MotorMeasures | None) -> str:
    """Text of both tables from a few measurements; empty for a clamped arm.

    Args:
        mode: motion of the arm
        length: length of the arm, m
        carried: mass at the end of the arm, kg
        motor: motor of the arm

    Raises:
        ConfigError: a moving arm without its length, a driven arm without its input, or an input for an arm without a
            drive.
    """
    if motor is not None and mode != "driven":
        raise ConfigError(f"--input {motor.input} needs --arm driven: a {mode} arm has no input")
    if mode == "clamped":
        return ""
    if length is None:
        raise ConfigError(f"an arm that is {mode} needs its length: give --l0")
    if motor is None and mode == "driven":
        raise ConfigError(
            "a driven arm needs the quantity of its input column: give --input torque, current, voltage or acceleration"
        )
    lower, guess, upper = (factor * carried * length**2 for factor in BOUNDS.inertia)
    arm = arm_table(mode, {} if mode == "prescribed" else {"A": (lower, guess, upper)})
    return arm + (motor_table(motor) if motor else "")

"""Arm and motor of a new rig file."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.rig_toml import BOUNDS, Bounds, Measure

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

    @property
    def constants(self) -> dict[str, Measure]:
        """Known constants by their keys in `[motor]`."""
        named = {"kt": self.kt, "ke": self.ke, "R": self.R}
        return {key: constant for key, constant in named.items() if constant is not None}


def arm_bounds(mode: "ArmMode", length: float | None, carried: float, motor: MotorMeasures | None) -> dict[str, Bounds]:
    """Return bounds of the inertia of the arm with its rods, kg m^2.

    The rods are at the end of the arm. The result is empty if the bounds are not needed.

    Args:
        mode: motion of the arm
        length: length of the arm, m
        carried: mass at the end of the arm, kg
        motor: motor of the arm

    Raises:
        ConfigError: a moving arm has no length, a driven arm has no input, or an arm without a drive has an input.
    """
    if motor is not None and mode != "driven":
        raise ConfigError(f"--input {motor.input} needs --arm driven: a {mode} arm has no input")
    if mode == "clamped":
        return {}
    if length is None:
        raise ConfigError(f"an arm that is {mode} needs its length: give --l0")
    if motor is None and mode == "driven":
        raise ConfigError(
            "a driven arm needs the quantity of its input column: give --input torque, current, voltage or acceleration"
        )
    lower, guess, upper = (factor * carried * length**2 for factor in BOUNDS.inertia)
    return {} if mode == "prescribed" else {"A": (lower, guess, upper)}

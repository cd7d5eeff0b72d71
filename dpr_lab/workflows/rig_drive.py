"""Tables `[arm]` and `[motor]` of a new rig file, from a few measurements."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from dpr_lab.errors import ConfigError

if TYPE_CHECKING:
    from dpr_lab.rig_tables import ArmMode


@dataclass(frozen=True, slots=True)
class Measure:
    """A value; with its standard uncertainty if it was measured and should not be identified."""

    value: float
    std: float | None = None


@dataclass(frozen=True, slots=True)
class MotorMeasures:
    """Constants of the motor at the arm."""

    input: Literal["torque", "current", "voltage", "acceleration"]
    """Quantity in the input column of a recording."""
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
    """Bounds around values that were not measured."""

    inertia: tuple[float, float, float] = (1.0, 2.0, 30.0)
    """Lower bound, guess and upper bound of the arm's inertia, in m L0^2 of the rods at its end."""
    constant: tuple[float, float] = (0.3, 3.0)
    """Relative bounds of a constant from a data sheet."""


BOUNDS = DriveBounds()


def arm_table(mode: "ArmMode", length: float | None, carried: float) -> str:
    """Table `[arm]`; empty for a clamped arm.

    Args:
        mode: motion of the arm
        length: of the arm, m
        carried: mass at its end, kg

    Raises:
        ConfigError: an arm that moves without its length.
    """
    if mode == "clamped":
        return ""
    if length is None:
        raise ConfigError(f"an arm that is {mode} needs its length: give --l0")
    lower, nominal, upper = (factor * carried * length**2 for factor in BOUNDS.inertia)
    inertia = _inline({"nominal": nominal, "lower": lower, "upper": upper})
    total = "" if mode == "prescribed" else f"A = {inertia}  # inertia about its axis with the rods, kg m^2\n"
    return f'[arm]\nmode = "{mode}"\n{total}\n'


def motor_table(mode: "ArmMode", motor: MotorMeasures | None) -> str:
    """Table `[motor]`; empty without a motor.

    Raises:
        ConfigError: a driven arm without its input, or an input of an arm that is not driven.
    """
    if motor is None:
        if mode == "driven":
            raise ConfigError(
                "a driven arm needs the quantity of its input column: give --input torque, current, voltage or"
                " acceleration"
            )
        return ""
    if mode != "driven":
        raise ConfigError(f"--input {motor.input} needs --arm driven: a {mode} arm has no input")
    lines = ["[motor]", f'input = "{motor.input}"  # quantity of the input column']
    for name, measure in (("kt", motor.kt), ("ke", motor.ke), ("R", motor.R)):
        if measure is not None:
            lines.append(f"{name} = {_constant(measure)}")
    if motor.gear != 1.0:
        lines.append(f"gear = {motor.gear!r}  # turns of the motor per turn of the arm")
    return "\n".join([*lines, "", ""])


def _constant(measure: Measure) -> str:
    if measure.std is not None:
        return _inline({"nominal": measure.value, "measured": measure.value, "std": measure.std})
    lower, upper = (share * measure.value for share in BOUNDS.constant)
    return _inline({"nominal": measure.value, "lower": lower, "upper": upper})


def _inline(values: dict[str, float]) -> str:
    return "{" + ", ".join(f"{key} = {float(f'{value:.4g}')!r}" for key, value in values.items()) + "}"

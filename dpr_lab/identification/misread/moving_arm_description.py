"""Detect incorrect descriptions of recordings of a moving arm, for `identify` and `diagnose`.

This module contains the thresholds and messages.

A description consists of signs, zero and scale of the angles, and sign and unit of the input. In each interpretation,
`identify` fits a model of rods, arm and drive. `diagnose` fits a model that also contains the cable and the friction of
the arm.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import log10

from dpr_lab.identification.misread.moving_arm_balance import wrong_scale
from dpr_lab.identification.misread.scaled_readings import SCALED_READINGS, TURNED_RODS
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import INPUT_UNITS
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class DescriptionLimits:
    """Thresholds above which a wrong description is the probable cause of a misfit."""

    doubted: float = 20.0
    """Minimum reduced chi-square for which other signs, zeros and scales are tested."""
    better: float = 4.0
    """Minimum factor by which the other sign of the arm's angle must reduce chi-square."""
    better_angles: float = 10.0
    """Minimum factor by which another zero or scale must reduce chi-square.

    The correct zero or scale reduces it by a factor of at least 100.
    """
    unit: float = 0.5
    """Maximum distance between the logarithms (base 10) of the gain and of a unit's factor."""
    gain: float = 1.5
    """Largest deviation of the gain from the rig file that a motor constant can explain, as |log10| of their ratio."""


DESCRIPTION = DescriptionLimits()

OTHER_ANGLES = (TURNED_RODS, *SCALED_READINGS)
"""Interpretations that are tested if the sign of the arm's angle is not the cause."""

UNITS = {
    "torque": {-3.0: "mN m", -2.0: "N cm", 3.0: "kN m"},
    "current": {-3.0: "mA", 3.0: "kA"},
    "voltage": {-3.0: "mV", 3.0: "kV"},
}
"""Probable units of the input column, by kind of input and by log10 of the fitted gain relative to the rig file."""


def measured_scale(runs: Iterable[Run], rig: Rig) -> str:
    """Return a message if the acceleration of the last rod indicates a different scale or unit.

    Otherwise return an empty text.
    """
    scales = filter(None, (wrong_scale(run.t, run.theta, rig) for run in runs))
    return next((scale.cause(rig.rods.mounted) for scale in scales), "")


def wrong_sign(rig: Rig, before: float, after: float, *, of_rods: bool) -> str:
    """Describe the incorrect sign if the model fits with the opposite sign of theta0.

    Args:
        rig: rig with its mounted rods
        before: reduced chi-square with the described sign
        after: reduced chi-square with the opposite sign
        of_rods: True if arm and input agree with each other, so that the sign of the rods is incorrect
    """
    rods = "theta1=-1,theta2=-1" if rig.rods.mounted == "both" else "theta1=-1"
    subject, option = (
        ("the sign of the rods is opposite to that of the arm and its input", rods)
        if of_rods
        else ("the sign of theta0 is reversed", "theta0=-1")
    )
    return (
        f"{subject}: with the opposite sign, the reduced chi-square falls from {before:.3g} to {after:.3g}. Import a"
        f" table with --scale {option}; for a device, reverse the direction of"
        f" {'their encoders' if of_rods else 'encoder 0'} in [encoders]"
    )


def wrong_input(kind: str, gain: float) -> str:
    """Return a message if the input of a drive has a wrong sign or unit.

    The text is empty if both can be correct.

    Args:
        kind: kind of the input, as in `[motor]`
        gain: fitted torque per unit of the input, relative to the gain of the rig file
    """
    if gain < 0.0:
        return (
            f"the sign of the {kind} is reversed: the fitted gain is negative. Import a table with --scale input=-1,"
            " or --scale theta0=-1 if it is the sign of the arm; for a device, exchange the leads of the motor or"
            " reverse the direction of encoder 0 in [encoders]"
        )
    exponent = log10(gain) if gain else 0.0
    strength = f"the {kind} acts {gain:.3g} times as strongly as specified in the rig file"
    for factor, unit in UNITS.get(kind, {}).items():
        if abs(exponent - factor) < DESCRIPTION.unit:
            return (
                f"{strength}: its column seems to be in {unit}, not in {INPUT_UNITS[kind]}. Import a table with"
                f" --scale input={10.0**factor:g}, or correct the constants of [motor]"
            )
    if abs(exponent) < DESCRIPTION.gain:
        return ""
    return f"{strength}: check the unit of its column (--scale input=FACTOR) and the constants of [motor]"

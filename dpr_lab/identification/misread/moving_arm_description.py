"""Detect incorrect descriptions of recordings of a moving arm, for `identify` and `diagnose`.

This module contains the thresholds, the order of the tests (`wrong_angles`) and the messages.

A description consists of signs, zero and scale of the angles, and sign and unit of the input. In each interpretation,
`identify` fits a model of rods, arm and drive. `diagnose` fits a model that also contains the cable and the friction of
the arm.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log10

import numpy as np

from dpr_lab.arrays import Integers
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.identification.misread.moving_arm_balance import angles_are_right, wrong_scale
from dpr_lab.identification.misread.scaled_readings import SCALED_READINGS, TURNED_RODS, ScaledReadings
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import INPUT_UNITS
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class DescriptionLimits:
    """Thresholds above which a wrong description is the probable cause of a misfit."""

    doubted: float = 20.0
    """Minimum reduced chi-square for which other signs, zeros and scales are tested."""
    better: float = 4.0
    """Minimum factor by which the opposite sign of the arm or of the rods must reduce chi-square."""
    better_angles: float = 10.0
    """Minimum factor by which another zero or scale must reduce chi-square.

    The correct zero or scale reduces it by a factor of at least 100.
    """
    unit: float = 0.5
    """Maximum difference between log10 of the gain and log10 of the factor of a unit."""
    gain: float = 1.5
    """Maximum |log10| of the ratio of the gain to the rig file that an error of a motor constant can explain."""


DESCRIPTION = DescriptionLimits()

SIGNS = (ScaledReadings(arm=-1.0), ScaledReadings(rods=-1.0))
"""Opposite signs of the arm and of the rods."""

OTHER_ANGLES = (TURNED_RODS, *SCALED_READINGS)
"""Interpretations that are tested if no reversed sign is the cause."""

UNITS = {
    "torque": {-3.0: "mN m", -2.0: "N cm", 3.0: "kN m"},
    "current": {-3.0: "mA", 3.0: "kA"},
    "voltage": {-3.0: "mV", 3.0: "kV"},
}
"""Probable units of the input column, by kind of input and by log10 of the fitted gain relative to the rig file."""


@dataclass(frozen=True, slots=True)
class Interpreted:
    """Fit of short segments with one interpretation of the angles."""

    fit: Fit
    evidence: Integers
    """(segments,) degrees of freedom of each segment, as in `Problem.evidence_by_segment`."""
    gain: float
    """Fitted torque per unit of the input, relative to the rig file; only its sign if the rig file states no gain."""

    @property
    def reduced(self) -> float:
        """Reduced chi-square of the fit."""
        return self.fit.chi2 / int(self.evidence.sum())

    def far_better(self, given: "Interpreted", factor: float) -> bool:
        """Return whether chi-square is smaller than that of the given interpretation by a large factor.

        The factor must be reached in total and in at least half of the segments that the given interpretation does not
        fit. A failed fit leaves large residuals in a few segments, whichever interpretation is right. A fit that
        diverged is no reference: the other interpretation must then fit by itself.
        """
        if not factor * self.fit.chi2 < given.fit.chi2:
            return False
        if not np.isfinite(given.fit.chi2):
            return self.reduced <= DESCRIPTION.doubted
        before, after = given.fit.linear.chi2_by_segment, self.fit.linear.chi2_by_segment
        poor = before > DESCRIPTION.doubted * given.evidence
        return not poor.any() or bool(np.mean(factor * after[poor] < before[poor]) >= 0.5)


def wrong_angles(
    runs: Sequence[Run],
    rig: Rig,
    fitted: Callable[[ScaledReadings], Interpreted | None],
    others: Sequence[ScaledReadings] = OTHER_ANGLES,
) -> str:
    """Return a message if another interpretation explains the angles far better, otherwise an empty text.

    The alternatives are another scale or unit, which the acceleration of the last rod indicates, opposite signs of arm
    and rods, another zero of the rods, and half or twice the angles.

    Args:
        runs: the recordings in which the arm moves
        rig: the recorded rig
        fitted: function that fits the recordings in an interpretation; it returns None if they cannot be fitted
        others: interpretations that are tested if neither scale nor sign is the cause
    """
    for run in (run.swing for run in runs):
        if scale := wrong_scale(run.t, run.theta, rig):
            return scale.cause(rig.rods.mounted)
    given = None if angles_are_right(runs, rig) else fitted(ScaledReadings())
    if given is None:
        return ""
    # Without a free gain, the opposite sign of the arm cannot represent the opposite sign of the rods.
    signs = SIGNS if rig.motor and rig.motor.input == "acceleration" else SIGNS[:1]
    for sign in signs:
        mirrored = fitted(sign)
        if mirrored and mirrored.far_better(given, DESCRIPTION.better):
            # If the gain is negative, arm and input are consistent.
            of_rods = sign.rods < 0.0 or mirrored.gain < 0.0
            return wrong_sign(rig, given.reduced, mirrored.reduced, of_rods=of_rods)
    tried = [(interpreted, other) for other in others if (interpreted := fitted(other))]
    best, other = min(tried, key=lambda pair: pair[0].fit.chi2, default=(given, TURNED_RODS))
    if not best.far_better(given, DESCRIPTION.better_angles):
        return ""
    change = f"the reduced chi-square falls from {given.reduced:.3g} to {best.reduced:.3g}"
    return f"{other.cause(rig.rods.mounted)}; in this interpretation {change}"


def wrong_sign(rig: Rig, before: float, after: float, *, of_rods: bool) -> str:
    """Return a message about the incorrect sign if the opposite sign of the arm or of the rods fits.

    Args:
        rig: rig with its mounted rods
        before: reduced chi-square with the described sign
        after: reduced chi-square with the opposite sign
        of_rods: whether arm and input agree with each other, so that the sign of the rods is incorrect
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

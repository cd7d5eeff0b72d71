"""Scale of absolute sizes of rods, arm and motor.

A known torque or the rig file determines it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.prior import parameter_std
from dpr_lab.identification.model import EstimatedValue
from dpr_lab.identification.moving_arm.fit import ArmFit
from dpr_lab.identification.moving_arm.setup import rods_measured
from dpr_lab.identification.moving_arm.unknowns import best, rod_inertias, scale_parameters
from dpr_lab.identification.scaling.scale import lognormal90
from dpr_lab.rig import PARAMETERS, Rig


@dataclass(frozen=True, slots=True)
class ArmScale:
    """Scale of absolute sizes: the inertia by which ratios are multiplied."""

    value: float
    """Inertia that defines the scale, kg m^2."""
    relative_std: float
    """Relative standard deviation of the sources other than the recordings. It follows from the bounds of the rig file
    if no measurement determines the scale."""
    by_gain: bool
    """Whether the scale follows from the fitted gain of the drive. The error of the scale is then correlated with the
    errors of the ratios."""
    known: bool
    """Whether recordings or measured values determine the scale."""
    sentence: str


def scale_of_arm(fit: ArmFit, covariance: Array, rig: Rig) -> ArmScale:
    """Determine the scale from a drive of known torque, otherwise from the rig file."""
    unknowns, motor = fit.problem.unknowns, rig.motor
    name = unknowns.scale
    if "gain" in unknowns.free and motor is not None:
        gain = abs(fit.value("gain"))
        place = unknowns.free.index("gain")
        clear = covariance[place, place] ** 0.5 < 0.5 * gain
        if clear and motor.input == "torque":
            return ArmScale(1.0 / gain, 0.0, True, True, f"The scale {name} is determined by the known torque.")
        if clear and motor.input == "current" and motor.kt is not None:
            kt, measured = best(motor.kt, 0.0), motor.kt.std is not None
            std = motor.kt.std or ((motor.kt.upper or kt) - (motor.kt.lower or kt)) / np.sqrt(12)
            source = "the measured kt" if measured else "the nominal kt of the rig file"
            return ArmScale(
                kt * motor.gear / gain,
                float(std / kt),
                True,
                measured,
                f"The scale {name} follows from the current and {source}.",
            )
    Z = rig.nominal
    value, relative = float(rod_inertias(Z, rig)[1]), _relative_std(rig)
    if not rods_measured(rig):
        sentence = (
            f"The recordings do not determine the scale: absolute values assume {name} = {value:.4g}"
            f" kg m^2 of the rig file."
        )
        return ArmScale(value, relative, False, False, sentence)
    sentence = f"The scale {name} = {value:.4g} kg m^2 follows from measured values of the rig file."
    return ArmScale(value, relative, False, True, sentence)


def _relative_std(rig: Rig) -> float:
    """Compute the relative standard deviation of the scale from the measured values and bounds of the rig file."""
    value, std, shifts = rod_inertias(rig.nominal, rig)[1], parameter_std(rig), list[float]()
    for name in scale_parameters(rig):
        larger, place = rig.nominal, PARAMETERS.index(name)
        larger[place] += std[place]
        shifts.append(rod_inertias(larger, rig)[1] / value - 1.0)
    return float(np.linalg.norm(shifts))


def absolute_values(
    fit: ArmFit, covariance: Array, scale: ArmScale, determined: Sequence[bool]
) -> dict[str, EstimatedValue]:
    """Compute the absolute values of the determined unknowns and of the scale, by name."""
    unknowns, values = fit.problem.unknowns, fit.values
    unit, by_gain = np.eye(len(values)), np.zeros(len(values))
    if scale.by_gain:
        by_gain[unknowns.free.index("gain")] = -1.0 / fit.value("gain")
    rows = {unknowns.scale: (1.0, by_gain)}
    for k, parameter in enumerate(unknowns.free):
        if determined[k] and parameter != "L0" and not (scale.by_gain and parameter == "gain"):
            rows[absolute_name(parameter, unknowns.input)] = float(values[k]), by_gain + unit[k] / values[k]
    absolute = {}
    for name, (ratio, row) in rows.items():
        value = ratio * scale.value
        std = abs(value) * float(np.sqrt(max(row @ covariance @ row, 0.0) + scale.relative_std**2))
        absolute[name] = estimated(value, std, "data" if scale.known else "bound")
    return absolute


def estimated(value: float, std: float, fixed_by: Literal["data", "bound"] = "data") -> EstimatedValue:
    """Return an estimate with its 90 % interval.

    The interval is that of a normal distribution, or of a lognormal one if the scale is only assumed. A lognormal
    interval excludes zero, although the standard deviation is large.
    """
    reach = NORMAL_Q90 * std
    ends = (value - reach, value + reach)
    if fixed_by == "bound" and value != 0.0:
        low, high = sorted(value * factor for factor in lognormal90(1.0, std / abs(value)))
        ends = (low, high)
    return EstimatedValue(value=value, std=std, interval90=ends, fixed_by=fixed_by)


def absolute_name(parameter: str, kind: str) -> str:
    """Return the name of an absolute value, which for a gain depends on the input."""
    if parameter != "gain":
        return parameter
    return {"voltage": "kt gear/R", "current": "kt gear"}.get(kind, "gain")


def motor_notes(fit: ArmFit, scale: ArmScale, rig: Rig, determined: Collection[str]) -> list[str]:
    """Describe combinations of motor constants that the input cannot separate.

    The notes contain the values that follow from the constants of the rig file.

    Args:
        fit: the fit
        scale: scale of absolute values
        rig: the rig file
        determined: unknowns that the recordings determine
    """
    unknowns, motor = fit.problem.unknowns, rig.motor
    if motor is None or "gain" not in unknowns.free:
        return []
    if motor.input == "current" and motor.kt is None:
        return [
            f"[motor] of the rig file does not give kt: a current determines only the ratio"
            f" kt/{unknowns.scale}. Add kt, or import the torque, to determine absolute sizes"
        ]
    geared = [f"kt/{unknowns.scale} contains the gear ratio {motor.gear:g}."] if motor.gear != 1.0 else []
    if motor.input != "voltage":
        return geared if motor.input == "current" else []
    gain = fit.value("gain") * scale.value
    missing = [name for name in ("kt", "ke", "R") if getattr(motor, name) is None]
    lumped = f"[motor] of the rig file does not give {', '.join(missing)}: only lumped constants are known."
    notes = [
        *([lumped] if missing else []),
        "A voltage drive determines kt gear/R, and c0 together with the back-EMF, c0 + ke kt gear^2/R. No"
        " recording separates kt from R, or friction from back-EMF: measure R with an ohmmeter, and ke by"
        " turning the motor.",
    ]
    if "gain" not in determined or gain < 0.0:  # a negative gain means a reversed input, which is reported separately
        return notes
    if motor.kt is not None and motor.R is not None:
        expected = best(motor.kt, 0.0) / best(motor.R, 1.0)
        notes.append(
            f"kt/R is {gain / motor.gear:.4g} N m/V from the recordings and {expected:.4g} N m/V from the rig file"
            f" ({100 * (gain / motor.gear / expected - 1):+.1f} %)."
        )
    if motor.ke is not None and "c0" in determined:
        share = best(motor.ke, 0.0) * gain * motor.gear
        total = fit.value("c0") * scale.value
        notes.append(
            f"With ke of the rig file, the back-EMF contributes {share:.3g} N m s/rad to c0, and friction"
            f" {total - share:.3g}."
        )
    return notes

"""Scale of absolute sizes of rods, arm and motor, which a known torque or the rig file determines."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, alone_share, unknown_ratios
from dpr_lab.identification.model import EstimatedValue
from dpr_lab.identification.moving_arm.fit import ArmFit
from dpr_lab.identification.moving_arm.unknowns import best
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.scaling.scale import Scale, lognormal90
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ArmScale:
    """Scale of absolute sizes of a rig with a moving arm, and its source."""

    value: float
    """Inertia by which ratios are multiplied, kg m^2."""
    relative_std: float
    """Relative standard deviation due to sources other than the recordings.

    It follows from the bounds of the rig file if no measurement determines the scale.
    """
    by_gain: bool
    """Whether the scale follows from the fitted gain of the drive.

    The error of the scale is then correlated with the errors of the ratios.
    """
    known: bool
    """Whether recordings or measured values determine the scale."""
    of_rig: Scale | None = None
    """The scale from the rig file, with its interval; None if the gain of the drive determines it."""

    @classmethod
    def of(cls, scale: Scale) -> "ArmScale":
        """Return a scale that does not follow from the gain of the drive."""
        low, high = scale.interval90
        relative_std = float(np.arcsinh((high - low) / (2 * scale.b))) / NORMAL_Q90  # exact for a lognormal interval
        return cls(scale.b, relative_std, by_gain=False, known=scale.known, of_rig=scale)

    @property
    def fixed_by(self) -> Literal["data", "measured", "bound"]:
        """Source as in `Scale`: the drive in the recordings, measured values, or bounds of the rig file."""
        return ("data" if self.by_gain else "measured") if self.known else "bound"

    @property
    def constants_std(self) -> float:
        """Relative standard deviation due to motor constants, as in `Scale`."""
        return self.relative_std if self.by_gain else 0.0


def scale_of_arm(fit: ArmFit, covariance: Array, rig: Rig) -> ArmScale:
    """Determine the scale from a drive of known torque, or from the rig file if there is no such drive."""
    unknowns, motor = fit.problem.unknowns, rig.motor
    if "gain" in unknowns.free and motor is not None:
        gain = abs(fit.value("gain"))
        place = unknowns.free.index("gain")
        clear = covariance[place, place] ** 0.5 < 0.5 * gain
        if clear and motor.input == "torque":
            return ArmScale(1.0 / gain, 0.0, by_gain=True, known=True)
        if clear and motor.input == "current" and motor.kt is not None:
            kt = best(motor.kt, 0.0)
            std = motor.kt.std or ((motor.kt.upper or kt) - (motor.kt.lower or kt)) / np.sqrt(12)
            return ArmScale(kt * motor.gear / gain, float(std / kt), by_gain=True, known=motor.kt.std is not None)
    return ArmScale.of(_of_rig(fit, covariance, rig))


def _of_rig(fit: ArmFit, covariance: Array, rig: Rig) -> Scale:
    """Return the scale of the rig file, with its interval given the fitted ratios."""
    free, alone = fit.problem.unknowns.free, rig.rods.mounted == "inner"
    fitted = [name for name in RATIOS if name.partition("/")[0] in free]
    places = [free.index(name.partition("/")[0]) for name in fitted]
    unknown = unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))
    share, visible = alone_share(unknown) if alone else 1.0, [RATIOS.index(name) for name in fitted]
    unknown[visible] = [share * fit.value(free[place]) for place in places]
    if alone:
        unknown[RATIOS.index("e1/b")] += unknown[ON_ELBOW] * rig.g / rig.L1
    errors = share**2 * covariance[np.ix_(places, places)]
    posterior = posterior_of(unknown, rig, visible, errors, alone=alone)
    probable = posterior.scale()
    scale = probable if probable.known else posterior.scale(float(unknown[SCALE]))
    return scale.as_inertia("a", share) if alone else scale


def stated_scale(
    inertia: EstimatedValue,
    name: Literal["a", "b"],
    fixed_by: Literal["data", "measured", "bound"],
    constants_std: float = 0.0,
) -> Scale:
    """Return the scale of absolute values from the inertia a or b (`name`), with its source as in `Scale`."""
    value, (low, high) = inertia.value, inertia.interval90
    interval = max(low, 1e-3 * value), high
    return Scale(b=value, interval90=interval, fixed_by=fixed_by, inertia=name, constants_std=constants_std)


def absolute_values(
    values: Mapping[str, float], covariance: Array, scale: ArmScale, inertia: str, kind: str
) -> dict[str, EstimatedValue]:
    """Compute the absolute values of determined unknowns and of the scale, by name.

    Args:
        values: the unknowns by their names in `SWING_PARAMETERS`, in units of the scale
        covariance: (n, n) covariance of these unknowns
        scale: source of the scale
        inertia: inertia by which ratios are divided, a or b
        kind: kind of the input of the arm; empty without an input
    """
    unit, by_gain = np.eye(len(values)), np.zeros(len(values))
    if scale.by_gain:
        by_gain = -unit[[*values].index("gain")] / values["gain"]
    rows = {inertia: (1.0, by_gain)}
    for row, (parameter, value) in zip(unit, values.items(), strict=True):
        if parameter != "L0" and not (scale.by_gain and parameter == "gain"):
            rows[absolute_name(parameter, kind)] = value, row + value * by_gain
    absolute = {}
    for name, (ratio, row) in rows.items():
        variance, value = max(row @ covariance @ row, 0.0), ratio * scale.value
        std = np.sqrt(variance + (ratio * scale.relative_std) ** 2)
        absolute[name] = estimated(value, float(scale.value * std), "data" if scale.known else "bound")
        if scale.of_rig is not None:
            fitted90 = estimated(value, float(scale.value * np.sqrt(variance))).interval90
            wide = scale.of_rig.with_scale90(value, fitted90)
            absolute[name] = absolute[name].model_copy(update={"interval90": wide})
    return absolute


def estimated(value: float, std: float, fixed_by: Literal["data", "bound"] = "data") -> EstimatedValue:
    """Return an estimate with its 90 % interval.

    The interval is that of a normal distribution, or of a lognormal one if the scale is only assumed. A lognormal
    interval excludes zero, even if the standard deviation is large.
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
    assumed = "" if scale.known else f" with the assumed {unknowns.scale}"
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
            f"kt/R is {gain / motor.gear:.4g} N m/V from the recordings{assumed} and {expected:.4g} N m/V from the rig"
            f" file ({100 * (gain / motor.gear / expected - 1):+.1f} %)."
        )
    if motor.ke is not None and "c0" in determined:
        share = best(motor.ke, 0.0) * gain * motor.gear
        total = fit.value("c0") * scale.value
        notes.append(
            f"With ke of the rig file, the back-EMF contributes {share:.3g} N m s/rad to c0, and friction"
            f" {total - share:.3g}{assumed}."
        )
    return notes

"""Unknowns of moving-arm recordings: ratios to an inertia, and the gain of the input.

For both rods, ratios are divided by the inertia b. For the inner rod alone (a Furuta pendulum), they are divided by a =
J1 + m1 l1^2 + mb L1^2. A torque input u enters the equation as u/b, so that its gain is 1/b. The gain of a current is
kt gear/b, and that of a voltage is kt gear/(R b). The back-EMF of a voltage drive adds ke kt gear^2/R to the viscous
coefficient c0 of the arm. No recording separates these two terms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.arm import CLAMPED, DRIVEN, FREE
from dpr_lab.dynamics.base import GAINS, base_parameters
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.fitting.estimate import FreeParameter
from dpr_lab.fitting.prior import Prior
from dpr_lab.rig import MASSES, PARAMETERS, Rig
from dpr_lab.rig_tables import ArmMode, Parameter


@dataclass(frozen=True, slots=True)
class CentralDifferences:
    """Increments of the central differences; the relative error of a derivative is below 1e-7."""

    relative: float = 1e-5
    """Relative increment of an unknown."""
    least: float = 1e-6
    """Minimum increment of an unknown, for unknowns near zero."""
    state: float = 1e-5
    """Increment of an angle or speed, rad and rad/s."""


STEPS = CentralDifferences()

POSITIVE = ("a", "e1", "A", "L0")
"""Parameters that must be positive; a gain is negative if the sign of the input is reversed."""


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Unknowns of a fit to recordings with a moving arm."""

    scale: Literal["a", "b"]
    """Inertia by which ratios are divided, `a` or `b`."""
    free: tuple[str, ...]
    """Names of the fitted parameters, as in `SWING_PARAMETERS`."""
    input: str
    """Kind of the input of the arm; empty if there is no input."""
    scale_value: float
    """Value of the inertia `scale` in the rig file, kg m^2."""
    start: Array
    """(12,) initial values of `SWING_PARAMETERS` from the rig file, in units of the scale."""
    prior: Prior | None
    """Prior of the length of the arm if the rig file states its uncertainty; None if the length is fixed.

    The prior of all other parameters is so wide that it has no effect.
    """

    @property
    def places(self) -> list[int]:
        """Indices of the free parameters in the vector p."""
        return [SWING_PARAMETERS.index(name) for name in self.free]

    @property
    def parameters(self) -> tuple[FreeParameter, ...]:
        """Free parameters for the common fitting engine."""
        lower = [1e-9 if name in POSITIVE else -np.inf for name in self.free]
        steps = np.maximum(STEPS.relative * np.abs(self.start[self.places]), STEPS.least).tolist()
        rows = zip(self.free, self.places, steps, lower, strict=True)
        return tuple(FreeParameter(name, "ratios", place, step, least) for name, place, step, least in rows)

    def name(self, parameter: str) -> str:
        """Return the name of an unknown in results, for example `A/b`."""
        if parameter == "L0":
            return parameter
        if parameter == "gain":
            return GAINS[self.input].format(self.scale)
        return f"{parameter}/{self.scale}"


def parameter_of(ratio: str, kind: str, scale: str) -> str:
    """Return the entry of `SWING_PARAMETERS` for the name of a ratio.

    This function is the inverse of `Unknowns.name`.

    Args:
        ratio: name of the ratio, for example `A/b`
        kind: kind of the input of the arm; empty without an input
        scale: inertia by which ratios are divided
    """
    return "gain" if ratio == GAINS.get(kind, "").format(scale) else ratio.partition("/")[0]


def mode_number(mode: ArmMode, kind: str) -> int:
    """Return the mode of the arm in the equation of motion: CLAMPED, FREE or DRIVEN."""
    if mode == "driven" and kind == "acceleration":
        return DRIVEN
    return CLAMPED if mode == "clamped" else FREE


def best(parameter: Parameter | None, otherwise: float) -> float:
    """Return the measured value of a parameter, or its nominal value.

    The result is `otherwise` if the rig file does not contain the parameter.
    """
    return otherwise if parameter is None else parameter.measured or parameter.nominal


def rod_inertias(Z: Array, rig: Rig) -> Array:
    """Compute a, b, d, e1, c1, c2 (6,) of the rods on the arm, SI.

    For the inner rod alone, with the parts at joint 2, b = a, and d and c2 are zero.
    """
    if rig.rods.mounted == "both":
        return base_parameters(Z, rig.L1, rig.g)
    a, _, _, e1, c1, _ = base_parameters(np.where(np.array(PARAMETERS) == "m2", 0.0, Z), rig.L1, rig.g)
    return np.array([a, a, 0.0, e1, c1, 0.0])


def scale_parameters(rig: Rig) -> tuple[str, ...]:
    """Return the names of the parameters that determine the inertia by which ratios are divided."""
    return ("l2", "m2", "J2") if rig.rods.mounted == "both" else ("l1", "m1", "mb", "J1")


def arm_start(rig: Rig) -> tuple[float, float]:
    """Return initial values of the total inertia of the arm, kg m^2, and of its viscous friction, N m s/rad."""
    masses = MASSES if rig.rods.mounted == "both" else ("m1", "mb")
    carried = sum(rig.nominal[PARAMETERS.index(name)] for name in masses) * rig.L0**2
    total = best(rig.arm.A, 2.0 * carried)
    return total, best(rig.arm.c0, total)


def unknowns_of(modes: Sequence[int], driven: bool, rig: Rig) -> Unknowns:
    """Determine the unknowns of recordings with given modes of the arm.

    Args:
        modes: mode of each recording, CLAMPED, FREE or DRIVEN
        driven: whether a torque, current or voltage drives the arm in one of the recordings
        rig: initial values
    """
    both_rods = rig.rods.mounted == "both"
    rods = rod_inertias(rig.nominal, rig)
    scale = float(rods[1])
    start = np.array([
        *rods, *arm_start(rig), best(rig.arm.k0, 0.0), best(rig.arm.f0, 0.0), nominal_gain(rig),
        rig.L0 * scale,
    ]) / scale  # fmt: skip
    free = ["a", "d", "e1", "c1", "c2"] if both_rods else ["e1", "c1"]
    if FREE in modes:
        free += ["A", "c0"]
        free += [name for name in ("k0", "f0") if getattr(rig.arm, name) is not None]
    if driven:
        free.append("gain")
    else:
        start[SWING_PARAMETERS.index("gain")] = 1.0  # value for an acceleration; unused without an input
    prior = None
    if rig.rig.L0_std is not None and set(modes) != {CLAMPED}:
        free.append("L0")
        variance = np.append(np.full(len(start) - 1, 1e18), rig.rig.L0_std**2)
        prior = Prior(start, np.diag(variance), np.zeros(0))
    return Unknowns("b" if both_rods else "a", tuple(free), rig.input, scale, start, prior)


def nominal_gain(rig: Rig) -> float:
    """Return the torque per unit of input in the rig file, or zero if unknown."""
    motor = rig.motor
    if motor is None:
        return 0.0
    if motor.input == "torque":
        return 1.0
    if motor.kt is None or motor.input == "acceleration" or (motor.input == "voltage" and motor.R is None):
        return 0.0
    return best(motor.kt, 0.0) * motor.gear / (best(motor.R, 1.0) if motor.input == "voltage" else 1.0)

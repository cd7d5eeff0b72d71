"""Definition of an effect: a physical cause of a gap between simulation and rig."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName

Site = Literal["joint torque", "geometry", "base", "sensor", "timing", "drive"]

Params = Mapping[str, float]
"""Parameters of one effect, SI, by their names."""

Shape = tuple[tuple[int, float], ...]
"""Values of shape parameters, each as (index in the flat vector, value)."""


class JointIndex(NamedTuple):
    """Indices of the joints in `Effect.joints` and of the axes of a recording."""

    inner: int = 0
    outer: int = 1
    arm: int = -1
    """Joint 0, the joint of the arm, which comes last."""


ARM = JointIndex().arm

LEVERS = ("friction_radius_m", "offset_m")
"""Names of parameters that are lever arms of forces. A free swing determines their ratio to b, as for torques."""

_UNIT_SUFFIX = re.compile(r"(_(per|Nms?|m2?|rad3?|s2?|kg(m2)?|[hH]z))+$")
"""Pattern of the unit at the end of a parameter's name."""

_RATIO_UNITS = {
    "N m": "1/s^2",
    "N m/rad": "1/(s^2 rad)",
    "N m/rad^3": "1/(s^2 rad^3)",
    "N m s/rad": "1/s",
    "kg m^2": "1",
    "kg/m^2": "1/m^4",
    "m": "1/(kg m)",
    "1/kg": "m^2",
}
"""Units of the ratio of an amplitude to b^k, by the unit of the amplitude; k is its `scale_power`."""


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """One coefficient of an effect.

    An effect whose amplitudes are all zero is off, for any shape parameters.
    """

    name: str
    """Name with the unit, as in `torque_Nm`."""
    unit: str
    typical: float
    """Typical size on a laboratory rig, in `unit`."""
    sign: Literal["any", "positive"] = "any"
    """Whether only positive values are physically possible."""
    role: Literal["amplitude", "shape"] = "amplitude"
    default: float = 0.0
    """Default of a shape parameter; zero for an amplitude."""
    scan: tuple[float, ...] = ()
    """Values of a shape parameter that are tried first; empty: `Effect.propose` derives them from the recordings."""
    draw: tuple[float, float] | None = None
    """Range from which blind trials draw a shape parameter; None: 1/3 to 3 times the default."""
    whole: bool = False
    """Whether only integers are physical; the absolute value of an amplitude is then at least one."""
    one_way: bool = False
    """Whether blind trials draw only positive values, because negative values would supply energy to the rods."""
    continuous: bool = False
    """Whether a shape parameter is refined after its scan; false for orders and instants."""
    negative: str = ""
    """Meaning of a negative value, for example `friction falls during the swing`."""
    label: str = ""
    """Name in tables and sentences; empty: `name` without its unit."""
    most: float = math.inf
    """Maximum absolute value of an amplitude on any rig, in `unit`; inf: only the relative `limit` applies."""
    limit: str = ""
    """Key of the relative maximum in `dpr_lab.effects.limits.LIMITS`; empty: the unit is the key."""
    plausible: float | None = None
    """Scale of the prior of an amplitude, in `unit`; larger sizes are rare. None: three times the typical size."""

    @property
    def words(self) -> str:
        """Name for readers, such as `extra at rest` for `extra_at_rest_Nm`."""
        return self.label or _UNIT_SUFFIX.sub("", self.name).replace("_", " ")

    @property
    def prior_scale(self) -> float:
        """Scale of the prior of an amplitude, in `unit`.

        It is three times the typical size unless `plausible` is set.
        """
        return 3.0 * self.typical if self.plausible is None else self.plausible

    @property
    def scale_power(self) -> int:
        """Power k of the common scale b of torques and inertias in this parameter.

        A free swing determines the ratio of the parameter to b^k. k is 1 for a torque or an inertia, -1 for 1/kg, and 0
        for angles, times and shapes.
        """
        if self.role == "shape":
            return 0
        if self.unit.startswith("1/kg"):
            return -1
        return int(self.unit.startswith(("N m", "kg")) or self.name in LEVERS)

    @property
    def ratio_unit(self) -> str:
        """Unit of the ratio of this parameter to b^k; empty if k is 0."""
        if not self.scale_power:
            return ""
        return _RATIO_UNITS.get(self.unit, f"{self.unit} / (kg m^2)" + ("" if self.scale_power == 1 else "^-1"))


def shape(
    name: str,
    unit: str,
    default: float,
    scan: tuple[float, ...] = (),
    draw: tuple[float, float] | None = None,
    *,
    whole: bool = False,
    continuous: bool = False,
) -> EffectParameter:
    """Create a positive shape parameter; its typical size is its default.

    Args:
        name: name with unit
        unit: SI unit
        default: value while it is not fitted
        scan: values to try first; for a continuous parameter, initial values of its fit, in a geometric sequence
        draw: range in blind trials
        whole: whether it is an integer
        continuous: whether it is fitted after the scan

    Raises:
        ValueError: the shape is continuous, but `scan` has fewer than two values.
    """
    if continuous and len(scan) < 2:
        raise ValueError(f"{name}: a continuous shape needs two values or more in `scan`")
    return EffectParameter(
        name, unit, default, "positive", "shape", default, scan, draw=draw, whole=whole, continuous=continuous
    )


@dataclass(frozen=True, slots=True)
class BenchQuantity:
    """Quantity of an effect that can be measured on the bench."""

    words: str
    """Name of the quantity, for example `extra friction at rest`."""
    symbol: str
    """Symbol in the equation of the effect."""
    parameters: tuple[str, ...]
    """Measured amplitude; for several amplitudes, such as cosine and sine, the root of the sum of their squares."""
    definition: str = ""
    """Exact definition of the quantity, if the name is ambiguous."""


@dataclass(frozen=True, slots=True)
class InternalState:
    """Internal state of an effect: a quantity that depends on the previous motion."""

    name: str
    """Name of the state, and of the kernel argument that takes its value at the start of the step."""
    unit: str
    at_release: float = 0.0
    after: Callable[..., float] | None = None
    """Kernel of the transition over a displacement of the joint in one direction: (state, `displacement`, parameters).

    None: the stage of the effect defines the transition, as for a backlash or a compliant arm.
    """
    sliding: Callable[[float], float] | None = None
    """Kernel (speed of the joint, rad/s) -> state at the start of a run after the release; None: unchanged."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """Properties of the recordings from which effects propose shape parameters."""

    arm_moves: tuple[bool | None, ...]
    """For each run, whether encoder 0 detected a motion of the arm; None if the angle of the arm was not measured."""
    steps: Sequence[tuple[int, int, float]] = ()
    """Joint (0 or 1), run and instant (s) of each lasting step of a reading."""


Words = Mapping[str, Any]
"""Description of an effect by elements that rigid-body programs share.

Each element refers to the effect's joint or rod; all values are SI.

    friction                 Coulomb friction, N m
    stiffness, rest_angle    a linear spring, N m/rad, and its rest angle, rad from hanging
    armature                 inertia that turns with the joint, kg m^2
    cogging                  (amplitude N m, poles, phase rad) of each torque amplitude sin(poles q + phase)
    presliding               (torque N m, length rad) of friction that is elastic before sliding
    offset                   offset of the rod's centre of mass across the rod, m
    added_length             length error of the inner rod, m
    tilt                     tilt of gravity in the plane of the rods, rad
    arm                      True: the arm is free with the constants of `arm_model`
    encoder_offset           offset of the joint's encoder, rad
    encoder_scale            relative scale error of the joint's encoder
"""


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect: its description, its parameters and the kernel that computes it."""

    name: str
    words: str
    """Title for readers, for example `Coulomb friction, joint 1`."""
    equation: str
    """Equation with the symbols of docs/theory.md: torques on theta1 and theta2, or changes of the readings."""
    parameters: tuple[EffectParameter, ...]
    site: Site
    stage: StageName
    kernel: Callable[..., Any]
    bench_check: str
    """Check on the rig that confirms the effect, or distinguishes it from its twins."""
    source: str
    symptom: str = ""
    """Symptom of the effect at the rig or in a recording; required for effects of the library."""
    joints: tuple[int, ...] = (0, 1)
    """Indices of the joints (0, 1 or `ARM`) on whose motion the effect depends; both rod joints for an effect of the
    rig."""
    internal: tuple[InternalState, ...] = ()
    dissipative: bool = False
    """Whether the effect can only dissipate energy of the rods (presliding returns at most the stored energy)."""
    dry: bool = False
    """Whether the effect is Coulomb friction, proportional to `Joint.direction` apart from a dependence on the speed.

    At rest it transmits the torque that keeps the joint at rest, up to its torque at zero speed.
    """
    potential: bool = False
    """Whether the torque of the effect is a function of the joint's angle alone."""
    presumes_still_arm: bool = False
    """Whether the effect describes only rigs whose arm does not move."""
    event: bool = False
    """Whether the effect occurs once, in one recording, and is not a property of the rig."""
    twins: tuple[str, ...] = ()
    """Effects that free swings hardly or never distinguish from this effect."""
    nested: tuple[str, ...] = ()
    """Simpler effects that this effect contains as special cases; they are preferred if they fit equally well."""
    adds: str = ""
    """Name of the amplitude that the simpler effects lack; empty if it cannot be measured."""
    quantities: tuple[BenchQuantity, ...] = ()
    """Measurable quantities, first the quantity of the effect itself; if empty, the amplitudes by their names.

    The quantity with the amplitude `adds` distinguishes the effect from its simpler forms.
    """
    absorbed_by: tuple[str, ...] = ()
    """Base parameters that absorb the effect completely, so that a free swing cannot show it."""
    corrects: str = ""
    """Key of the rig file whose number the effect corrects, or `t` for the times of the readings.

    The effect is always fitted if the rig file states the uncertainty of this number (`Rig.unsure`).
    """
    universal: bool = False
    """Whether every rig has the effect to some degree, so that its presence does not indicate a fault."""
    common: bool = False
    """Whether most rigs have a visible amount of the effect."""
    propose: Callable[[Recorded], list[dict[str, float]] | None] | None = None
    """Function that returns the shape parameters to try on the recordings, by name; [] if there are none.

    None: the grid of `scan`.
    """
    longest_step: Callable[[Params], float] | None = None
    """Function that returns the longest integration step, s; None: the step of the rods."""
    hides_step: Callable[[Params], float] | None = None
    """Function that returns the largest step of its joint's reading that the effect can cause, rad; None: no step."""
    possible: Callable[[Params], bool] = lambda sizes: True
    """Function that returns whether the sizes, each within its limit, can occur together."""
    remedy: Callable[[Params, RigConstants, int], str] | None = None
    """Function (parameters, rig, joint 0 or 1) -> text on how to correct the rig, its file or its readings.

    None: the effect is not a fault, and a simulator must include it.
    """
    implied: Callable[[Params], Params] | None = None
    """Function that returns derived quantities by name, reported with the parameters; {} if there are none."""
    derived: tuple[EffectParameter, ...] = ()
    """Descriptions of the derived quantities, with their units."""
    exported: Callable[[Params], Words] | None = None
    """Function that describes the effect by the elements of `Words`; None or {}: no elements describe it.

    Other programs then call the kernel of the effect or omit it.
    """

    @property
    def prior_odds(self) -> float:
        """Prior odds that the effect is visible on a rig, relative to an effect that is visible on few rigs."""
        return 10.0 if self.common else 1.0

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Parameters that are zero if the effect is off."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "amplitude")

    def bench_quantity(self, parameter: str) -> BenchQuantity:
        """Return the measurable quantity to which an amplitude belongs."""
        containing = (quantity for quantity in self.quantities if parameter in quantity.parameters)
        return next(containing, BenchQuantity(parameter, parameter, (parameter,)))

    @property
    def driven(self) -> bool:
        """Whether the effect belongs to a drive, so that free swings do not show it."""
        return self.stage in ("drive", "drive0", "input")

    @property
    def of_arm(self) -> bool:
        """Whether the effect occurs only on rigs with a free or driven arm."""
        return self.stage in ("free_arm", "torque0", "drive0", "whole0", "timing0", "encoder0", "play0")

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """Shape parameters."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "shape")


def pair(
    family: str,
    *,
    words: str,
    equation: str,
    bench_check: str,
    symptom: str = "",
    nested: tuple[str, ...] = (),
    twins: tuple[str, ...] = (),
    site: Site = "joint torque",
    **fields: Any,
) -> list[Effect]:
    """Create the same effect for both joints: FAMILY_joint1 and FAMILY_joint2.

    Args:
        family: name without the joint
        words: title with {j} for the number of the joint
        equation: equation with {j}
        bench_check: check with {j}
        symptom: symptom with {j}
        nested: families of simpler effects at the same joint
        twins: families of similar effects at the same joint
        site: as in `Effect`
        fields: the remaining fields of `Effect`
    """
    return [
        Effect(
            name=f"{family}_joint{j}",
            joints=(j - 1,),
            nested=tuple(f"{name}_joint{j}" for name in nested),
            twins=tuple(f"{name}_joint{j}" for name in twins),
            site=site,
            words=words.replace("{j}", str(j)),
            equation=equation.replace("{j}", str(j)),
            bench_check=bench_check.replace("{j}", str(j)),
            symptom=symptom.replace("{j}", str(j)),
            **fields,
        )
        for j in (1, 2)
    ]

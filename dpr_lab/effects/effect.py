"""Effects: physical causes of a difference between simulation and rig, each as data and one kernel."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName

Site = Literal["joint torque", "geometry", "base", "sensor", "timing", "drive"]

Params = Mapping[str, float]
"""Parameters of one effect by name, SI."""

Shape = tuple[tuple[int, float], ...]
"""Shape parameters as (index in the flat vector, value)."""


class JointIndex(NamedTuple):
    """Indices among `Effect.joints` and the axes of a recording."""

    inner: int = 0
    outer: int = 1
    arm: int = -1
    """Joint 0, which is read last."""


ARM = JointIndex().arm

LEVERS = ("friction_radius_m", "offset_m")
"""Lengths that convert a force, known from the masses in the rig file, to a torque: they scale like torques."""

_UNIT_SUFFIX = re.compile(r"(_(per|Nms?|m2?|rad3?|s2?|kg(m2)?|Hz))+$")
"""Unit at the end of a parameter's name."""

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
"""Unit of an amplitude -> unit of its ratio to b^k."""


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
    """Physically possible values."""
    role: Literal["amplitude", "shape"] = "amplitude"
    default: float = 0.0
    """Default of a shape parameter; zero for an amplitude."""
    scan: tuple[float, ...] = ()
    """Values of a shape parameter to try before it is refined; empty: those of the recording (runs, instants)."""
    draw: tuple[float, float] | None = None
    """Range of a shape parameter in blind trials; None: from a third of its default to three times it."""
    whole: bool = False
    """Whether only integers are physical; the absolute value of an amplitude is then at least one."""
    one_way: bool = False
    """Whether blind trials draw this amplitude positive although both signs are physical, because a negative one
    would drive the rods.
    """
    continuous: bool = False
    """Whether a shape parameter is refined after its scan; false for orders and instants."""
    negative: str = ""
    """Meaning of a negative value: `friction falls during the swing`."""
    label: str = ""
    """Name in tables and sentences; empty: `name` without its unit."""
    most: float = math.inf
    """Maximum size of an amplitude on any rig, in `unit`; inf: relative to the rig, by `limit`."""
    limit: str = ""
    """Key of `dpr_lab.effects.limits.LIMITS`; empty: the unit is the key."""
    plausible: float | None = None
    """Scale of the prior of an amplitude, in `unit`: larger sizes are rare (`dpr_lab.effects.plausibility`). None:
    three times the typical size.
    """

    @property
    def words(self) -> str:
        """Name for readers: `extra at rest` of `extra_at_rest_Nm`."""
        return self.label or _UNIT_SUFFIX.sub("", self.name).replace("_", " ")

    @property
    def prior_scale(self) -> float:
        """Scale of the prior of an amplitude, in `unit`."""
        return 3.0 * self.typical if self.plausible is None else self.plausible

    @property
    def scale_power(self) -> int:
        """Power k of the common scale of torques and inertias: a free swing determines its ratio to b^k.

        1 for a torque or an inertia, -1 for 1/kg, 0 for angles, times and shapes.
        """
        if self.role == "shape":
            return 0
        if self.unit.startswith("1/kg"):
            return -1
        return int(self.unit.startswith(("N m", "kg")) or self.name in LEVERS)

    @property
    def ratio_unit(self) -> str:
        """Unit of its ratio to b^k; empty if k is 0. A unit that is not simplified here is divided by that of b^k."""
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
    """A positive shape parameter whose typical size is its default.

    Args:
        name: name with unit
        unit: SI unit
        default: value while it is not fitted
        scan: values to try first; for a continuous parameter in equal ratios, as initial values of its fit
        draw: range in blind trials
        whole: whether it is an integer
        continuous: whether it is fitted after the scan

    Raises:
        ValueError: a continuous shape with fewer than two values in `scan`.
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
    """Name of the quantity: `extra friction at rest`."""
    symbol: str
    """Symbol in the equation of the effect."""
    parameters: tuple[str, ...]
    """Measured amplitude; for several amplitudes the root of the sum of their squares (cosine and sine: the peak)."""
    definition: str = ""
    """Exact definition if the name is ambiguous."""


@dataclass(frozen=True, slots=True)
class InternalState:
    """Internal state of an effect, which depends on the previous motion."""

    name: str
    """Kernel argument for its value at the start of the step."""
    unit: str
    at_release: float = 0.0
    after: Callable[..., float] | None = None
    """Transition over a displacement of the effect's joint in one direction: a kernel with the arguments state,
    `displacement` (rad) and parameters. None if the stage defines it: backlash is its own transition, and an arm
    moves by the equation of the whole rig.
    """
    sliding: Callable[[float], float] | None = None
    """Kernel for its value at the start of a run that begins after the release, from the speed of the joint, rad/s.
    None: as at the release.
    """


@dataclass(frozen=True, slots=True)
class Recorded:
    """Candidates from the recordings for shape parameters without a grid."""

    arm_moves: tuple[bool | None, ...]
    """For each run: whether encoder 0 detected a motion of the arm; None if it was not measured."""
    steps: Callable[[], list[tuple[int, int, float]]]
    """Joint (0 or 1), run and instant (s) of apparent steps in the readings, best first."""


Words = Mapping[str, Any]
"""An effect as elements that rigid-body programs share; each refers to the effect's joint or rod, SI.

    friction                 Coulomb friction, N m
    stiffness, rest_angle    a linear spring, N m/rad, and its rest angle, rad from hanging
    armature                 inertia that turns with the joint, kg m^2
    cogging                  (amplitude N m, poles, phase rad) of each torque amplitude sin(poles q + phase)
    presliding               (torque N m, length rad) of friction that is elastic before sliding
    offset                   of the rod's centre of mass across the rod, m
    added_length             length error of the inner rod, m
    tilt                     of gravity in the plane of the rods, rad
    arm                      True: the arm is free with the constants of `arm_model`
    encoder_offset, encoder_scale    offset of the joint's encoder, rad, and its relative scale error
"""


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect."""

    name: str
    words: str
    """Title: `Coulomb friction, joint 1`."""
    equation: str
    """Contribution with the symbols of docs/theory.md: torques on theta1, theta2, or changes of the readings."""
    parameters: tuple[EffectParameter, ...]
    site: Site
    stage: StageName
    kernel: Callable[..., Any]
    bench_check: str
    """Check on the rig that confirms it, or distinguishes it from its twins."""
    source: str
    symptom: str = ""
    """Symptom at the rig or in a recording; required for effects of the library."""
    joints: tuple[int, ...] = (0, 1)
    """The joints (0, 1, `ARM`) whose angle and speed it may depend on; both joints of the rods if it belongs to
    none.
    """
    internal: tuple[InternalState, ...] = ()
    dissipative: bool = False
    """Whether it can only dissipate energy of the rods (presliding returns at most the stored energy)."""
    dry: bool = False
    """Whether it is Coulomb friction: proportional to `Joint.direction` apart from its dependence on speed. At rest
    it transmits the torque that keeps the joint at rest, up to its torque at zero speed.
    """
    potential: bool = False
    """Whether its torque is a function of the joint's angle alone."""
    presumes_still_arm: bool = False
    """Whether it describes only rigs whose arm does not move."""
    event: bool = False
    """Whether it occurs once in one recording and is not a property of the rig."""
    twins: tuple[str, ...] = ()
    """Effects that are indistinguishable from this one by free swings, or nearly so."""
    nested: tuple[str, ...] = ()
    """Simpler effects, preferred if they explain the recordings equally well."""
    adds: str = ""
    """Amplitude that the simpler effects lack, if it can be measured."""
    quantities: tuple[BenchQuantity, ...] = ()
    """Measurable quantities: the first for the effect itself; for `adds` the one with this amplitude. None: the
    amplitudes, by their names.
    """
    absorbed_by: tuple[str, ...] = ()
    """Base parameters that absorb this effect completely, so that a free swing cannot show it."""
    corrects: str = ""
    """Number of the description that it corrects: a key of the rig file, or `t`, the times of the readings. Always
    fitted if the rig file states its uncertainty (`Rig.unsure`).
    """
    universal: bool = False
    """Whether every rig has it to some degree, so that it needs no other explanation."""
    propose: Callable[[Recorded], list[dict[str, float]] | None] | None = None
    """Shape parameters to try on these recordings, by name; []: none; None: the grid of `scan`."""
    longest_step: Callable[[Params], float] | None = None
    """Longest integration step, s; None: as for the rods."""
    hides_step: Callable[[Params], float] | None = None
    """Largest step of its joint's readings, rad, that it explains; None: it explains none."""
    possible: Callable[[Params], bool] = lambda sizes: True
    """Whether its sizes, each within its limit, can occur together."""
    remedy: Callable[[Params, RigConstants, int], str] | None = None
    """Correction of the rig, its file or its readings, from parameters, rig and joint (0, 1); None: it is not a
    fault, and a simulator must include it.
    """
    implied: Callable[[Params], Params] | None = None
    """Derived quantities that are reported with its parameters, by name; {} if there are none."""
    derived: tuple[EffectParameter, ...] = ()
    """Their units."""
    exported: Callable[[Params], Words] | None = None
    """Function that returns the effect as such elements; None, or {} if there are no such elements for these
    parameters: other programs then call its kernel or omit it.
    """

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Parameters that are zero if the effect is off."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "amplitude")

    def bench_quantity(self, parameter: str) -> BenchQuantity:
        """Measured quantity that contains an amplitude."""
        containing = (quantity for quantity in self.quantities if parameter in quantity.parameters)
        return next(containing, BenchQuantity(parameter, parameter, (parameter,)))

    @property
    def driven(self) -> bool:
        """Whether the effect belongs to a drive and does not affect free swings."""
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
        fields: the other fields of `Effect`
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


ARM_STAGES: dict[StageName, StageName] = {
    "torque": "torque0",
    "drive": "drive0",
    "encoder": "encoder0",
    "timing": "timing0",
}
"""Stage of an effect at a rod's joint -> that of the same effect at the arm."""


def at_arm(effect: Effect, *, bench_check: str, symptom: str = "", equation: str = "", **fields: Any) -> Effect:
    """Copy of an effect of a rod for joint 0, the joint of a free or driven arm.

    Args:
        effect: at joint 1 or 2
        bench_check: the check at the arm
        symptom: the symptom at the arm
        equation: None: that of the other joint with another number
        fields: other fields of `Effect` that differ
    """
    (joint,) = effect.joints

    def renamed(text: str) -> str:
        for word in ("_joint", "joint ", "encoder ", "q"):
            text = text.replace(f"{word}{joint + 1}", f"{word}0")
        return text

    return replace(
        effect,
        **{
            "name": renamed(effect.name),
            "words": renamed(effect.words),
            "equation": equation or renamed(effect.equation),
            "joints": (ARM,),
            "stage": ARM_STAGES[effect.stage],
            "twins": tuple(map(renamed, effect.twins)),
            "nested": tuple(map(renamed, effect.nested)),
            "symptom": symptom,
            "bench_check": bench_check,
            **fields,
        },
    )

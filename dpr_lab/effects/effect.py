"""Effects: physical causes of a difference between simulation and rig, each as data and one kernel."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName

Site = Literal["joint torque", "geometry", "base", "sensor", "timing", "drive"]

Params = Mapping[str, float]
"""Parameters of one effect by name, SI."""

Shape = tuple[tuple[int, float], ...]
"""Shape parameters as (index in the flat vector, value)."""


LEVERS = ("friction_radius_m", "offset_m")
"""Lengths that turn a force, known from the rig file's masses, into a torque: they scale as torques do."""


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
    """One coefficient.

    An amplitude of zero does nothing; an effect all of whose amplitudes are zero is off, for any shape parameters.
    """

    name: str
    """Name with the unit, as in `torque_Nm`."""
    unit: str
    typical: float
    """Size met on a laboratory rig, in `unit`."""
    sign: Literal["any", "positive"] = "any"
    """Which values are physical."""
    role: Literal["amplitude", "shape"] = "amplitude"
    default: float = 0.0
    """Default of a shape parameter; zero for an amplitude."""
    scan: tuple[float, ...] = ()
    """Values of a shape parameter to try before refining; empty: those of the recording (runs, instants)."""
    draw: tuple[float, float] | None = None
    """Range from which a blind trial draws a shape parameter; None: a third of its default to three times it."""
    whole: bool = False
    """Only whole values are physical; of an amplitude none below one in size."""
    one_way: bool = False
    """Blind trials draw this amplitude positive though either sign is physical: the other would drive the rods."""
    continuous: bool = False
    """Whether a shape parameter is refined after its scan; orders and instants are not."""
    negative: str = ""
    """Meaning of a negative value: `friction falls during the swing`."""
    most: float = math.inf
    """Largest possible size of an amplitude on any rig, in `unit`; inf: relative to the rig, by `limit`."""
    limit: str = ""
    """Key of `dpr_lab.effects.limits.LIMITS`; empty: the unit."""
    plausible: float | None = None
    """Scale of the prior of an amplitude, in `unit`: sizes beyond it are rare (`dpr_lab.effects.plausibility`). None:
    three times the typical size."""

    @property
    def prior_scale(self) -> float:
        """Scale of the prior of an amplitude, in `unit`."""
        return 3.0 * self.typical if self.plausible is None else self.plausible

    @property
    def scale_power(self) -> int:
        """Power k of the common scale of torques and inertias in it: a free swing shows its ratio to b^k.

        1 for a torque or an inertia, -1 for 1/kg, 0 for angles, times and shapes.
        """
        if self.role == "shape":
            return 0
        if self.unit.startswith("1/kg"):
            return -1
        return int(self.unit.startswith(("N m", "kg")) or self.name in LEVERS)

    @property
    def ratio_unit(self) -> str:
        """Unit of its ratio to b^k; empty where k is 0."""
        return _RATIO_UNITS[self.unit] if self.scale_power else ""

    @property
    def has_ratio_unit(self) -> bool:
        """Whether the unit of its ratio is known, or none is needed."""
        return not self.scale_power or self.unit in _RATIO_UNITS


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
    """A shape parameter, positive, whose typical size is its default.

    Args:
        name: with its unit
        unit: in words of SI
        default: where it stands while it is not fitted
        scan: values to try first; of a continuous one in equal ratios, which is where its fit begins
        draw: between which values a blind trial draws it
        whole: a number of things
        continuous: fitted after the scan

    Raises:
        ValueError: a continuous shape without at least two values to begin at.
    """
    if continuous and len(scan) < 2:
        raise ValueError(f"{name}: a continuous shape needs two values or more in `scan`")
    return EffectParameter(
        name,
        unit,
        default,
        "positive",
        "shape",
        default,
        scan,
        draw=draw,
        whole=whole,
        continuous=continuous,
    )


@dataclass(frozen=True, slots=True)
class BenchQuantity:
    """Quantity of an effect that can be measured on the bench."""

    words: str
    """Name of the quantity: `extra friction at rest`."""
    symbol: str
    """As in the equation of the effect."""
    parameters: tuple[str, ...]
    """The amplitude that is measured; of several the root of the sum of their squares (cosine and sine: the peak)."""
    definition: str = ""
    """Exact definition, where the name is ambiguous."""


@dataclass(frozen=True, slots=True)
class InternalState:
    """Internal state of an effect: it depends on the motion so far."""

    name: str
    """Kernel argument that receives its value at the start of the step."""
    unit: str
    at_release: float = 0.0
    after: Callable[..., float] | None = None
    """Transition over a displacement of the effect's joint in one direction: a kernel that may ask for the state,
    `displacement` (rad) and parameters. None where the stage defines it: backlash is its own transition, and an arm
    moves by the equation of the whole rig."""
    sliding: Callable[[float], float] | None = None
    """Kernel for its value in a run that is first seen after the release, from the joint's speed, rad/s. None: as at
    the release."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """Candidates from the recordings for shape parameters that no grid covers."""

    arm_moves: tuple[bool | None, ...]
    """By run: whether encoder 0 saw the arm move; None where it was not read."""
    steps: Callable[[], list[tuple[int, int, float]]]
    """Joint (0 or 1), run and instant (s) of apparent steps in the readings, the best first."""


Words = Mapping[str, Any]
"""An effect in the terms that programs for rigid bodies share; each belongs to the effect's joint or rod, SI.

    friction                 dry friction, N m
    stiffness, rest_angle    a linear spring, N m/rad, and where it rests, rad from hanging straight
    armature                 inertia that turns with the joint, kg m^2
    cogging                  (amplitude N m, poles, phase rad) of each torque amplitude sin(poles q + phase)
    presliding               (torque N m, length rad) of friction that gives way like a spring first
    offset                   of the rod's centroid across the rod, m
    added_length             how much longer the inner rod is than was measured, m
    tilt                     of gravity in the plane of the rods, rad
    arm                      True: the arm is free on what `arm_model` says
    encoder_offset, encoder_scale    what the joint's encoder adds, rad, and its excess over the angle from hanging
"""


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect."""

    name: str
    words: str
    """Title for people: `Coulomb friction, joint 1`."""
    equation: str
    """Its contribution, in the symbols of docs/theory.md: torques on theta1, theta2, or changes of what is read."""
    parameters: tuple[EffectParameter, ...]
    site: Site
    stage: StageName
    kernel: Callable[..., Any]
    bench_check: str
    """What to do at the rig to confirm it, or to distinguish it from its twins."""
    source: str
    joints: tuple[int, ...] = (0, 1)
    """The joints (0, 1) whose angle and speed it may depend on; both where it belongs to none."""
    internal: tuple[InternalState, ...] = ()
    dissipative: bool = False
    """Whether it can only take energy out of the rods (presliding gives back no more than it has stored)."""
    dry: bool = False
    """Whether it is dry friction: proportional to `Joint.direction` apart from its dependence on speed. At rest it
    transmits the torque that keeps the joint at rest, up to its torque at speed zero."""
    potential: bool = False
    """Whether its torque is a function of the joint's angle alone."""
    event: bool = False
    """Whether it happens once in one recording and is no property of the rig."""
    twins: tuple[str, ...] = ()
    """Effects that are indistinguishable from this one by free swings, or nearly so."""
    nested: tuple[str, ...] = ()
    """Simpler effects, preferred where they explain the recordings as well."""
    adds: str = ""
    """The amplitude that the simpler effects lack, where it can be measured."""
    quantities: tuple[BenchQuantity, ...] = ()
    """What can be measured of it on the bench: the first for the effect itself; of `adds` the one that has it. None:
    the amplitudes, by their names."""
    absorbed_by: tuple[str, ...] = ()
    """Base parameters that absorb this effect exactly, so that a free swing cannot show it."""
    corrects: str = ""
    """Key of the rig file that it corrects; always fitted where the file states an uncertainty (`Rig.unsure`)."""
    propose: Callable[[Recorded], list[dict[str, float]] | None] | None = None
    """Shape parameters to try on these recordings, by name; []: none; None: the grid of `scan`."""
    longest_step: Callable[[Params], float] | None = None
    """Longest integration step, s; None: as long as the rods allow."""
    hides_step: Callable[[Params], float] | None = None
    """Largest step of joint 2's readings, rad, that it explains by itself; None: it explains none."""
    remedy: Callable[[Params, RigConstants, int], str] | None = None
    """What to correct at the rig, in its file or in its readings, from parameters, rig and joint (0, 1); none: it is no
    fault, and a simulator has to include it."""
    implied: Callable[[Params], Params] | None = None
    """Quantities derived from the parameters that are reported with them, by name; {} where there are none."""
    exported: Callable[[Params], Words] | None = None
    """The effect in these terms; none, or {} where these parameters have none: other programs call its kernel, or
    omit it."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The parameters that are zero when the effect is off."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "amplitude")

    def bench_quantity(self, parameter: str) -> BenchQuantity:
        """The measured quantity that an amplitude is part of."""
        own = (quantity for quantity in self.quantities if parameter in quantity.parameters)
        return next(own, BenchQuantity(parameter, parameter, (parameter,)))

    @property
    def driven(self) -> bool:
        """Whether it belongs to a drive, so that free swings are independent of it."""
        return self.stage in ("drive", "input")

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """The shape parameters."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "shape")


def pair(
    family: str,
    *,
    words: str,
    equation: str,
    bench_check: str,
    nested: tuple[str, ...] = (),
    twins: tuple[str, ...] = (),
    site: Site = "joint torque",
    **fields: Any,
) -> list[Effect]:
    """Create the same effect for both joints: FAMILY_joint1 and FAMILY_joint2.

    Args:
        family: name without the joint
        words: {j} in them stands for the number of the joint
        equation: likewise
        bench_check: likewise
        nested: families of simpler effects at the same joint
        twins: families of effects at the same joint that look alike
        site: as of `Effect`
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
            **fields,
        )
        for j in (1, 2)
    ]

"""Tables of a rig file, with the range and meaning of each key."""

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from dpr_lab.arrays import Array
from dpr_lab.errors import printable
from dpr_lab.joint_angles import JointAngles
from dpr_lab.shown import listed

Positive = Annotated[float, Field(gt=0, le=1e6, strict=True)]
"""Positive number, SI units, at most 1e6."""


def _shown(name: str) -> str:
    if printable(name) != name or not name.isprintable():
        raise ValueError("contains characters that cannot be displayed")
    return name


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_shown)]


def _in_metres(value: Any) -> Any:
    if isinstance(value, int | float) and value > 10:
        raise ValueError(f"is too large for a length in m; {value:g} mm is {value / 1000:g} m")
    return value


def _in_radians(value: Any) -> Any:
    if isinstance(value, int | float) and abs(value) > 100:
        raise ValueError(f"is too large for an angle in rad; {value:g} degrees are {math.radians(value):.4g} rad")
    return value


Length = Annotated[float, Field(gt=0, le=10, strict=True), BeforeValidator(_in_metres)]
"""Length, m: positive, at most 10 m."""
Angle = Annotated[float, Field(ge=-100, le=100, strict=True), BeforeValidator(_in_radians)]
"""Angle, rad: between -100 and 100, which is several turns."""


class RigTable(BaseModel):
    """Table of a TOML file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True, allow_inf_nan=False)


class Parameter(RigTable):
    """Kinetic parameter: searched between bounds, or measured with a standard uncertainty."""

    nominal: Positive
    """Nominal value: initial value of a search and of a diagnosis."""
    lower: Positive | None = None
    """Lower bound of the search. Both bounds may be omitted if the value is measured. The lower bound of a friction
    coefficient that may be zero must be small but positive, for example 1e-6, because the search works with ratios."""
    upper: Positive | None = None
    """Upper bound of the search."""
    measured: Positive | None = None
    """Value measured with a balance or a calliper. The search does not change it. The measured mass and centre of mass
    of the outer rod (m2 and l2) together determine the scale of all masses, inertias and torques; one mass does not.
    """
    std: Positive | None = None
    """Standard uncertainty of `measured`."""

    @model_validator(mode="after")
    def _consistent(self) -> "Parameter":
        if (self.measured is None) != (self.std is None):
            raise ValueError("a measured value needs its standard uncertainty: give both measured and std")
        if (self.lower is None) != (self.upper is None):
            raise ValueError("give both lower and upper")
        if self.lower is None and self.measured is None:
            raise ValueError("needs bounds (lower, upper) to search between, or a measured value with its std")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError(f"bounds are reversed or equal: lower = {self.lower}, upper = {self.upper}")
        return self


CountsPerRev = Annotated[int, Field(ge=4, le=1 << 31, strict=True)]
Count = Annotated[int, Field(ge=-(1 << 31), lt=1 << 31, strict=True)]
"""Integer in the range of a 32-bit counter."""


class Encoders(RigTable):
    """Conversion of counts to angles.

    theta_i = zero_i + direction_i * (counts_i - zero_counts_i) * 2 pi / counts_per_rev_i, where zero_i is the
    angle in the hanging position (pi for the rods, 0 for the arm and for a relative joint 2).
    """

    counts_per_rev: tuple[CountsPerRev, CountsPerRev, CountsPerRev] = (16384, 16384, 16384)
    """Counts per turn of the encoders of arm, inner and outer rod; they must equal those that the device reports."""
    noise_counts: Annotated[float, Field(ge=0, le=1e6, strict=True)] = 0.5
    """Standard deviation of a reading at rest, without rounding, counts."""
    joint2: Literal["relative", "absolute"] = "relative"
    """Reference of the encoder of joint 2: the inner rod (`relative`), or the arm (`absolute`)."""
    zero_counts: tuple[Count, Count, Count] = (0, 0, 0)
    """Readings with the rods hanging and the arm at 0, counts; `capture` warns if the actual readings differ."""
    direction: tuple[Literal[-1, 1], Literal[-1, 1], Literal[-1, 1]] = (1, 1, 1)
    """Sign of the counts: 1, or -1 for an encoder that counts backwards."""
    rezeroed: bool = False
    """Whether the encoders of joints 1 and 2 are zeroed before each recording, as for incremental encoders without
    an index. Coulomb friction holds a hanging rod away from the vertical, so each recording then has its own
    zeros, which are fitted.
    """

    @property
    def joint_angles(self) -> JointAngles:
        """Map between absolute rod angles and the angles of the encoders."""
        return JointAngles(self.joint2 == "relative")


class Pose(RigTable):
    """Pose of the rods before a release.

    Angles are absolute, rad, with 0 = upright and pi = hanging.
    """

    theta0: Angle = 0.0
    """Angle of the arm, rad."""
    theta1: Angle
    """Angle of the inner rod, rad."""
    theta2: Angle
    """Angle of the outer rod, rad."""
    tolerance: Positive = 0.05
    """Permitted deviation of each angle from the pose at the release, rad."""

    @property
    def theta(self) -> Array:
        """(3,) angles of arm, inner and outer rod, rad."""
        return np.array([self.theta0, self.theta1, self.theta2])


class AddedMass(RigTable):
    """Known point mass on a rod.

    An additional release with this mass determines the scale of all masses.
    """

    rod: Literal["inner", "outer"]
    """Rod to which the mass is attached."""
    mass: Positive
    """Attached mass, kg."""
    position: Positive
    """Distance of the mass from the pivot of this rod, m."""


Mounting = Literal["both", "inner", "outer", "clamped"]
"""Moving parts: both rods, the inner or outer rod alone on joint 1, or both rods with a clamped elbow."""


class Rods(RigTable):
    """Rods that are mounted during recordings.

    A single rod is mounted on joint 1 and measured by encoder 1. The encoder of joint 2 is mounted on the inner rod and
    is removed with it; its reading is ignored. With a clamped elbow, a capture compares theta1 with the pose; the angle
    of the clamp may differ from that of the pose by 0.2 rad.
    """

    mounted: Literal["both", "inner", "outer"] = "both"
    """Mounted rods."""
    elbow: Literal["free", "clamped"] = "free"
    """Whether joint 2 is free or clamped."""

    @model_validator(mode="after")
    def _consistent(self) -> "Rods":
        if self.mounted != "both" and self.elbow == "clamped":
            raise ValueError(f"a single rod (mounted = {self.mounted}) has no elbow to clamp: set elbow = free")
        return self

    @property
    def mounting(self) -> Mounting:
        """Mounted rods and mode of the elbow as one value."""
        return "clamped" if self.elbow == "clamped" else self.mounted

    @property
    def number(self) -> int:
        """Number of mounted rods, 1 or 2."""
        return 2 if self.mounted == "both" else 1

    @property
    def placed(self) -> int:
        """Number of angles to set at a pose: one for a single rod or a clamped elbow."""
        return 2 if self.mounting == "both" else 1

    @property
    def names(self) -> tuple[str, str]:
        """Names of the rods at theta1 and theta2.

        For a single rod both names are equal.
        """
        return ("inner rod", "outer rod") if self.number == 2 else (f"{self.mounted} rod", f"{self.mounted} rod")


InnerMode = Literal["free", "prescribed"]
"""Mode of the inner rod. `free`: it swings freely. `prescribed`: its encoder gives its motion, which a strong geared
motor or a hand causes."""


class Joints(RigTable):
    """Modes and components of the joints of the rods during a swing."""

    inner: InnerMode = "free"
    """`prescribed`: the encoder of joint 1 gives its motion, and its torque need not be known; the outer rod alone is
    identified. A run stores this mode; `import table --inner` overrides the mode for one recording."""

    geared: tuple[Literal[1, 2], ...] = ()
    """Joints with a geared motor, driven or not. The model of a diagnosis then contains the Coulomb and load-dependent
    friction of these joints, and the rotor inertia of joint 2."""


ArmMode = Literal["clamped", "free", "prescribed", "driven"]
"""Motion of the arm: clamped, free, prescribed by its encoder, or driven by a known input."""


class ArmTable(RigTable):
    """The arm during a swing.

    A run stores this table. `import table --arm` overrides the mode for one recording.
    """

    mode: ArmMode = "clamped"
    """`free` and `driven` need `L0` in `[rig]`; `driven` needs `[motor]`. `prescribed`: the arm is moved by hand or
    by a stiff servo, and only its encoder reading is known.
    """
    A: Parameter | None = None
    """Total inertia about the arm's axis, J0 + (m1 + m2 + mb) L0^2, kg m^2; initial value of the fit."""
    c0: Parameter | None = None
    """Viscous friction of the arm, N m s/rad."""
    k0: Parameter | None = None
    """Stiffness of a cable or spring at the arm, N m/rad; fitted only if given."""
    f0: Parameter | None = None
    """Coulomb friction of the arm, N m; fitted only if given."""
    limits: tuple[Angle, Angle] | None = None
    """Angles between which the arm can turn, rad: a capture does not release the rods while the arm is outside."""

    @model_validator(mode="after")
    def _ordered(self) -> "ArmTable":
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise ValueError(f"limits are reversed or equal: {self.limits[0]:g}, {self.limits[1]:g}")
        return self


INPUT_UNITS = {"torque": "N m", "current": "A", "voltage": "V", "acceleration": "rad/s²"}
"""Units of the possible inputs of the arm's drive."""


class MotorTable(RigTable):
    """Drive of the arm, with the constants of its motor.

    None of the constants is needed to identify ratios.
    """

    input: Literal["torque", "current", "voltage", "acceleration"]
    """Quantity in the input column: torque at the joint (N m), current (A), voltage (V), or acceleration of the arm
    (rad/s^2).
    """
    kt: Parameter | None = None
    """Torque constant, N m/A; with a current as input it makes absolute sizes identifiable."""
    ke: Parameter | None = None
    """Back-EMF constant of a voltage drive, V s/rad."""
    R: Parameter | None = None
    """Resistance of a voltage drive, ohm."""
    gear: Positive = 1.0
    """Turns of the motor per turn of the arm."""

    @model_validator(mode="after")
    def _constants_of_input(self) -> "MotorTable":
        used = {"voltage": ("kt", "ke", "R"), "current": ("kt",)}.get(self.input, ())
        unused = [name for name in ("kt", "ke", "R") if getattr(self, name) is not None and name not in used]
        if unused:
            verb, which = ("have", "them") if len(unused) > 1 else ("has", "it")
            raise ValueError(f"input is {self.input}, for which {listed(unused)} {verb} no meaning: remove {which}")
        return self


class LinkSettings(RigTable):
    """Address and sample rate of the device."""

    url: str = "sim://"
    """Link to the device if no `--link` is given."""
    rate_hz: Annotated[int, Field(gt=0, le=10_000, strict=True)] = 1000
    """Sample rate, Hz."""


class RigGeometry(RigTable):
    """Measured and fixed quantities: lengths in m, gravity in m/s^2."""

    name: Name
    """Name stored in runs and models. A run can be used only with a rig file of the same name and encoders."""
    L0: Length = 0.3
    """Length of the arm, m; it has no influence on a swing with a clamped arm."""
    L1: Length
    """Distance between the two joints along the inner rod, m."""
    L1_std: Length | None = None
    """Standard uncertainty of L1 if it is poorly known, for example from a video: a diagnosis then fits L1."""
    L0_std: Length | None = None
    """Standard uncertainty of L0 if it is poorly known: the identification of a moving arm then fits L0."""
    L2: Length | None = None
    """Length of the outer rod, m; used for drawings and exports only."""
    g: Annotated[float, Field(ge=0.1, le=100, strict=True)] = 9.81
    """Gravity, m/s^2; on earth 9.76 to 9.84."""

    EARTH: ClassVar[tuple[float, float]] = (9.76, 9.84)
    """Range of gravity at the surface of the earth, m/s^2: from high mountains near the equator to the poles."""

    MOST_KG_PER_M: ClassVar[float] = 100.0
    """Maximum mass per length of a rod, kg/m, that of a steel bar of 127 mm diameter; a larger mass is in grams."""

    @classmethod
    def on_earth(cls, g: float) -> bool:
        """Return whether a gravitational acceleration, m/s^2, occurs at the surface of the earth."""
        return cls.EARTH[0] <= g <= cls.EARTH[1]

    @property
    def compared_g(self) -> str:
        """Text that compares gravity with its range on earth."""
        return "{:g} m/s^2; on earth it is {:g} to {:g}".format(self.g, *self.EARTH)

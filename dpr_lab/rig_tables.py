"""The tables of a rig file: what each key may be, and what it means."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from dpr_lab.errors import printable
from dpr_lab.joint_angles import JointAngles

Positive = Annotated[float, Field(gt=0, le=1e6, strict=True)]
"""SI; nothing on a bench is larger."""


def _shown(name: str) -> str:
    if printable(name) != name or not name.isprintable():
        raise ValueError("holds characters that cannot be shown")
    return name


Name = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_shown)]
Length = Annotated[float, Field(gt=0, le=10, strict=True)]
"""m, of a rig on a bench: one in millimetres is seen."""
Angle = Annotated[float, Field(ge=-100, le=100, strict=True)]
"""rad: some turns at most."""


class RigTable(BaseModel):
    """A table of a TOML file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class Parameter(RigTable):
    """One kinetic parameter: searched for between bounds, or measured with a standard uncertainty."""

    nominal: Positive
    """The best guess: where a search and a diagnosis start."""
    lower: Positive | None = None
    """Of the search, together with `upper`; both may be left out where the value is measured. A friction that may be
    none is given a small one, such as 1e-6: the search works with ratios."""
    upper: Positive | None = None
    """Of the search, together with `lower`."""
    measured: Positive | None = None
    """Value measured with a balance or a calliper: the search holds it, and the scale of the result rests on it."""
    std: Positive | None = None
    """Standard uncertainty of `measured`."""

    @model_validator(mode="after")
    def _consistent(self) -> "Parameter":
        if (self.measured is None) != (self.std is None):
            raise ValueError("measured and std go together: a measured value needs its standard uncertainty")
        if (self.lower is None) != (self.upper is None):
            raise ValueError("lower and upper go together")
        if self.lower is None and self.measured is None:
            raise ValueError("needs bounds (lower, upper) to search between, or a measured value with its std")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError(f"bounds are reversed or equal: lower = {self.lower}, upper = {self.upper}")
        return self


CountsPerRev = Annotated[int, Field(ge=4, le=1 << 31, strict=True)]
Count = Annotated[int, Field(ge=-(1 << 31), lt=1 << 31, strict=True)]
"""What a 32-bit counter can say."""


class Encoders(RigTable):
    """Conversion of counts to angles.

    theta_i = zero_i + direction_i * (counts_i - zero_counts_i) * 2 pi / counts_per_rev_i, where zero_i is the
    hanging rest (pi for the rods, 0 for the arm and for a relative joint 2).
    """

    counts_per_rev: tuple[CountsPerRev, CountsPerRev, CountsPerRev] = (16384, 16384, 16384)
    """Of arm, inner and outer rod, as the device says it too."""
    noise_counts: Annotated[float, Field(ge=0, le=1e6, strict=True)] = 0.5
    """Standard deviation of a reading at rest, counts; limits of rest and rounding come from it."""
    joint2: Literal["relative", "absolute"] = "relative"
    """Whether the encoder of joint 2 reads the outer rod against the inner one, or against the arm."""
    zero_counts: tuple[Count, Count, Count] = (0, 0, 0)
    """What the encoders read with the rods hanging and the arm at 0; capture warns when they do not."""
    direction: tuple[Literal[-1, 1], Literal[-1, 1], Literal[-1, 1]] = (1, 1, 1)
    """-1 for an encoder that counts backwards."""
    rezeroed: bool = False
    """Whether the zeros of joints 1 and 2 are set again before each recording, as those of an encoder that only counts:
    dry friction holds a hanging rod aside, and each recording then has zeros of its own, which are fitted."""

    @property
    def joint_angles(self) -> JointAngles:
        """The map between absolute rod angles and what the encoders turn by."""
        return JointAngles(self.joint2 == "relative")


class Pose(RigTable):
    """Pose of the rods before a release: absolute angles, 0 = upright, pi = hanging, rad."""

    theta0: Angle = 0.0
    """The arm, rad."""
    theta1: Angle
    """The inner rod, rad."""
    theta2: Angle
    """The outer rod, rad."""
    tolerance: Positive = 0.05
    """How far a rod may be off when it is let go, rad."""

    @property
    def theta(self) -> NDArray[np.float64]:
        """(3,) angles of arm, inner and outer rod, rad."""
        return np.array([self.theta0, self.theta1, self.theta2])


class AddedMass(RigTable):
    """A known mass clamped to a rod, as good as a point: one more release with it fixes the scale of all masses."""

    rod: Literal["inner", "outer"]
    """Which rod carries it."""
    mass: Positive
    """kg"""
    position: Positive
    """Distance from that rod's pivot, m."""


Mounting = Literal["both", "inner", "outer", "clamped"]
"""What swings: both rods, the inner or the outer one alone on joint 1, or both with the elbow clamped."""


class Rods(RigTable):
    """Which rods hang on the rig while it is recorded. One alone hangs on joint 1, and encoder 1 reads it.

    The encoder of joint 2 stays on the inner rod, and comes off with it.
    """

    mounted: Literal["both", "inner", "outer"] = "both"
    """Which rods hang on it."""
    elbow: Literal["free", "clamped"] = "free"
    """Whether joint 2 can turn."""

    @model_validator(mode="after")
    def _consistent(self) -> "Rods":
        if self.mounted != "both" and self.elbow == "clamped":
            raise ValueError(f"one rod alone has no elbow to clamp: mounted is {self.mounted}")
        return self

    @property
    def mounting(self) -> Mounting:
        """Mounted rods and elbow as one value."""
        return "clamped" if self.elbow == "clamped" else self.mounted


class Joints(RigTable):
    """What is on the joints while the rods swing."""

    geared: tuple[Literal[1, 2], ...] = ()
    """Joints that a geared motor stays on, driven or not: a diagnosis then expects its rotor and its friction."""


ArmMode = Literal["clamped", "free", "prescribed", "driven"]
"""What the arm does: it is held, moves by itself, moves as its encoder says, or a known input acts on it."""


class ArmTable(RigTable):
    """What the arm does while the rods swing. A run keeps it; `import table --arm` overrides it for one recording."""

    mode: ArmMode = "clamped"
    """`free` and `driven` need `L0` in `[rig]`; `driven` needs `[motor]`. `prescribed`: a hand or a stiff servo moves
    the arm, and only its encoder is known."""
    A: Parameter | None = None
    """Total inertia about the arm's axis, J0 + (m1 + m2 + mb) L0^2, kg m^2; where the fit starts."""
    c0: Parameter | None = None
    """Viscous friction of the arm, N m s/rad."""
    k0: Parameter | None = None
    """Stiffness of a cable or spring at the arm, N m/rad; fitted only where it is given."""
    f0: Parameter | None = None
    """Dry friction of the arm, N m; fitted only where it is given."""


class MotorTable(RigTable):
    """What drives the arm, and the constants of its motor; none of them is needed to identify ratios."""

    input: Literal["torque", "current", "voltage", "acceleration"]
    """What the recording's input column holds: N m at the joint, A, V, or rad/s^2 of the arm."""
    kt: Parameter | None = None
    """Torque constant, N m/A: with a current it makes absolute sizes visible."""
    ke: Parameter | None = None
    """Back-EMF constant, V s/rad, of a voltage drive."""
    R: Parameter | None = None
    """Resistance, ohm, of a voltage drive."""
    gear: Positive = 1.0
    """Turns of the motor for one turn of the arm."""

    @model_validator(mode="after")
    def _constants_of_input(self) -> "MotorTable":
        used = {"voltage": ("kt", "ke", "R"), "current": ("kt",)}.get(self.input, ())
        unused = [name for name in ("kt", "ke", "R") if getattr(self, name) is not None and name not in used]
        if unused:
            raise ValueError(f"input is {self.input}, which {', '.join(unused)} does not act on: leave it out")
        return self


class LinkSettings(RigTable):
    """Address and sample rate of the device."""

    url: str = "sim://"
    """Where the device is, when no `--link` is given."""
    rate_hz: Annotated[int, Field(gt=0, le=10_000, strict=True)] = 1000
    """Samples a second."""


class RigGeometry(RigTable):
    """What is measured on the rig and never searched for: lengths in m, gravity in m/s^2."""

    name: Name
    """As runs and models carry it; a run belongs to rigs of this name, `L1` and `g`."""
    L0: Length = 0.3
    """Length of the arm, m; a swing with the arm clamped does not feel it."""
    L1: Length
    """Distance of the two joints along the inner rod, m."""
    L1_std: Length | None = None
    """Standard uncertainty of L1 where it is hardly known, as on video: a diagnosis then fits it."""
    L0_std: Length | None = None
    """Standard uncertainty of L0 where it is hardly known: the identification of a moving arm then fits it."""
    L2: Length | None = None
    """Length of the outer rod, m; for drawings and exports alone."""
    g: Annotated[float, Field(ge=0.1, le=100, strict=True)] = 9.81
    """Gravity, m/s^2."""

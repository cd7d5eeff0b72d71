"""Creation of a rig file from a few measurements, and check of a rig file."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dpr_lab.errors import ConfigError, LinkUrlError
from dpr_lab.shown import percent
from dpr_lab.whole_file import write_text
from dpr_lab.workflows.rig_drive import MotorMeasures, arm_bounds
from dpr_lab.workflows.rig_toml import Bounds, Measure, rendered

if TYPE_CHECKING:
    from dpr_lab.rig import Rig
    from dpr_lab.rig_tables import ArmMode, InnerMode, Parameter


@dataclass(frozen=True, slots=True)
class RigMeasures:
    """Values measured with ruler and balance."""

    name: str
    L1: float
    """Distance between the two joints, m; for a rig with one rod, the length of this rod."""
    L2: float | None
    """Length of the outer rod, m; None: the rig has one rod."""
    m1: Measure
    """Mass of the inner rod, kg."""
    m2: Measure | None
    """Mass of the outer rod, kg; None: the rig has one rod."""
    mb: Measure | None = None
    """Mass of the parts at joint 2, kg; None: unknown."""
    g: float = 9.81
    counts_per_rev: int = 16384
    joint2: Literal["relative", "absolute"] = "relative"
    url: str = "sim://"
    L0: float | None = None
    """Length of the arm, m; None: not measured."""
    L0_std: float | None = None
    """Standard uncertainty of L0, m; None: L0 is not fitted."""
    L1_std: float | None = None
    """Standard uncertainty of L1, m; None: the uncertainty of a ruler."""
    geared: tuple[int, ...] = ()
    """Joints (1, 2) with a geared motor."""
    rezeroed: bool = False
    """Whether the encoders of joints 1 and 2 are zeroed before each recording."""
    mounted: Literal["both", "inner", "outer"] = "both"
    """Mounted rods."""
    elbow: Literal["free", "clamped"] = "free"
    """Whether joint 2 is free or clamped."""
    inner: "InnerMode" = "free"
    """Whether the inner rod swings freely, or its motion is prescribed by its encoder."""
    arm: "ArmMode" = "clamped"
    """Mode of the arm."""
    motor: MotorMeasures | None = None
    """Motor at the arm; None: there is no motor."""
    arm_counts_per_rev: int | None = None
    """Counts per turn of the arm's encoder; None: as for the other encoders."""

    @property
    def turn_as_one(self) -> bool:
        """Whether the mounted rods turn as one body."""
        return (self.mounted, self.elbow) != ("both", "free")


@dataclass(frozen=True, slots=True)
class DraftSettings:
    """Bounds and poses in a new rig file.

    Bounds of a mass are relative to the estimated mass, all other bounds to the values of a uniform rod.
    """

    mass: tuple[float, float] = (0.7, 1.4)
    """Bounds of an estimated mass, relative to the estimate."""
    centre: tuple[float, float] = (0.15, 0.95)
    """Bounds of the distance of a centre of mass from the joint, in units of the rod's length. At the bounds, a motor
    is at one end of the rod."""
    inertia: tuple[float, float] = (0.01, 0.26)
    """Bounds of J in units of m L^2. J is 0 if all mass is in the middle, and 1/4 with half of the mass at each end."""
    elbow: tuple[float, float, float] = (0.002, 0.2, 3.0)
    """Lower bound, nominal value and upper bound of an unknown mass at the elbow, in units of the mass of both rods."""
    damping: tuple[float, float, float] = (1e-5, 3e-3, 0.1)
    """Lower bound, nominal value and upper bound of the damping ratio of a small swing. The damping ratio of ball
    bearings is some thousandths."""
    poses: tuple[tuple[float, float], ...] = ((math.pi, 0.1), (0.1, 0.1), (0.1, math.pi))
    """Default poses theta1, theta2 for two rods, rad: those of the publication."""
    poses_as_one: tuple[tuple[float, float], ...] = ((0.1, 0.1), (1.2, 1.2), (2.2, 2.2))
    """Default poses for one rod, or two rods with a clamped elbow, rad: a large, a medium and a small swing."""


DRAFT = DraftSettings()


MEANING = {
    "l1": "distance from joint 1 to the centre of mass of the inner rod, m",
    "l2": "distance from joint 2 to the centre of mass of the outer rod, m",
    "m1": "mass of the inner rod, kg",
    "m2": "mass of the outer rod, kg",
    "mb": "parts on the axis of joint 2 that turn with the inner rod, kg",
    "c1": "viscous friction of joint 1, N m s/rad",
    "c2": "viscous friction of joint 2, N m s/rad",
    "J1": "inertia of the inner rod about its centre of mass, kg m^2",
    "J2": "inertia of the outer rod about its centre of mass, kg m^2",
    "L0": "distance from the axis of the arm to the rods, m",
    "L1": "distance between the two joints, or length of a single rod, m",
    "L2": "length of the outer rod, m",
    "g": "gravity in the plane of the swing, m/s^2",
    "A": "inertia of the arm about its axis with the rods at its end, kg m^2",
    "c0": "viscous friction of the arm, N m s/rad",
    "k0": "spring of the arm, N m/rad",
    "f0": "Coulomb friction of the arm, N m",
}
"""Meaning of each key of a rig file, with the unit at the end."""


def draft_rig(measures: RigMeasures) -> str:
    """Compose the text of a rig file, with comments.

    The bounds of the friction follow from the bounds of the damping ratio z of a small swing: c = 2 z sqrt(I k). I is
    the inertia and k = (first moment of mass) g the stiffness of the parts that turn about the joint.

    Raises:
        ConfigError: a rig file cannot contain these values.
    """
    from dpr_lab.rig import parse_rig
    from dpr_lab.workflows.rig_scale import values_of_scale

    m = measures
    sizes = {name: getattr(m, name) for name in ("L0", "L1", "L2", "m1", "m2", "mb", "g")}
    for name, size in sizes.items():
        number = size.value if isinstance(size, Measure) else size
        if number is not None and not 0 < number < math.inf:
            remedy = "; omit --mb if the mass is unknown" if name == "mb" else ""
            raise ConfigError(f"{name} must be above 0 and finite, not {number:g}{remedy}")
    mb = m.mb or Measure(DRAFT.elbow[1] * (m.m1.value + m.m2.value) if m.m2 else 0.0)
    carried = m.m1.value + (m.m2.value + mb.value if m.m2 else 0.0)
    text = rendered(
        "new_rig.toml",
        m=m,
        parameters=_parameters(m, mb),
        of_scale=values_of_scale(m.mounted, m.elbow, m.arm, mb.value),
        arm_mode=m.arm,
        arm_bounds=arm_bounds(m.arm, m.L0, carried, m.motor),
        motor=m.motor,
        digits=4,
        poses=DRAFT.poses_as_one if m.turn_as_one else DRAFT.poses,
    )
    parse_rig(text)
    return text


def _parameters(m: RigMeasures, mb: Measure) -> dict[str, tuple[str, Bounds, float | None]]:
    """Return meaning, bounds and standard uncertainty (of a measured value) for each table in `[parameters]`.

    Raises:
        ConfigError: the values describe one rod, but two rods are mounted.
    """
    rods = [(m.m1, m.L1), *([(m.m2, m.L2)] if m.m2 and m.L2 else [])]
    values = {"mb": mb.value}
    for rod, (mass, length) in enumerate(rods, 1):
        values |= {f"l{rod}": length / 2, f"m{rod}": mass.value, f"J{rod}": mass.value * length**2 / 12}
    ranges = ranges_of(values, [length for _, length in rods], m.g, uncertain=True)
    stds = {f"m{rod}": mass.std for rod, (mass, _) in enumerate(rods, 1)} | {"mb": mb.std}
    words = MEANING | {"mb": "mass of the parts at joint 2 (encoder, bearing, motor), kg"}
    if len(rods) == 2:
        least, _, most = (factor * (values["m1"] + values["m2"]) for factor in DRAFT.elbow)
        ranges["mb"] = mass_bounds(mb.value) if m.mb else (least, mb.value, most)
    elif m.mounted == "inner":
        words = {name: meaning.replace("inner rod", "rod") for name, meaning in words.items()}
    else:
        raise ConfigError("two rods require the mass and length of the outer rod; for one rod, give --rods inner")
    return {name: (words[name], ranges[name], stds.get(name)) for name in MEANING if name in ranges}


def ranges_of(values: Mapping[str, float], lengths: Sequence[float], g: float, *, uncertain: bool) -> dict[str, Bounds]:
    """Return bounds and nominal values of the parameters of rods, except those of the parts at the elbow.

    The bounds of the friction follow from the stiffness of a small swing (`draft_rig`). The stiffness is zero if the
    centre of mass is on the joint. Because a rig file requires positive bounds, at least 1e-30 N m/rad is assumed.

    Args:
        values: nominal values of the parameters
        lengths: length of each rod, m, the inner rod first
        g: gravity, m/s^2
        uncertain: whether the masses are estimates
    """
    Z = dict.fromkeys(("l2", "m2", "mb", "J2"), 0.0) | dict(values)
    tip = Z["J2"] + Z["m2"] * Z["l2"] ** 2
    hanging = Z["J1"] + Z["m1"] * Z["l1"] ** 2 + (Z["mb"] + Z["m2"]) * lengths[0] ** 2 + tip
    moments = Z["m1"] * Z["l1"] + (Z["mb"] + Z["m2"]) * lengths[0], Z["m2"] * Z["l2"]
    ranges: dict[str, Bounds] = {}
    for rod, (length, inertia, moment) in enumerate(zip(lengths, (hanging, tip), moments, strict=False), 1):
        mass, (near, far), (low, high) = Z[f"m{rod}"], DRAFT.centre, DRAFT.inertia
        least, _, most = mass_bounds(mass) if uncertain else (mass, mass, mass)
        lower, guess, upper = (2 * z * math.sqrt(inertia * max(moment * g, 1e-30)) for z in DRAFT.damping)
        ranges[f"m{rod}"] = mass_bounds(mass)
        ranges[f"l{rod}"] = near * length, length / 2, far * length
        ranges[f"J{rod}"] = low * least * length**2, mass * length**2 / 12, high * most * length**2
        ranges[f"c{rod}"] = lower, guess, upper
    return ranges


def new_rig(measures: RigMeasures, file: Path) -> Path:
    """Write the rig file of `draft_rig`.

    Raises:
        ConfigError: a rig file cannot contain these values, or the file exists already or cannot be written.
    """
    refuse_rig_file(file)
    write_text(file, draft_rig(measures), ConfigError)
    return file


def refuse_rig_file(file: Path) -> None:
    """Check that a rig file can be written.

    Raises:
        ConfigError: the suffix is not `.toml`, or the file exists already.
    """
    if file.suffix != ".toml":
        raise ConfigError(f"{file}: give the file a name that ends in .toml")
    if file.exists():
        raise ConfigError(f"{file}: exists already; choose another name")


def mass_bounds(mass: float) -> Bounds:
    """Return bounds and nominal value of a mass, kg."""
    return DRAFT.mass[0] * mass, mass, DRAFT.mass[1] * mass


@dataclass(frozen=True, slots=True)
class RigFinding:
    """Remark on a rig file."""

    state: Literal["wrong", "missing", "odd"]
    """Kind of the remark. `wrong`: the file cannot be used; `missing`: without the key, a function of
    dpr-lab is not available; `odd`: possibly a mistake."""
    key: str
    """Key of the rig file; empty if the remark is about several keys."""
    text: str
    """The remark, without the key."""


@dataclass(frozen=True, slots=True)
class Usual:
    """Usual ranges of the values of a rig; values outside these ranges are reported."""

    length: tuple[float, float] = (0.03, 2.0)
    """Range of lengths, m."""
    mass: tuple[float, float] = (1e-3, 50.0)
    """Range of masses, kg."""
    kg_per_m: float = 20.0
    """Maximum mass per length of a rod, kg/m: the value of a steel bar of 57 mm diameter. `RigGeometry` contains the
    limit beyond which a file is refused."""
    rate_hz: int = 100
    """Minimum sample rate, Hz. A rod makes up to three turns per second."""
    relative_std: float = 0.1
    """Maximum relative standard uncertainty of a measured value."""
    tolerance: float = 0.3
    """Maximum tolerance of a pose, rad."""
    span: float = 1e4
    """Maximum ratio of upper to lower bound, except for friction. A larger ratio indicates mixed units."""


USUAL = Usual()


def check_rig(name: str | Path) -> list[RigFinding]:
    """Find errors, missing values and unusual values in a rig file.

    The list is empty if the file contains none.
    """
    from dpr_lab.rig import load_rig

    try:
        rig = load_rig(name)
    except ConfigError as error:
        problems = zip_longest(error.keys, str(error).splitlines(), fillvalue="")
        return [
            RigFinding("wrong", key, line.removeprefix(f"{Path(name)}: ").removeprefix(key).lstrip(":= "))
            for key, line in problems
        ]
    return [*_missing(rig), *_odd_geometry(rig), *_odd_parameters(rig), *_odd_poses(rig), *_odd_link(rig)]


def _odd_link(rig: "Rig") -> Iterator[RigFinding]:
    from dpr_lab.transports import known_link

    try:
        known_link(rig.link.url)
    except LinkUrlError as error:
        yield RigFinding("odd", "link.url", str(error))


def _missing(rig: "Rig") -> Iterator[RigFinding]:
    from dpr_lab.workflows.rig_scale import scale_known, values_of_scale

    if not rig.poses:
        yield RigFinding("missing", "poses", "there are no poses: capture needs a pose, the import of tables does not")
    if not scale_known(rig):
        drive = "torque of a joint" if rig.arm.mode == "clamped" else "torque (or current with measured kt) of the arm"
        values = values_of_scale(rig.rods.mounted, rig.rods.elbow, rig.arm.mode, rig.parameters["mb"].nominal)
        message = (
            "the measured values (measured, std) do not determine the scale of masses and torques: only ratios can be"
            f" identified. Measure {values}, or record another swing with an added mass or a known {drive}"
        )
        yield RigFinding("missing", "parameters", message)
    if rig.L2 is None and rig.rods.mounted != "inner":
        yield RigFinding("missing", "rig.L2", "is missing: drawings and exports use an assumed length of the outer rod")


def _odd_geometry(rig: "Rig") -> Iterator[RigFinding]:
    if not rig.rig.on_earth(rig.g):
        yield RigFinding("odd", "rig.g", rig.rig.compared_g)
    yield from _outside("rig.L1", rig.L1, USUAL.length, "m: was it measured in another unit?")
    if rig.L2 is not None:
        yield from _outside("rig.L2", rig.L2, USUAL.length, "m: was it measured in another unit?")
    if rig.encoders.noise_counts == 0:
        yield RigFinding(
            "odd",
            "encoders.noise_counts",
            ("is 0: every reading has noise, and the limits of rest are derived from this value"),
        )
    if rig.link.rate_hz < USUAL.rate_hz:
        yield RigFinding("odd", "link.rate_hz", f"{rig.link.rate_hz} Hz is too low for a fast rod")


def _odd_parameters(rig: "Rig") -> Iterator[RigFinding]:
    from dpr_lab.rig import MASSES, OF_OUTER_ROD

    for name, p in rig.parameters.items():
        if rig.rods.mounted == "inner" and name in OF_OUTER_ROD:
            continue
        key = f"parameters.{name}"
        if name in MASSES:
            usual = (0.0, USUAL.mass[1]) if name == "mb" else USUAL.mass  # a model may have no mass at the elbow
            yield from _outside(key, p.measured or p.nominal, usual, "kg: was it weighed in another unit?")
        if p.std is not None and p.std > USUAL.relative_std * (p.measured or math.inf):
            yield RigFinding("odd", key, f"std {p.std:g} is {percent(p.std / (p.measured or 1))} of the measured value")
        if p.lower is not None and p.upper is not None and p.measured is None:
            yield from _odd_bounds(name, p)
    for rod, length in ((1, rig.L1), (2, rig.L2)):
        yield from _odd_rod(rig, rod, length)


def _odd_bounds(name: str, p: "Parameter") -> Iterator[RigFinding]:
    assert p.lower is not None
    assert p.upper is not None
    key = f"parameters.{name}"
    if not p.lower <= p.nominal <= p.upper:
        yield RigFinding("odd", key, f"nominal {p.nominal:g} lies outside its bounds {p.lower:g} to {p.upper:g}")
    if p.upper > USUAL.span * p.lower and not name.startswith("c"):
        yield RigFinding("odd", key, f"bounds {p.lower:g} to {p.upper:g} are very wide: is the unit correct?")


def _odd_rod(rig: "Rig", rod: int, length: float | None) -> Iterator[RigFinding]:
    """Yield remarks on implausible values of a rod.

    The checked values are the mass per length, the position of the centre of mass, and the inertia. The centre of mass
    must not lie beyond the end of the rod. The inertia must not exceed m l (L - l), where l is the distance of the
    centre of mass.
    """
    centre, mass, inertia = (rig.parameters[f"{name}{rod}"] for name in "lmJ")
    centroid, m, J = (p.measured or p.nominal for p in (centre, mass, inertia))
    if length is None:
        return
    if USUAL.kg_per_m * length < m <= USUAL.mass[1]:
        message = f"{m:g} kg is a large mass for a rod of {length:g} m: was it weighed in another unit?"
        yield RigFinding("odd", f"parameters.m{rod}", message)
    if centroid > length:
        message = f"{centroid:g} m lies beyond the end of the rod at {length:g} m"
        yield RigFinding("odd", f"parameters.l{rod}", message)
    elif J > m * centroid * (length - centroid):
        message = (
            f"{J:g} kg m^2 is more than a rod of {m:g} kg and {length:g} m can have (at most"
            f" {m * centroid * (length - centroid):.3g})"
        )
        yield RigFinding("odd", f"parameters.J{rod}", message)


def _odd_poses(rig: "Rig") -> Iterator[RigFinding]:
    for name, pose in rig.poses.items():
        key = f"poses.{name}"
        if (largest := max(map(abs, pose.theta))) > math.tau:
            yield RigFinding("odd", key, f"{largest:g} rad is more than one turn: is the angle in degrees?")
        if max(map(math.cos, pose.theta[1:])) < -0.99:
            hang = "both rods hang" if rig.rods.number == 2 else "the rod hangs"
            yield RigFinding("odd", key, f"{hang}: there is no swing after the release (0 = upright)")
        if pose.tolerance > USUAL.tolerance:
            yield RigFinding("odd", key, f"a tolerance of {pose.tolerance:g} rad is too large for a pose")


def _outside(key: str, value: float, usual: tuple[float, float], why: str) -> Iterator[RigFinding]:
    if not usual[0] <= value <= usual[1]:
        yield RigFinding("odd", key, f"{value:g} {why}")

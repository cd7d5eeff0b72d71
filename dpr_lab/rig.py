"""Rig file: measured quantities, parameters to identify, encoders, and link to the device."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, PrivateAttr, ValidationError, model_validator

from dpr_lab.arrays import Array, Flags
from dpr_lab.configs import find_config, parse_config, read_config, sha256_of
from dpr_lab.errors import ConfigError
from dpr_lab.rig_tables import (
    AddedMass,
    ArmMode,
    ArmTable,
    Encoders,
    InnerMode,
    Joints,
    LinkSettings,
    MotorTable,
    Name,
    Parameter,
    Pose,
    RigGeometry,
    RigTable,
    Rods,
)
from dpr_lab.shown import Row, Shown

PARAMETERS = ("l1", "l2", "m1", "m2", "mb", "c1", "c2", "J1", "J2")
"""Names of the kinetic parameters Z, in the order of the published tables (docs/theory.md, section 1)."""

OF_OUTER_ROD = ("l2", "m2", "c2", "J2")
"""Parameters of the outer rod. The mass mb at joint 2 is part of the inner rod."""

MASSES = ("m1", "m2", "mb")
"""Parameters in Z that a balance can measure."""

JOINTS = 3
"""Number of joints: arm (0), inner rod (1), outer rod (2)."""


def refuse_other_parameters(names: Iterable[str]) -> None:
    """Check that a file contains exactly the kinetic parameters.

    Raises:
        ValueError: one of `PARAMETERS` is missing, or a name is unknown.
    """
    given_names = list(names)
    missing = [name for name in PARAMETERS if name not in given_names]
    unknown = [name for name in given_names if name not in PARAMETERS]
    if missing or unknown:
        raise ValueError(
            f"parameters must be exactly {', '.join(PARAMETERS)};"
            f" missing: {', '.join(missing) or 'none'}; unknown: {', '.join(unknown) or 'none'}"
        )


NO_ENCODER = {"nominal": 1e-6, "measured": 1e-6, "std": 1e-7}
"""Negligible mass of the parts at joint 2 for a rig without joint 2, kg."""


def _is_valid(parameter: Any) -> bool:
    """Return whether the table of a parameter is valid.

    A wrong table is not copied to the other rod, so that its fault is reported only once.
    """
    try:
        Parameter.model_validate(parameter)
    except ValidationError:
        return False
    return True


def of_inner_rod(mb: float) -> tuple[str, ...]:
    """Return the names of the parameters of the inner rod alone, with mb, kg, unless it is negligible."""
    absent = (*OF_OUTER_ROD, "mb") if mb < 2 * NO_ENCODER["nominal"] else OF_OUTER_ROD
    return tuple(name for name in PARAMETERS if name not in absent)


def refuse_impossible_arm(rig: "Rig", mode: ArmMode) -> None:
    """Check that a rig supports a mode of the arm.

    Raises:
        ValueError: a key that the mode needs is missing, or the mounted rods are not supported in this mode.
    """
    if mode not in ("free", "driven"):
        return
    if "L0" not in rig.rig.model_fields_set:
        raise ValueError(f"a {mode} arm needs its length L0 in [rig]")
    if rig.rods.mounting in ("outer", "clamped"):
        raise ValueError(f"a {mode} arm is supported with both rods, or with the inner rod alone")
    if mode == "driven" and rig.motor is None:
        raise ValueError("a driven arm needs [motor] with its input in the rig file")


def refuse_impossible_inner(rig: "Rig", inner: InnerMode, arm: ArmMode) -> None:
    """Check that a rig supports a mode of the inner rod.

    Raises:
        ValueError: the inner rod is prescribed, but no outer rod swings on it, or the arm is free or driven.
    """
    if inner == "free":
        return
    if rig.rods.mounting != "both":
        raise ValueError("a prescribed inner rod needs an outer rod that swings on it")
    if arm in ("free", "driven"):
        raise ValueError(f"joint 1 is prescribed, so the arm has to be clamped or prescribed as well, not {arm}")


class Rig(Shown, RigTable):
    """Content of a rig file (`configs/rigs/*.toml`).

    Tables of every file: `[rig]` with lengths and gravity, `[parameters.*]` with one table for each of `PARAMETERS`,
    `[encoders]`, `[poses.*]` and `[link]`.

    Optional tables: `[added_mass]` for a known attached mass, `[rods]` for a missing rod or a clamped elbow, `[joints]`
    for geared motors or a prescribed inner rod, `[arm]` for an arm that is not clamped, and `[motor]` for the drive of
    the arm.
    """

    rig: RigGeometry
    """Name, lengths (m) and gravity (m/s^2)."""
    parameters: dict[str, Parameter]
    """Nine kinetic parameters by name, SI: nominal values, bounds, measured values."""
    encoders: Encoders = Encoders()
    """Encoders, which convert counts to angles."""
    poses: dict[Name, Pose] = Field(default_factory=dict)
    """Poses by name: angles at which the rods are held before a release, rad."""
    added_mass: AddedMass | None = None
    """Known mass that is attached to a rod, kg and m; None if no mass is attached."""
    rods: Rods = Rods()
    """Mounted rods, and mode of the elbow."""
    joints: Joints = Joints()
    """Modes of the joints of the rods, and joints with geared motors."""
    arm: ArmTable = ArmTable()
    """Mode and constants of the arm."""
    motor: MotorTable | None = None
    """Drive of the arm; None without a drive."""
    link: LinkSettings = LinkSettings()
    """Link to the device, and sample rate."""
    _path: Path | None = PrivateAttr(default=None)
    _sha256: str = PrivateAttr(default="")

    def _heading(self) -> str:
        poses = f"poses {', '.join(self.poses)}" if self.poses else "no poses"
        return f"Rig {self.rig.name}: L1 = {self.rig.L1:g} m, g = {self.rig.g:g} m/s², {poses}"

    def _rows(self) -> list[Row]:
        columns = ("nominal", "lower", "upper", "measured", "std")
        values = {name: parameter.model_dump() for name, parameter in self.parameters.items()}
        cells = (
            [name, *(f"{v:g}" if (v := quantity[column]) is not None else "" for column in columns)]
            for name, quantity in values.items()
        )
        return [("parameter", *columns), *cells]

    @model_validator(mode="before")
    @classmethod
    def _of_one_rod(cls, table: Any) -> Any:
        """Complete the poses and parameters of a rig with a single rod.

        A pose of such a rig contains only theta1. The missing rod gets the parameters of the mounted one, and the
        encoder of joint 2 a negligible mass. Neither affects the motion.
        """
        match table:
            case {"rods": {"mounted": "inner" | "outer" as mounted}, "parameters": dict(parameters)}:
                mounted_rod, missing_rod = ("1", "2") if mounted == "inner" else ("2", "1")
                copied = {
                    f"{q}{missing_rod}": parameters[f"{q}{mounted_rod}"]
                    for q in "lmcJ"
                    if _is_valid(parameters.get(f"{q}{mounted_rod}"))
                }
                table = {**table, "parameters": {"mb": NO_ENCODER, **copied, **parameters}}
        match table:
            case {"rods": {"mounted": "inner" | "outer"}, "poses": dict(poses)}:
                follow = {
                    name: {**pose, "theta2": pose["theta1"]}
                    for name, pose in poses.items()
                    if isinstance(pose, dict) and "theta1" in pose
                }
                table = {**table, "poses": {**poses, **follow}}
        return table

    @model_validator(mode="after")
    def _nine_parameters(self) -> "Rig":
        refuse_other_parameters(self.parameters)
        return self

    @model_validator(mode="after")
    def _arm_can_move(self) -> "Rig":
        refuse_impossible_arm(self, self.arm.mode)
        refuse_impossible_inner(self, self.joints.inner, self.arm.mode)
        return self

    @property
    def name(self) -> str:
        """Name of the rig, as stored in runs and models."""
        return self.rig.name

    @property
    def input(self) -> str:
        """Kind of the input of the arm's motor; empty without a motor."""
        return self.motor.input if self.motor else ""

    @property
    def L0(self) -> float:
        """Length of the arm, m.

        It has no influence on a swing with a clamped arm.
        """
        return self.rig.L0

    @property
    def L1(self) -> float:
        """Distance between the two joints along the inner rod, m."""
        return self.rig.L1

    @property
    def unsure(self) -> tuple[str, ...]:
        """Names of the lengths that are fitted because they are uncertain: `L1` or none."""
        return ("L1",) if self.rig.L1_std is not None else ()

    @property
    def L2(self) -> float | None:
        """Length of the outer rod, m, or None if unknown."""
        return self.rig.L2

    @property
    def g(self) -> float:
        """Gravity, m/s^2."""
        return self.rig.g

    def read_from(self, path: Path) -> "Rig":
        """Return a copy that stores the path and the hash of its file."""
        rig = self.model_copy()
        rig._path, rig._sha256 = path, sha256_of(path)
        return rig

    def with_rods(self, mounted: str | None = None, elbow: str | None = None) -> "Rig":
        """Return a copy with changed mounted rods or elbow mode; None keeps the present value.

        Raises:
            ValueError: the elbow is clamped, but only one rod is mounted.
        """
        changes = {key: value for key, value in (("mounted", mounted), ("elbow", elbow)) if value is not None}
        rods = {**self.rods.model_dump(), **changes}
        if rods == self.rods.model_dump():
            return self
        return Rig.model_validate({**self.model_dump(exclude_unset=True), "rods": rods})

    @property
    def path(self) -> Path | None:
        """File from which this rig was read."""
        return self._path

    @property
    def sha256(self) -> str:
        """Hash of the rig file, or an empty text for a rig created in memory."""
        return self._sha256

    @property
    def values_sha256(self) -> str:
        """Hash of the values on which a diagnosis depends, independent of the order of the tables.

        Excluded are poses and link, which describe future recordings, and the values that each recording states: rods,
        added mass, modes of arm and inner rod, and zero counts of the encoders.
        """
        of_recordings = {"poses", "link", "rods", "added_mass"}
        nested = {"arm": {"mode"}, "joints": {"inner"}, "encoders": {"zero_counts"}}
        values = self.model_dump(mode="json", exclude=dict.fromkeys(of_recordings, True) | nested)
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()

    @property
    def nominal(self) -> Array:
        """(9,) best known parameters, SI: the measured value, otherwise the nominal value."""
        return np.array([p.measured or p.nominal for p in self._ordered()])

    @property
    def searched(self) -> Flags:
        """Mask (9,) of the parameters without a measured value, which the search varies."""
        return np.array([p.measured is None for p in self._ordered()])

    @property
    def bounds(self) -> Array:
        """(2, 9) lower and upper bounds of the parameters, SI; both bounds of a measured parameter are its value."""
        pairs = [(p.measured, p.measured) if p.measured is not None else (p.lower, p.upper) for p in self._ordered()]
        return np.array(pairs, dtype=np.float64).T

    @property
    def radians_per_count(self) -> Array:
        """Signed angle (3,) per count, rad; negative for an encoder that counts backwards."""
        return 2 * np.pi * np.array(self.encoders.direction) / np.array(self.encoders.counts_per_rev)

    @property
    def reading_std(self) -> Array:
        """Standard deviation (3,) of the readings, rad.

        Its variance in counts^2 is noise_counts^2 + 1/12 (rounding).
        """
        return np.abs(self.radians_per_count) * np.sqrt(self.encoders.noise_counts**2 + 1 / 12)

    def theta(self, counts: ArrayLike) -> Array:
        """Convert encoder counts to absolute angles.

        Args:
            counts: (..., 3) position counters, unwrapped

        Returns:
            (..., 3) theta0, theta1, theta2, rad; 0 = upright, pi = hanging
        """
        turned = (np.asarray(counts) - np.array(self.encoders.zero_counts)) * self.radians_per_count
        rods = np.pi + self.encoders.joint_angles.to_rods(turned[..., 1:])
        return np.concatenate([turned[..., :1], rods], axis=-1)

    def mounted_theta(self, counts: ArrayLike) -> Array:
        """Convert encoder counts to absolute angles, with theta2 = theta1 for a single rod.

        For a single rod the reading of encoder 2 is ignored.
        """
        theta = self.theta(counts)
        return theta if self.rods.number == 2 else theta[..., [0, 1, 1]]

    def positions(self, theta: ArrayLike) -> Array:
        """Convert absolute angles to unrounded readings of ideal encoders, the inverse of `theta`.

        Args:
            theta: (..., 3) absolute angles, rad

        Returns:
            (..., 3) encoder readings, counts
        """
        absolute, joints = np.asarray(theta, dtype=np.float64), self.encoders.joint_angles
        turned = np.concatenate([absolute[..., :1], joints.of_rods(absolute[..., 1:]) - joints.hanging], axis=-1)
        return turned / self.radians_per_count + np.array(self.encoders.zero_counts)

    def _ordered(self) -> list[Parameter]:
        return [self.parameters[name] for name in PARAMETERS]


def load_rig(name: str | Path) -> Rig:
    """Read a rig file by its path, or a built-in one by its name.

    Args:
        name: path such as `my/rig.toml`, or name of a built-in rig file such as `paper`

    Returns:
        the rig, which also stores the path and the SHA-256 of the file

    Raises:
        ConfigError: the file is not found or not valid; the message names the file, the key and the value.
    """
    path = find_config("rigs", name)
    rig = read_config(path, Rig).read_from(path)
    _refuse_impossible_masses(rig, str(path))
    return rig


def parse_rig(text: str) -> Rig:
    """Parse the text of a rig file, and store its hash in the rig.

    Raises:
        ConfigError: the text is not valid.
    """
    rig = parse_config(text, "the rig file", Rig)
    _refuse_impossible_masses(rig, "the rig file")
    rig._sha256 = hashlib.sha256(text.encode()).hexdigest()
    return rig


def _refuse_impossible_masses(rig: Rig, source: str) -> None:
    """Refuse masses that no rod of this length can have; stored runs are exempt, so that they stay readable."""
    lengths = {"m1": (rig.L1, "l1"), "m2": (rig.L2 or 0.0, "l2"), "mb": (rig.L1, "l1")}
    missing = {"inner": ("m2",), "outer": ("m1", "mb")}.get(rig.rods.mounted, ())
    faults = {}
    for name in [name for name in lengths if name not in missing]:
        length, centroid = lengths[name]
        mass = rig.parameters[name].measured or rig.parameters[name].nominal
        longest = max(length, 2 * rig.parameters[centroid].nominal)
        if mass > (most := rig.rig.MOST_KG_PER_M * longest):
            sentence = f"{mass:g} kg is impossible on a rod of {longest:g} m (at most {most:g} kg): give masses in kg"
            faults[f"parameters.{name}"] = sentence
    if faults:
        refused = ConfigError("\n".join(f"{source}: {key}: {sentence}" for key, sentence in faults.items()))
        refused.keys = list(faults)
        raise refused

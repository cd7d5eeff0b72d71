"""The rig: measured quantities, searched parameters, and encoders."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, PrivateAttr, model_validator

from dpr_lab.arrays import Array, Flags
from dpr_lab.configs import find_config, parse_config, read_config, sha256_of
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

MASSES = ("m1", "m2", "mb")
"""Parameters in Z that a balance measures."""

JOINTS = 3
"""Joints: arm (0), inner rod (1), outer rod (2)."""


def refuse_other_parameters(names: Iterable[str]) -> None:
    """Check that a file contains exactly the kinetic parameters.

    Raises:
        ValueError: one of `PARAMETERS` is missing, or there is an unknown one.
    """
    given = list(names)
    missing = [name for name in PARAMETERS if name not in given]
    unknown = [name for name in given if name not in PARAMETERS]
    if missing or unknown:
        raise ValueError(
            f"parameters must be exactly {', '.join(PARAMETERS)};"
            f" missing: {', '.join(missing) or 'none'}; unknown: {', '.join(unknown) or 'none'}"
        )


NO_ENCODER = {"nominal": 1e-6, "measured": 1e-6, "std": 1e-7}
"""Mass of the encoder at joint 2 of a rig without joint 2, kg."""


def refuse_impossible_arm(rig: "Rig", mode: ArmMode) -> None:
    """Check that a mode of the arm is possible for a rig.

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
    """Make sure that the inner rod of a rig can be in a mode.

    Raises:
        ValueError: no rod hangs on it, or it is on an arm that moves by itself.
    """
    if inner == "free":
        return
    if rig.rods.mounting != "both":
        raise ValueError("an inner rod that is prescribed needs the outer rod, free to swing on it")
    if arm in ("free", "driven"):
        raise ValueError(f"joint 1 is prescribed, so the arm has to be clamped or prescribed as well, not {arm}")


class Rig(Shown, RigTable):
    """A rig file (`configs/rigs/*.toml`).

    Args of the file: `[rig]` lengths and gravity, `[parameters.*]` one table for each of `PARAMETERS`,
    `[encoders]`, `[poses.*]`, `[link]`; `[added_mass]` if a known mass is attached, `[rods]` if a rod is not mounted or
    the elbow is clamped, `[joints]` for geared motors; `[arm]` for an arm that is not clamped, `[motor]` for its drive.
    """

    rig: RigGeometry
    """Name, lengths (m) and gravity (m/s^2)."""
    parameters: dict[str, Parameter]
    """Nine kinetic parameters by name, SI: nominal values, bounds, measured values."""
    encoders: Encoders = Encoders()
    """Conversion of counts to angles."""
    poses: dict[Name, Pose] = Field(default_factory=dict)
    """Name of a pose -> angles at which the rods are held before a release, rad."""
    added_mass: AddedMass | None = None
    """Known attached mass, kg and m; None without one."""
    rods: Rods = Rods()
    """Mounted rods."""
    joints: Joints = Joints()
    """Joints with geared motors."""
    arm: ArmTable = ArmTable()
    """Mode and constants of the arm."""
    motor: MotorTable | None = None
    """Drive of the arm; None without a drive."""
    link: LinkSettings = LinkSettings()
    """Address of the device and sample rate."""
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
        """Complete poses and parameters of a rig with a single rod, whose pose is given by theta1 alone.

        The missing rod gets the parameters of the mounted one, and the encoder of joint 2 a negligible mass: neither
        affects the motion.
        """
        match table:
            case {"rods": {"mounted": "inner" | "outer" as mounted}, "parameters": dict(parameters)}:
                mounted_rod, missing_rod = ("1", "2") if mounted == "inner" else ("2", "1")
                alike = {
                    f"{q}{missing_rod}": parameters[f"{q}{mounted_rod}"]
                    for q in "lmcJ"
                    if f"{q}{mounted_rod}" in parameters
                }
                table = {**table, "parameters": {"mb": NO_ENCODER, **alike, **parameters}}
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
    def L0(self) -> float:
        """Length of the arm, m; without influence if the arm is clamped."""
        return self.rig.L0

    @property
    def L1(self) -> float:
        """Distance between the two joints along the inner rod, m."""
        return self.rig.L1

    @property
    def unsure(self) -> tuple[str, ...]:
        """Names of uncertain lengths, which are therefore fitted: L1."""
        return ("L1",) if self.rig.L1_std is not None else ()

    @property
    def L2(self) -> float | None:
        """Length of the outer rod, m; None if unknown."""
        return self.rig.L2

    @property
    def g(self) -> float:
        """Gravity, m/s^2."""
        return self.rig.g

    def read_from(self, path: Path) -> "Rig":
        """A copy of the rig that names the file from which it was read."""
        rig = self.model_copy()
        rig._path, rig._sha256 = path, sha256_of(path)
        return rig

    def with_rods(self, mounted: str | None = None, elbow: str | None = None) -> "Rig":
        """The rig with other mounted rods; unchanged if nothing is given.

        Raises:
            ValueError: a clamped elbow without joint 2.
        """
        changes = {key: value for key, value in (("mounted", mounted), ("elbow", elbow)) if value is not None}
        rods = {**self.rods.model_dump(), **changes}
        if rods == self.rods.model_dump():
            return self
        return Rig.model_validate({**self.model_dump(exclude_none=True), "rods": rods})

    @property
    def path(self) -> Path | None:
        """File from which this rig was read."""
        return self._path

    @property
    def sha256(self) -> str:
        """Hash of the rig file; empty for a rig created in memory."""
        return self._sha256

    @property
    def nominal(self) -> Array:
        """(9,) best known value of each parameter: the measured value if there is one, SI."""
        return np.array([p.measured or p.nominal for p in self._ordered()])

    @property
    def searched(self) -> Flags:
        """(9,) mask of the parameters without a measured value, which the search varies."""
        return np.array([p.measured is None for p in self._ordered()])

    @property
    def bounds(self) -> Array:
        """(2, 9) lower and upper bound of each parameter; both equal a measured value, SI."""
        pairs = [(p.measured, p.measured) if p.measured is not None else (p.lower, p.upper) for p in self._ordered()]
        return np.array(pairs, dtype=np.float64).T

    @property
    def radians_per_count(self) -> Array:
        """(3,) angle of one count, signed by the direction, rad."""
        return 2 * np.pi * np.array(self.encoders.direction) / np.array(self.encoders.counts_per_rev)

    @property
    def reading_std(self) -> Array:
        """(3,) standard deviation of a reading, rad: noise and rounding, of variance noise_counts^2 + 1/12 counts^2."""
        return np.abs(self.radians_per_count) * np.sqrt(self.encoders.noise_counts**2 + 1 / 12)

    def theta(self, counts: ArrayLike) -> Array:
        """Absolute angles from counts.

        Args:
            counts: (..., 3) position counters, unwrapped

        Returns:
            (..., 3) theta0, theta1, theta2, rad; 0 = upright, pi = hanging
        """
        turned = (np.asarray(counts) - np.array(self.encoders.zero_counts)) * self.radians_per_count
        rods = np.pi + self.encoders.joint_angles.to_rods(turned[..., 1:])
        return np.concatenate([turned[..., :1], rods], axis=-1)

    def mounted_theta(self, counts: ArrayLike) -> Array:
        """Like `theta`, but theta2 of a single rod equals theta1: the reading of encoder 2 is ignored."""
        theta = self.theta(counts)
        return theta if self.rods.number == 2 else theta[..., [0, 1, 1]]

    def positions(self, theta: ArrayLike) -> Array:
        """Readings of ideal encoders at given absolute angles; the inverse of `theta`, not rounded.

        Args:
            theta: (..., 3) absolute angles, rad

        Returns:
            (..., 3) positions, counts
        """
        absolute, joints = np.asarray(theta, dtype=np.float64), self.encoders.joint_angles
        turned = np.concatenate([absolute[..., :1], joints.of_rods(absolute[..., 1:]) - joints.hanging], axis=-1)
        return turned / self.radians_per_count + np.array(self.encoders.zero_counts)

    def _ordered(self) -> list[Parameter]:
        return [self.parameters[name] for name in PARAMETERS]


def load_rig(name: str | Path) -> Rig:
    """Read a rig file by path, or a built-in one by its bare name (`paper`).

    Raises:
        ConfigError: not found or not valid; the message names file, key and value.
    """
    path = find_config("rigs", name)
    return read_config(path, Rig).read_from(path)


def parse_rig(text: str) -> Rig:
    """Parse the text of a rig file; stores the hash of this text.

    Raises:
        ConfigError: not valid.
    """
    rig = parse_config(text, "the rig file", Rig)
    rig._sha256 = hashlib.sha256(text.encode()).hexdigest()
    return rig

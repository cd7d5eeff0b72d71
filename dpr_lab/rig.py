"""The rig: what was measured on the bench, what is searched for, how its encoders are read."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, model_validator

from dpr_lab.configs import find_config, read_config, sha256_of

PARAMETERS = ("l1", "l2", "m1", "m2", "mb", "c1", "c2", "J1", "J2")
"""Names of the kinetic parameters Z, in the order of the paper's tables."""

MASSES = ("m1", "m2", "mb")
"""Those of Z that a balance measures."""

JOINTS = 3
"""Arm (0), inner rod (1), outer rod (2)."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Parameter(_Table):
    """One kinetic parameter: searched for between bounds, or measured with a standard uncertainty."""

    nominal: Positive
    lower: Positive | None = None
    upper: Positive | None = None
    measured: Positive | None = None
    std: Positive | None = None

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


class Encoders(_Table):
    """How counts become angles.

    theta_i = zero_i + direction_i * (counts_i - zero_counts_i) * 2 pi / counts_per_rev_i, where zero_i is the
    hanging rest (pi for the rods, 0 for the arm and for a relative joint 2).
    """

    counts_per_rev: tuple[int, int, int] = (16384, 16384, 16384)
    noise_counts: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.5
    joint2: Literal["relative", "absolute"] = "relative"
    zero_counts: tuple[int, int, int] = (0, 0, 0)
    direction: tuple[Literal[-1, 1], Literal[-1, 1], Literal[-1, 1]] = (1, 1, 1)

    @model_validator(mode="after")
    def _positive_counts(self) -> "Encoders":
        if min(self.counts_per_rev) < 4:
            raise ValueError(f"counts_per_rev must be at least 4, not {min(self.counts_per_rev)}")
        return self


class Pose(_Table):
    """Where the rods are held before a release: absolute angles, 0 = upright, pi = hanging, rad."""

    theta0: Finite = 0.0
    theta1: Finite
    theta2: Finite
    tolerance: Positive = 0.05

    @property
    def theta(self) -> NDArray[np.float64]:
        """(3,) angles of arm, inner and outer rod, rad."""
        return np.array([self.theta0, self.theta1, self.theta2])


class AddedMass(_Table):
    """A known mass clamped to a rod, as good as a point: one more release with it fixes the scale of all masses."""

    rod: Literal["inner", "outer"]
    mass: Positive
    """kg"""
    position: Positive
    """Distance from that rod's pivot, m."""


class Link(_Table):
    """Where the device is and how fast it streams."""

    url: str = "sim://"
    rate_hz: Annotated[int, Field(gt=0, le=10_000)] = 1000


class Frame(_Table):
    """What is measured on the rig and never searched for: lengths in m, gravity in m/s^2."""

    name: Annotated[str, Field(min_length=1)]
    L0: Positive = 0.3
    L1: Positive
    L2: Positive | None = None
    g: Positive = 9.81


class Rig(_Table):
    """A rig file (`configs/rigs/*.toml`).

    Args of the file: `[rig]` lengths and gravity, `[parameters.*]` one table for each of `PARAMETERS`,
    `[encoders]`, `[poses.*]`, `[link]`; `[added_mass]` while a known mass is clamped on.
    """

    rig: Frame
    parameters: dict[str, Parameter]
    encoders: Encoders = Encoders()
    poses: dict[str, Pose] = {}
    added_mass: AddedMass | None = None
    link: Link = Link()
    _path: Path | None = PrivateAttr(default=None)
    _sha256: str = PrivateAttr(default="")

    @model_validator(mode="after")
    def _nine_parameters(self) -> "Rig":
        missing = [name for name in PARAMETERS if name not in self.parameters]
        unknown = [name for name in self.parameters if name not in PARAMETERS]
        if missing or unknown:
            raise ValueError(
                f"parameters must be exactly {', '.join(PARAMETERS)};"
                f" missing: {', '.join(missing) or 'none'}; unknown: {', '.join(unknown) or 'none'}"
            )
        return self

    @property
    def name(self) -> str:
        """The rig's name, as runs and models carry it."""
        return self.rig.name

    def read_from(self, path: Path) -> "Rig":
        """The same rig, remembering the file it came from."""
        rig = self.model_copy()
        rig._path, rig._sha256 = path, sha256_of(path)
        return rig

    @property
    def path(self) -> Path | None:
        """The file this rig was read from."""
        return self._path

    @property
    def sha256(self) -> str:
        """Hash of the rig file; empty for a rig made in memory."""
        return self._sha256

    @property
    def nominal(self) -> NDArray[np.float64]:
        """(9,) best known value of each parameter: the measured one where there is one, SI."""
        return np.array([p.measured or p.nominal for p in self._ordered()])

    @property
    def searched(self) -> NDArray[np.bool_]:
        """(9,) which parameters the search may move: those without a measured value."""
        return np.array([p.measured is None for p in self._ordered()])

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 9) lower and upper bound of each parameter; both equal the value where it is measured, SI."""
        pairs = [(p.measured, p.measured) if p.measured is not None else (p.lower, p.upper) for p in self._ordered()]
        return np.array(pairs, dtype=np.float64).T

    @property
    def radians_per_count(self) -> NDArray[np.float64]:
        """(3,) angle of one count, signed by the direction, rad."""
        return 2 * np.pi * np.array(self.encoders.direction) / np.array(self.encoders.counts_per_rev)

    def theta(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Absolute angles from counts.

        Args:
            counts: (..., 3) position counters, unwrapped

        Returns:
            (..., 3) theta0, theta1, theta2, rad; 0 = upright, pi = hanging
        """
        turned = (np.asarray(counts) - np.array(self.encoders.zero_counts)) * self.radians_per_count
        theta0, joint1, joint2 = np.moveaxis(turned, -1, 0)
        base2 = joint1 if self.encoders.joint2 == "relative" else 0.0
        return np.stack([theta0, np.pi + joint1, np.pi + joint2 + base2], axis=-1)

    def positions(self, theta: ArrayLike) -> NDArray[np.float64]:
        """What ideal encoders read at the given absolute angles; the inverse of `theta`, not rounded.

        Args:
            theta: (..., 3) absolute angles, rad

        Returns:
            (..., 3) positions, counts
        """
        theta0, theta1, theta2 = np.moveaxis(np.asarray(theta, dtype=np.float64), -1, 0)
        joint2 = theta2 - theta1 if self.encoders.joint2 == "relative" else theta2 - np.pi
        turned = np.stack([theta0, theta1 - np.pi, joint2], axis=-1)
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

"""Limits file of an acceptance test: limits of effects, ratios, friction torques and free-run errors.

[effects.coulomb_joint2]
torque_Nm = { max = 0.002, unit = "N m" }

[ratios]
"c2/b" = { nominal = 0.30, tolerance = 0.03, unit = "1/s" }
"a/b" = { min = 3.5, max = 3.9, unit = "1" }

[friction.joint1]
max = 0.004
speed_rad_s = 6.0
unit = "N m"

[free_run]
max = 0.05
horizon_s = 2.0
unit = "rad"
"""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, StrictFloat, ValidationInfo, field_validator, model_validator

from dpr_lab.configs import read_config
from dpr_lab.dynamics.base import RATIO_UNITS
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.rig_tables import Positive, RigTable


class EffectLimit(RigTable):
    """Limit on the absolute size of an amplitude of an effect."""

    max: Positive
    """Maximum absolute size, in `unit`."""
    unit: str
    """Unit of the amplitude, as in docs/effects.md."""


class RatioLimit(RigTable):
    """Permitted range of a ratio: a nominal value with a tolerance, or one or two bounds."""

    nominal: StrictFloat | None = None
    """Centre of the range; used with `tolerance`."""
    tolerance: Positive | None = None
    """Half width of the range; used with `nominal`."""
    min: StrictFloat | None = None
    """Lower bound; None: unbounded."""
    max: StrictFloat | None = None
    """Upper bound; None: unbounded."""
    unit: str
    """Unit of the ratio."""

    @model_validator(mode="after")
    def _is_a_range(self) -> "RatioLimit":
        if (self.nominal is None) != (self.tolerance is None):
            raise ValueError("give both nominal and tolerance")
        if (self.nominal is None) == (self.min is None and self.max is None):
            raise ValueError("needs either nominal and tolerance, or min, max or both")
        if self.min is not None and self.max is not None and not self.min < self.max:
            raise ValueError(f"bounds are reversed or equal: min = {self.min}, max = {self.max}")
        return self

    @property
    def bounds(self) -> tuple[float | None, float | None]:
        """Lower and upper bound; None: unbounded."""
        if self.nominal is None or self.tolerance is None:
            return self.min, self.max
        return self.nominal - self.tolerance, self.nominal + self.tolerance


class FrictionLimit(RigTable):
    """Limit on the friction torque of a joint up to a speed, in both directions."""

    max: Positive
    """Maximum friction torque including viscous friction, in `unit`."""
    speed_rad_s: Positive
    """Maximum speed of the joint at which the limit applies, rad/s."""
    unit: str
    """Unit of `max`: `N m`."""


class FreeRunLimit(RigTable):
    """Limit on the error of a free run of the corrected model."""

    max: Positive
    """Maximum root mean square error of a reading, in `unit`."""
    horizon_s: Annotated[float, Field(ge=0.5, le=60, strict=True)]
    """Duration of the free run, s."""
    unit: str
    """Unit of `max`: `rad`."""


class Limits(RigTable):
    """Limits of a rig."""

    effects: dict[str, dict[str, EffectLimit]] = Field(default={})
    """Limits on the sizes of effects, by effect and amplitude."""
    ratios: dict[str, RatioLimit] = Field(default={})
    """Permitted ranges by the name of the ratio."""
    friction: dict[Literal["joint0", "joint1", "joint2"], FrictionLimit] = Field(default={})
    """Limits on friction torques by joint."""
    free_run: FreeRunLimit | None = None
    """Limit on the free-run error; None if there is no such limit."""

    @field_validator("effects", "ratios", mode="before")
    @classmethod
    def _known_names(cls, table: object, field: ValidationInfo) -> object:
        """Refuse unknown names before the entries are validated, because an unknown name is the actual fault."""
        kind, names = ("effect", EFFECTS) if field.field_name == "effects" else ("ratio", RATIO_UNITS)
        for name, entries in table.items() if isinstance(table, dict) else ():
            _known(kind, name, names)
            if kind == "effect" and isinstance(entries, dict):
                for parameter in entries:
                    _known(f"amplitude of {name}", parameter, [p.name for p in EFFECTS[name].amplitudes])
        return table

    @property
    def has_any(self) -> bool:
        """Whether the file contains at least one limit."""
        return bool(self.ratios or any(self.effects.values()) or self.friction or self.free_run)


def friction_quantity(joint: str, limit: FrictionLimit) -> str:
    """Return the name of the limited quantity, for example `friction of joint1 up to 6 rad/s`."""
    return f"friction of {joint} up to {limit.speed_rad_s:g} rad/s"


def free_run_quantity(limit: FreeRunLimit) -> str:
    """Return the name of the limited quantity, for example `free run over 2 s`."""
    return f"free run over {limit.horizon_s:g} s"


AnyLimits = TypeVar("AnyLimits", bound=Limits)


def load_limits(path: Path, model: type[AnyLimits]) -> AnyLimits:
    """Read a limits file.

    Args:
        path: the file
        model: `Limits`, or `PlanLimits` for a file that may also contain limits of a plan

    Raises:
        ConfigError: the file is not readable, contains no limit, or has an invalid key, name, unit or value; the
            message states which.
    """
    limits = read_config(path, model)
    if not limits.has_any:
        raise ConfigError(
            f"{path}: contains no limits: add a table [effects.NAME], [friction.joint1], [ratios] or [free_run]"
        )
    refuse_other_limits(path, limits)
    return limits


def refuse_other_limits(path: Path, limits: Limits) -> None:
    """Check the units in a limits file.

    Raises:
        ConfigError: a unit is incorrect; the message names it.
    """
    for name, amplitudes in limits.effects.items():
        units = {p.name: p.unit for p in EFFECTS[name].amplitudes}
        for parameter, limit in amplitudes.items():
            _same_unit(path, f"effects.{name}.{parameter}", limit.unit, units[parameter])
    for joint, friction in limits.friction.items():
        _same_unit(path, f"friction.{joint}", friction.unit, "N m")
    if limits.free_run is not None:
        _same_unit(path, "free_run", limits.free_run.unit, "rad")
    for name, limit in limits.ratios.items():
        _same_unit(path, f"ratios.{name}", limit.unit, RATIO_UNITS[name])


def _known(kind: str, name: str, names: Collection[str]) -> None:
    if name not in names:
        raise ValueError(unknown_name(f"no {kind} named {name}", name, names))


def _same_unit(path: Path, key: str, unit: str, right: str) -> None:
    if unit.replace("²", "^2") != right:
        raise ConfigError(f'{path}: {key}.unit = {unit!r}: must be "{right}"')

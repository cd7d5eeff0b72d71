"""The plant file: what the simulated device is in truth, which the lab never reads."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from dpr_lab.configs import read_config
from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, Rig
from sim_device.chance import Stream, generator

_PACKAGE = Path(__file__).parent
# Installed as a wheel the built-in files lie inside the package; in a checkout they are in the top-level folder.
BUILTIN = _PACKAGE / "builtin" if (_PACKAGE / "builtin").is_dir() else _PACKAGE.parent / "configs"

DRAW_SPREAD = 0.15
"""How far, relative to the file's value, `drawn` may move a parameter."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Arm(_Table):
    """The arm: held by its brake, or free about the vertical with inertia J0, friction c0 and spring k0."""

    mode: Literal["clamped", "free"] = "clamped"
    J0: Positive = 0.05
    c0: NotNegative = 0.0
    k0: NotNegative = 0.0


Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class Encoders(_Table):
    """What encoders and board add to the truth."""

    noise_counts: NotNegative | tuple[NotNegative, NotNegative, NotNegative] = 0.5
    """Standard deviation of Gaussian noise before rounding, of all encoders or of each."""
    step_counts: Annotated[int, Field(gt=0)] = 1
    """Counters move by this many counts at a time, as those of a coarser encoder."""
    jitter_ms: NotNegative = 0.0
    """Standard deviation of the instants at which the encoders are read."""
    repeated_share: Share = 0.0
    """Share of the samples of a swing that say what the one before said."""
    missing_share: Share = 0.0
    """Share of the samples of a swing that are never sent."""


class Hand(_Table):
    """How well the operator places the rods (rad) and how still they are let go (rad/s), as standard deviations."""

    placement_std: NotNegative = 0.01
    release_speed_std: NotNegative = 0.002


class PlantConfig(_Table):
    """A plant file (`configs/plants/*.toml`).

    Args of the file: `name`, `seed`, `[parameters]` with one value for each of `PARAMETERS` (SI), `[arm]`,
    `[effects.NAME]` or, at most one, `[foreign.NAME]` with the effect's own parameters, `[encoders]`, `[hand]`.
    """

    name: Annotated[str, Field(min_length=1)]
    seed: Annotated[int, Field(ge=0)] = 1
    parameters: dict[str, Positive]
    arm: Arm = Arm()
    effects: dict[str, dict[str, Finite]] = {}
    foreign: dict[str, dict[str, Finite]] = {}
    encoders: Encoders = Encoders()
    hand: Hand = Hand()

    @model_validator(mode="after")
    def _nine_parameters(self) -> "PlantConfig":
        missing = [name for name in PARAMETERS if name not in self.parameters]
        unknown = [name for name in self.parameters if name not in PARAMETERS]
        if missing or unknown:
            raise ValueError(
                f"parameters must be exactly {', '.join(PARAMETERS)};"
                f" missing: {', '.join(missing) or 'none'}; unknown: {', '.join(unknown) or 'none'}"
            )
        return self

    @property
    def Z(self) -> NDArray[np.float64]:
        """(9,) true parameters in the order of `PARAMETERS`, SI."""
        return np.array([self.parameters[name] for name in PARAMETERS])


def find_plant(name: str | Path) -> Path:
    """The plant file meant by a path, or by the bare name of a built-in one.

    Raises:
        ConfigError: there is neither such a file nor such a built-in name.
    """
    path = Path(name)
    if path.is_file():
        return path
    builtin = BUILTIN / "plants" / f"{name}.toml"
    if path.name == str(name) and builtin.is_file():
        return builtin
    known = ", ".join(sorted(p.stem for p in (BUILTIN / "plants").glob("*.toml")))
    raise ConfigError(f"{name}: no such file, and no built-in name of plants (there are: {known})")


def load_plant(name: str | Path, seed: int | None = None) -> PlantConfig:
    """Read a plant file by path or built-in name; `seed`, where given, replaces the file's.

    Raises:
        ConfigError: not found or not valid; the message names file, key and value.
    """
    config = read_config(find_plant(name), PlantConfig)
    return config if seed is None else config.model_copy(update={"seed": seed})


def drawn(config: PlantConfig, rig: Rig) -> PlantConfig:
    """The same plant with other true parameters, drawn from its seed.

    Each searched parameter is uniform within `DRAW_SPREAD` of the file's value and within the rig's bounds, so that
    the truth stays findable; a parameter that the rig file gives as measured keeps its value.

    Raises:
        ConfigError: a value of the plant lies so far outside the rig's bounds that nothing is left to draw from.
    """
    spread = np.array([[1 - DRAW_SPREAD], [1 + DRAW_SPREAD]]) * config.Z
    lower, upper = np.maximum(spread[0], rig.bounds[0]), np.minimum(spread[1], rig.bounds[1])
    empty = [name for name, none in zip(PARAMETERS, rig.searched & (lower > upper), strict=True) if none]
    if empty:
        raise ConfigError(
            f"plant {config.name}: {', '.join(empty)} more than {DRAW_SPREAD:.0%} outside the bounds of rig {rig.name}:"
            " choose a plant that belongs to this rig, or leave --draw out"
        )
    share = generator(config.seed, Stream.TRUTH).random(len(PARAMETERS))
    values = np.where(rig.searched, lower + share * (upper - lower), config.Z)
    return config.model_copy(update={"parameters": dict(zip(PARAMETERS, values.tolist(), strict=True))})

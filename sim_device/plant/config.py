"""The plant file: what the simulated device is in truth, which the lab never reads."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from dpr_lab.configs import read_config
from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, refuse_other_parameters

_PACKAGE = Path(__file__).parents[1]
# Installed as a wheel the built-in files lie inside the package; in a checkout they are in the top-level folder.
BUILTIN = _PACKAGE / "builtin" if (_PACKAGE / "builtin").is_dir() else _PACKAGE.parent / "configs"

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ArmConfig(_Table):
    """The arm: held by its brake, free about the vertical with inertia J0, friction c0 and spring k0, or driven too."""

    mode: Literal["clamped", "free", "driven"] = "clamped"
    J0: Positive = 0.05
    c0: NotNegative = 0.0
    k0: NotNegative = 0.0


Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class EncoderConfig(_Table):
    """Errors of encoders and board."""

    noise_counts: NotNegative | tuple[NotNegative, NotNegative, NotNegative] = 0.5
    """Standard deviation of Gaussian noise before rounding, of all encoders or of each."""
    step_counts: Annotated[int, Field(gt=0)] = 1
    """Counters move by this many counts at a time, as those of a coarser encoder."""
    jitter_ms: NotNegative = 0.0
    """Standard deviation of the instants at which the encoders are read."""
    late_every: Annotated[int, Field(ge=0)] = 0
    """Every so many samples of a swing one is read late, as by a multiplexer; 0 for none,"""
    late_ms: Annotated[float, Field(ge=0, le=50, allow_inf_nan=False)] = 0.0
    """by so much."""
    stale_every: Annotated[int, Field(ge=0)] = 0
    """Every so many samples of a swing one repeats the one before; 0 for none."""
    repeated_share: Share = 0.0
    """Share of the samples of a swing that repeat the one before."""
    missing_share: Share = 0.0
    """Share of the samples of a swing that are never sent."""


class OperatorConfig(_Table):
    """Standard deviations of the operator: pose error (rad) and speed at the release (rad/s)."""

    placement_std: NotNegative = 0.01
    release_speed_std: NotNegative = 0.002


class DriveConfig(_Table):
    """Properties of the joint drives of a device that replays torques."""

    tells: tuple[Literal["measured", "commanded"], ...] = ("measured", "commanded")
    """Which torques the board sends."""
    delay_s: NotNegative = 0.0
    """How much later than commanded a torque acts."""
    noise_Nm: NotNegative = 0.0
    """Standard deviation of the measured torques."""
    gain: tuple[Finite, Finite] = (1.0, 1.0)
    """Torque that acts at each joint over the reported one: a wrong torque constant."""
    offset_Nm: tuple[Finite, Finite] = (0.0, 0.0)
    """Torque that acts at each joint from the release on and is not reported, N m."""
    ripple: tuple[tuple[Finite, Finite], tuple[Finite, Finite]] = ((0.0, 0.0), (0.0, 0.0))
    """Of the torque that acts at each joint, what comes and goes with its angle: shares of cosine and sine of"""
    ripple_order: NotNegative = 6.0
    """so many times that angle."""
    unit_uNm: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Step in which torques are commanded and reported."""


class ArmDriveConfig(_Table):
    """The motor of an arm whose mode is `driven`, its driver, and the program that the device runs."""

    input: Literal["torque", "current", "voltage"]
    """What the driver sets and the device tells: N m at the arm, A or V."""
    kt: Positive = 1.0
    """Torque constant, N m/A."""
    ke: NotNegative = 0.0
    """Back-EMF constant, V s/rad."""
    R: Positive = 1.0
    """Resistance, ohm."""
    gear: Positive = 1.0
    """Turns of the motor for one turn of the arm."""
    limit: Positive
    """Largest input that the driver gives."""
    program: Literal["sines", "chirp", "prbs"] = "sines"
    """Two sines, a sweep of one, or a pseudo-random binary sequence."""
    amplitude: Positive
    """Of the program, in units of the input."""
    rates_hz: tuple[Positive, Positive] = (0.5, 1.3)
    """Of the sines; or where the sweep begins and ends; half the second is the rate of bits of a sequence."""
    sweep_s: Positive = 10.0
    """Duration of the sweep."""
    tells: Annotated[tuple[Literal["measured", "commanded"], ...], Field(min_length=1)] = ("measured", "commanded")
    """Which inputs the board sends."""
    delay_s: NotNegative = 0.0
    """How much later than commanded an input acts."""
    noise: NotNegative = 0.0
    """Standard deviation of the measured input."""
    gain: Finite = 1.0
    """Torque that acts over the one of the constants above: a wrong torque constant."""
    offset_Nm: Finite = 0.0
    """Torque that acts from the release on and is not reported."""
    unit_micro: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Step in which the input is set and reported: uN m, uA or uV."""

    @property
    def torque_per_input(self) -> float:
        """N m at the arm over the input."""
        return {"torque": 1.0, "current": self.gear * self.kt, "voltage": self.gear * self.kt / self.R}[self.input]

    @property
    def back_emf(self) -> float:
        """Friction of the arm by the back-EMF of a voltage drive, N m s/rad."""
        return self.ke * self.kt * self.gear**2 / self.R * self.gain if self.input == "voltage" else 0.0


class PlantConfig(_Table):
    """A plant file (`configs/plants/*.toml`).

    Args of the file: `name`, `seed`, `[parameters]` with one value for each of `PARAMETERS` (SI), `[arm]`,
    `[arm_drive]` of a driven one, `[effects.NAME]` or, at most one, `[foreign.NAME]` with the effect's own parameters,
    `[encoders]`, `[drives]`, `[hand]`.
    """

    name: Annotated[str, Field(min_length=1)]
    seed: Annotated[int, Field(ge=0)] = 1
    parameters: dict[str, Positive]
    arm: ArmConfig = ArmConfig()
    arm_drive: ArmDriveConfig | None = None
    effects: dict[str, dict[str, Finite]] = {}
    foreign: dict[str, dict[str, Finite]] = {}
    encoders: EncoderConfig = EncoderConfig()
    drives: DriveConfig = DriveConfig()
    hand: OperatorConfig = OperatorConfig()

    @model_validator(mode="after")
    def _nine_parameters(self) -> "PlantConfig":
        refuse_other_parameters(self.parameters)
        return self

    @model_validator(mode="after")
    def _arm_is_driven(self) -> "PlantConfig":
        if (self.arm.mode == "driven") != (self.arm_drive is not None):
            raise ValueError('[arm] mode = "driven" and [arm_drive] go together')
        if self.foreign and self.arm.mode == "driven":
            raise ValueError("[foreign] is of rigs whose arm is not driven")
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

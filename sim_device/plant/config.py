"""The plant file: the truth of the simulated device, which dpr-lab never reads."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from dpr_lab.configs import read_config
from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, refuse_other_parameters

_PACKAGE = Path(__file__).parents[1]
# an installed wheel contains the built-in files in the package; in a checkout they are in the top-level folder
BUILTIN = _PACKAGE / "builtin" if (_PACKAGE / "builtin").is_dir() else _PACKAGE.parent / "configs"

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ArmConfig(_Table):
    """The arm: held by its brake, free (inertia J0, friction c0, spring k0 about the vertical), or free and driven."""

    mode: Literal["clamped", "free", "driven"] = "clamped"
    J0: Positive = 0.05
    c0: NotNegative = 0.0
    k0: NotNegative = 0.0


Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class EncoderConfig(_Table):
    """Errors of encoders and board."""

    noise_counts: NotNegative | tuple[NotNegative, NotNegative, NotNegative] = 0.5
    """Standard deviation of Gaussian noise before rounding, common to all encoders or one for each."""
    step_counts: Annotated[int, Field(gt=0)] = 1
    """Counters change in steps of this number of counts, like those of a coarser encoder."""
    jitter_ms: NotNegative = 0.0
    """Standard deviation of the instants at which the encoders are read."""
    late_every: Annotated[int, Field(ge=0)] = 0
    """Period of late samples of a swing, in samples, as caused by a multiplexer; 0: no sample is late."""
    late_ms: Annotated[float, Field(ge=0, le=50, allow_inf_nan=False)] = 0.0
    """Delay of the late samples."""
    stale_every: Annotated[int, Field(ge=0)] = 0
    """Period of samples of a swing that repeat the previous one, in samples; 0: none."""
    stale_from_s: NotNegative = 0.0
    """First instant of the repeated samples, s since the release."""
    stale_for_s: Positive | None = None
    """Duration of the repetition, s; None: to the end. A video may repeat frames for part of its time."""
    repeated_share: Share = 0.0
    """Fraction of the samples of a swing that repeat the previous one."""
    missing_share: Share = 0.0
    """Fraction of the samples of a swing that are never sent."""
    lost_from_s: NotNegative = 0.0
    """First instant without samples, s since the release, as of a tracker that loses its points."""
    lost_for_s: NotNegative = 0.0
    """Duration without samples, s; 0: none."""


class MountConfig(_Table):
    """Vibration mode of the mount, along the ground in the plane of the rods."""

    stiffness_N_per_m: Positive
    frequency_hz: Positive
    damping_ratio: Positive = 0.03


class OperatorConfig(_Table):
    """Standard deviations of the operator: pose error (rad) and speed at the release (rad/s)."""

    placement_std: NotNegative = 0.01
    release_speed_std: NotNegative = 0.002
    elbow: Finite | None = None
    """Angle theta2 - theta1 at which a clamp holds joint 2 at every pose, rad; None: that of the pose."""


class DriveConfig(_Table):
    """Properties of the joint drives of a device that replays torques."""

    tells: tuple[Literal["measured", "commanded"], ...] = ("measured", "commanded")
    """Torques that the board sends."""
    delay_s: NotNegative = 0.0
    """Delay between the command of a torque and its effect."""
    noise_Nm: NotNegative = 0.0
    """Standard deviation of the measured torques."""
    gain: tuple[Finite, Finite] = (1.0, 1.0)
    """Ratio of the acting to the reported torque at each joint: error of the torque constant."""
    offset_Nm: tuple[Finite, Finite] = (0.0, 0.0)
    """Torque at each joint that acts from the release on and is not reported, N m."""
    ripple: tuple[tuple[Finite, Finite], tuple[Finite, Finite]] = ((0.0, 0.0), (0.0, 0.0))
    """Ripple of the torque at each joint: relative amplitudes of cos(n q) and sin(n q), with the joint angle q."""
    ripple_order: NotNegative = 6.0
    """Order n of the ripple, periods per turn."""
    unit_uNm: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Resolution of commanded and reported torques."""


class ArmDriveConfig(_Table):
    """The motor of an arm with the mode `driven`, its driver, and the program of the device."""

    input: Literal["torque", "current", "voltage"]
    """Quantity that the driver controls and the device reports: N m at the arm, A or V."""
    kt: Positive = 1.0
    """Torque constant, N m/A."""
    ke: NotNegative = 0.0
    """Back-EMF constant, V s/rad."""
    R: Positive = 1.0
    """Resistance, ohm."""
    gear: Positive = 1.0
    """Gear ratio: turns of the motor per turn of the arm."""
    limit: Positive
    """Maximum input of the driver; a larger request is limited to it."""
    program: Literal["sines", "chirp", "prbs", "pd"] = "sines"
    """Two sines, a sweep of one, a pseudo-random binary sequence, or a controller whose arm follows two sines."""
    amplitude: Positive
    """Amplitude of the program, in units of the input; of `pd` the amplitude of the angle, rad."""
    kp: NotNegative = 0.0
    """Proportional gain of the controller `pd`, units of the input per rad."""
    kd: NotNegative = 0.0
    """Derivative gain of the controller `pd`, units of the input per rad/s."""
    rates_hz: tuple[Positive, Positive] = (0.5, 1.3)
    """Frequencies of the sines, or initial and final frequency of the sweep; half the second is the bit rate of a
    sequence.
    """
    sweep_s: Positive = 10.0
    """Duration of the sweep."""
    tells: Annotated[tuple[Literal["measured", "commanded"], ...], Field(min_length=1)] = ("measured", "commanded")
    """Inputs that the board sends."""
    noise: NotNegative = 0.0
    """Standard deviation of the measured input."""
    unit_micro: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Resolution of the input: uN m, uA or uV."""

    @property
    def torque_per_input(self) -> float:
        """Ratio of the torque at the arm, N m, to the input."""
        return {"torque": 1.0, "current": self.gear * self.kt, "voltage": self.gear * self.kt / self.R}[self.input]

    @property
    def back_emf(self) -> float:
        """Friction of the arm caused by the back-EMF of a voltage drive, N m s/rad."""
        return self.ke * self.kt * self.gear**2 / self.R if self.input == "voltage" else 0.0


class PlantConfig(_Table):
    """A plant file (`configs/plants/*.toml`).

    Fields of the file: `name`, `seed`, `[parameters]` with one value for each of `PARAMETERS` (SI), `[arm]`,
    `[arm_drive]` for a driven arm, `[effects.NAME]` or at most one `[foreign.NAME]` with the parameters of the effect,
    `[mount]`, `[encoders]`, `[drives]`, `[hand]`. Effects at joint 0 need an arm that moves, those of its drive
    `[arm_drive]`.
    """

    name: Annotated[str, Field(min_length=1)]
    seed: Annotated[int, Field(ge=0)] = 1
    parameters: dict[str, Positive]
    arm: ArmConfig = ArmConfig()
    arm_drive: ArmDriveConfig | None = None
    effects: dict[str, dict[str, Finite]] = {}
    foreign: dict[str, dict[str, Finite]] = {}
    mount: MountConfig | None = None
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
            raise ValueError('[arm] mode = "driven" and [arm_drive] require each other')
        if self.foreign and self.arm.mode == "driven":
            raise ValueError("[foreign] plants have no driven arm: remove [foreign], or the mode of the arm")
        if self.mount and self.arm.mode == "driven":
            raise ValueError("[mount] plants have no driven arm: remove [mount], or the mode of the arm")
        return self

    @property
    def Z(self) -> NDArray[np.float64]:
        """(9,) true parameters in the order of `PARAMETERS`, SI."""
        return np.array([self.parameters[name] for name in PARAMETERS])


def find_plant(name: str | Path) -> Path:
    """The plant file at a path, or the built-in one of a bare name.

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
    raise ConfigError(f"{name}: is neither a file nor the name of a built-in plant; available: {known}")


def load_plant(name: str | Path, seed: int | None = None) -> PlantConfig:
    """Read a plant file by path or built-in name; if `seed` is given, it replaces that of the file.

    Raises:
        ConfigError: not found or not valid; the message names file, key and value.
    """
    config = read_config(find_plant(name), PlantConfig)
    return config if seed is None else config.model_copy(update={"seed": seed})

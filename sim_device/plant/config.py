"""Plant file: true values of the simulated device.

dpr-lab never reads this file.
"""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from dpr_lab.configs import built_in, find_config, read_config
from dpr_lab.errors import ConfigError
from dpr_lab.rig import PARAMETERS, Rig, refuse_other_parameters

_PACKAGE = Path(__file__).parents[1]
# An installed wheel contains the built-in files in the package. In a checkout they are in the top-level folders.
BUILTIN = _PACKAGE / "builtin" if (_PACKAGE / "builtin").is_dir() else _PACKAGE.parent / "configs"

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ArmConfig(_Table):
    """Arm of the plant: clamped, free (inertia J0, friction c0, spring k0 about the vertical), or free and driven."""

    mode: Literal["clamped", "free", "driven"] = "clamped"
    J0: Positive = 0.05
    c0: NotNegative = 0.0
    k0: NotNegative = 0.0


Share = Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class EncoderConfig(_Table):
    """Errors of encoders and board."""

    noise_counts: NotNegative | tuple[NotNegative, NotNegative, NotNegative] = 0.5
    """Standard deviation of the Gaussian noise before rounding, counts: one value for all encoders, or one for each."""
    step_counts: Annotated[int, Field(gt=0)] = 1
    """Step of the counters, counts. A step above 1 simulates a coarser encoder."""
    jitter_ms: NotNegative = 0.0
    """Standard deviation of the instants at which the encoders are read, ms."""
    late_every: Annotated[int, Field(ge=0)] = 0
    """Period of late samples in a swing, in samples, as caused by a multiplexer; 0: no late samples."""
    late_ms: Annotated[float, Field(ge=0, le=50, allow_inf_nan=False)] = 0.0
    """Delay of the late samples, ms."""
    stale_every: Annotated[int, Field(ge=0)] = 0
    """Period of samples in a swing that repeat the previous sample, in samples; 0: no repeated samples."""
    stale_from_s: NotNegative = 0.0
    """Start of the periodically repeated samples, s since the release."""
    stale_for_s: Positive | None = None
    """Duration of the periodically repeated samples, s; None: to the end. A video may repeat frames in a part of a
    recording."""
    repeated_share: Share = 0.0
    """Share of the samples of a swing that repeat the previous sample, at random."""
    missing_share: Share = 0.0
    """Share of the samples of a swing that are never sent, at random."""
    lost_from_s: NotNegative = 0.0
    """Start of an interval without samples, s since the release. A tracker that loses its points causes such an
    interval."""
    lost_for_s: NotNegative = 0.0
    """Duration of the interval without samples, s; 0: no such interval."""


class MountConfig(_Table):
    """Vibration mode of the mount: horizontal motion in the plane of the rods."""

    stiffness_N_per_m: Positive
    frequency_hz: Positive
    damping_ratio: Positive = 0.03


class OperatorConfig(_Table):
    """Errors of the operator, as standard deviations: pose, rad, and speed at the release, rad/s."""

    placement_std: NotNegative = 0.01
    release_speed_std: NotNegative = 0.002
    elbow: Finite | None = None
    """Angle theta2 - theta1 at which a clamp holds joint 2 at every pose, rad; None: the angle of the pose."""


class DriveConfig(_Table):
    """Drives of the joints, for a device that replays torques."""

    reports: tuple[Literal["measured", "commanded"], ...] = ("measured", "commanded")
    """Kinds of torques that the board reports."""
    delay_s: NotNegative = 0.0
    """Delay from the command of a torque to its effect, s."""
    noise_Nm: NotNegative = 0.0
    """Standard deviation of the measured torques, N m."""
    gain: tuple[Finite, Finite] = (1.0, 1.0)
    """Ratio of the acting to the reported torque at each joint. It differs from 1 by the error of the torque
    constant."""
    offset_Nm: tuple[Finite, Finite] = (0.0, 0.0)
    """Torque at each joint that acts from the release on and is not reported, N m."""
    ripple: tuple[tuple[Finite, Finite], tuple[Finite, Finite]] = ((0.0, 0.0), (0.0, 0.0))
    """Ripple of the torque at each joint: amplitudes of cos(n q) and sin(n q) relative to the torque, with the joint
    angle q."""
    ripple_order: NotNegative = 6.0
    """Order n of the ripple: number of periods per turn."""
    unit_uNm: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Resolution of commanded and reported torques, uN m."""


class ArmDriveConfig(_Table):
    """Motor and driver of an arm with the mode `driven`, and the program of the device."""

    input: Literal["torque", "current", "voltage"]
    """Quantity that the driver controls and the device reports: torque at the arm (N m), current (A) or voltage (V)."""
    kt: Positive = 1.0
    """Torque constant, N m/A."""
    ke: NotNegative = 0.0
    """Back-EMF constant, V s/rad."""
    R: Positive = 1.0
    """Resistance, ohm."""
    gear: Positive = 1.0
    """Turns of the motor per turn of the arm."""
    limit: Positive
    """Maximum input of the driver. A larger request is limited to this value."""
    program: Literal["sines", "chirp", "prbs", "pd"] = "sines"
    """Program of the device: two sines, a sine with increasing frequency, a pseudo-random binary sequence, or a
    controller by which the arm follows two sines."""
    amplitude: Positive
    """Amplitude of the program in units of the input; for `pd`, amplitude of the angle, rad."""
    kp: NotNegative = 0.0
    """Proportional gain of the controller `pd`, units of the input per rad."""
    kd: NotNegative = 0.0
    """Derivative gain of the controller `pd`, units of the input per rad/s."""
    rates_hz: tuple[Positive, Positive] = (0.5, 1.3)
    """Frequencies of the two sines, or initial and final frequency of the sweep, Hz. The bit rate of a sequence is half
    the second value."""
    sweep_s: Positive = 10.0
    """Duration of the sweep, s."""
    reports: Annotated[tuple[Literal["measured", "commanded"], ...], Field(min_length=1)] = ("measured", "commanded")
    """Kinds of inputs that the board reports."""
    noise: NotNegative = 0.0
    """Standard deviation of the measured input, in its unit."""
    unit_micro: Annotated[int, Field(gt=0, lt=1 << 32)] = 100
    """Resolution of the input: uN m, uA or uV."""

    @property
    def torque_per_input(self) -> float:
        """Torque at the arm per input, N m over the unit of the input."""
        return {"torque": 1.0, "current": self.gear * self.kt, "voltage": self.gear * self.kt / self.R}[self.input]

    @property
    def back_emf(self) -> float:
        """Friction of the arm due to the back-EMF of a voltage drive, N m s/rad."""
        return self.ke * self.kt * self.gear**2 / self.R if self.input == "voltage" else 0.0


class PlantConfig(_Table):
    """Content of a plant file (`configs/plants/*.toml`).

    Keys of the file: `name`, `seed`, `[parameters]` with one value for each of `PARAMETERS` (SI units), `[arm]`,
    `[arm_drive]` for a driven arm, `[effects.NAME]` or at most one `[foreign.NAME]` with the parameters of the effect,
    `[mount]`, `[encoders]`, `[drives]`, `[hand]`. Effects at joint 0 need an arm that moves. Effects of its drive need
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
        """True parameters (9,) in the order of `PARAMETERS`, SI units."""
        return np.array([self.parameters[name] for name in PARAMETERS])


def load_plant(name: str | Path, seed: int | None = None) -> PlantConfig:
    """Read a plant file by its path or built-in name.

    If `seed` is given, it replaces the seed of the file.

    Raises:
        ConfigError: the file is not found or not valid; the message names file, key and value.
    """
    config = read_config(find_config("plants", name, BUILTIN), PlantConfig)
    return config if seed is None else config.model_copy(update={"seed": seed})


def chosen_plant(name: str | Path | None, rig: Rig, seed: int | None = None) -> PlantConfig:
    """Read a plant file, or return the default plant of a rig if there is no name.

    The default is the built-in plant of the rig, or a plant with the nominal parameters of the rig.

    Raises:
        ConfigError: the file is not found or not valid; or there is no name, the arm of the rig is free or driven, and
            no built-in plant with such an arm belongs to the rig.
    """
    if name is not None:
        return load_plant(name, seed)
    moving = {"free", "driven"}
    if rig.name in built_in("rigs") and rig.name in built_in("plants", BUILTIN):
        plant = load_plant(rig.name, seed)
        if plant.arm.mode == rig.arm.mode or not {plant.arm.mode, rig.arm.mode} & moving:
            return plant
    if rig.arm.mode in moving:
        raise ConfigError(
            f"the arm of rig {rig.name} is {rig.arm.mode}, and no built-in plant with such an arm belongs to it: write"
            " a plant file, and give it as --link 'sim://?plant=FILE' (python -m sim_device: --plant FILE)"
        )
    parameters: dict[str, float] = dict(zip(PARAMETERS, rig.nominal.tolist(), strict=True))
    return PlantConfig(name=rig.name, seed=1 if seed is None else seed, parameters=parameters)

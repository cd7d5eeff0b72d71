"""Draw plants with a free or driven arm for blind trials: effects at joint 0 and of its drive."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import with_gravity
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import OF_ARM, effect_params
from dpr_lab.effects.encoder_offset import ENCODER_OFFSET_JOINT0
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.effects.limits import amplitude_limits, oversized
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.trials.arm_gap import noiseless_arm

DIRECT = {"range_rad": "angle", "limit_Nm": "torque"}
"""Quantity to which the size of each shape parameter refers: the largest angle of the arm, or the largest torque of its
drive."""


@dataclass(frozen=True, slots=True)
class ArmDraw:
    """Ranges of drawn arms and programs."""

    spread: float = 0.15
    """Maximum relative deviation of the arm's inertia and friction."""
    rates: tuple[float, float] = (0.8, 1.25)
    """Range of the factor on the frequencies of the program."""
    programs: tuple[str, ...] = ("sines", "chirp", "prbs")
    within: tuple[float, float] = (0.4, 0.8)
    """Range of the angle at which a stop begins, or of the torque at which a saturation begins, relative to the largest
    value without the effect."""
    reached: float = 0.5
    """Minimum ratio of the reached gap to the requested gap. With a smaller ratio the effect is not visible, and
    another one is drawn."""


DRAW = ArmDraw()


def with_arm(rig: Rig, plant: PlantConfig, mode: str | None) -> tuple[Rig, PlantConfig]:
    """Set the mode of the arm in a rig and its plant; None: the mode of the rig file.

    Raises:
        ConfigError: the rig or the plant has no such arm.
    """
    mode = rig.arm.mode if mode is None else mode
    if mode == "free":
        arm = plant.arm.model_copy(update={"mode": "free"})
        plant = plant.model_copy(update={"arm": arm, "arm_drive": None})
        rig = rig.model_copy(update={"arm": rig.arm.model_copy(update={"mode": "free"}), "motor": None})
    if mode == "driven" and (rig.motor is None or plant.arm_drive is None):
        raise ConfigError(
            f"rig {rig.name} or plant {plant.name} has no drive of its arm: use --rig and --plant driven_double or"
            " furuta, or files with [motor] and [arm_drive]"
        )
    if mode == "driven" and rig.motor is not None and plant.arm_drive is not None:
        if rig.motor.input != plant.arm_drive.input:
            raise ConfigError(f"the motor of rig {rig.name} has another input than plant {plant.name}")
        rig = rig.model_copy(update={"arm": rig.arm.model_copy(update={"mode": "driven"})})
    if mode != plant.arm.mode:
        raise ConfigError(f"the arm of rig {rig.name} is {mode}, that of plant {plant.name} {plant.arm.mode}")
    return rig, plant


def drawn_arm(plant: PlantConfig, rng: np.random.Generator) -> PlantConfig:
    """Return the plant with another arm and, if it has a drive, another program."""
    arm, factor = plant.arm, 1.0 + DRAW.spread * rng.uniform(-1.0, 1.0, 2)
    changed = {"arm": arm.model_copy(update={"J0": arm.J0 * float(factor[0]), "c0": arm.c0 * float(factor[1])})}
    if plant.arm_drive is not None:
        low, high = (rate * float(rng.uniform(*DRAW.rates)) for rate in plant.arm_drive.rates_hz)
        program = {"program": str(rng.choice(DRAW.programs)), "rates_hz": (low, high), "reports": ("commanded",)}
        changed |= {"arm_drive": plant.arm_drive.model_copy(update=program)}
    return plant.model_copy(update=changed)


def visible_on_arm(plant: PlantConfig) -> list[str]:
    """Return the effects at joint 0 and of its drive that recordings of this plant may show.

    Two effects are never visible. An error of the torque constant is compensated by the fitted scale of all torques or
    gain of the drive. A zero error of the arm has no influence.
    """
    driven = plant.arm_drive is not None
    names = [name for name, effect in OF_ARM.items() if driven or not effect.driven]
    hidden = (TORQUE_SCALE_JOINT0.name, ENCODER_OFFSET_JOINT0.name)
    return [name for name in (*names, *([INPUT_DELAY.name] if driven else [])) if name not in hidden]


def is_plausible(plant: PlantConfig, rig: Rig) -> bool:
    """Return whether the sizes of the plant's effects are within the limits of the library for such a rig."""
    limits = amplitude_limits(with_gravity(base_parameters(plant.Z, rig.L1, rig.g), rig.L1, rig.g), rig_constants(rig))
    return not oversized(effect_params(plant.effects), limits)


def within_reach(plant: PlantConfig, rig: Rig, unit: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Return the coefficients of an effect.

    If the effect is a stop or a saturation, it is placed where the arm or its drive reaches it. A delay is positive.
    The output of a drive never exceeds its limit, so the amplitude of a saturation is one.
    """
    wanted = [name for name in unit if name in DIRECT]
    if not wanted:
        return {name: abs(value) if name == "delay_s" else value for name, value in unit.items()}
    releases = [noiseless_arm(plant, rig, number) for number in range(1, len(rig.poses) + 1)]
    most = {
        "angle": max(_largest(release.readings[:, 2]) for release in releases),
        "torque": max(_largest(release.torque) for release in releases),
    }
    full = {"share": 1.0} if "share" in unit else {}
    return unit | full | {name: float(rng.uniform(*DRAW.within)) * most[DIRECT[name]] for name in wanted}


def _largest(values: NDArray[np.float64] | None) -> float:
    return 0.0 if values is None else float(np.abs(values).max())

"""Draw plants with driven joints: parameters, torques, and faults of the drives."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.effects.torque_offset import TORQUE_OFFSET
from dpr_lab.effects.torque_ripple import TORQUE_RIPPLE
from dpr_lab.effects.torque_scale import TORQUE_SCALE
from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from sim_device.plant.config import DriveConfig, PlantConfig, load_plant
from sim_device.plant.drives import JointDrives
from sim_device.random_streams import RandomStream, generator
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import drawn
from sim_device.trials.request import EffectRequest


@dataclass(frozen=True, slots=True)
class Driving:
    """Settings of the drawn torques, and sizes of faults that the reported torques do not show."""

    length_s: float = 10.0
    row_s: float = 0.01
    """Interval between the rows of the table of torques, s."""
    tones: int = 4
    """Number of sines in the torque of each joint, at frequencies up to `highest_hz`."""
    highest_hz: float = 3.0
    largest_Nm: float = 0.2
    """Maximum amplitude of a sine, N m; similar to the torque of gravity on a rod of the paper's rig."""
    noise_Nm: float = 2e-3
    """Standard deviation of the measured torques, N m."""
    scale: float = 0.15
    """Maximum relative error of a torque constant. For this and the next three quantities the minimum is a fifth of the
    maximum."""
    offset_Nm: float = 0.03
    ripple: float = 0.2
    """Maximum ripple, relative to the torque."""
    delay_s: float = 0.01
    subtle: float = 0.1
    """Ratio of the size of a subtle fault to that of a clear fault."""


DRIVING = Driving()


@dataclass(frozen=True, slots=True)
class DriveFault:
    """Fault of a drive that the reported torques do not show.

    `name` is the library effect that is the correct answer.
    """

    name: str
    drives: dict[str, Any]
    """Changed values in `[drives]` of the plant."""


Fault = Callable[[float, np.random.Generator], dict[str, Any]]
"""Function of a signed size, relative to the maximum, and of random numbers that returns changed values of
`[drives]`."""


def _delay(size: float, rng: np.random.Generator) -> dict[str, Any]:
    """Return a delay in whole milliseconds, because a tick of the board is one millisecond.

    The torques that the board reports are the commanded ones, because measured torques would not show a delay.
    """
    return {"delay_s": max(round(DRIVING.delay_s * abs(size), 3), 1e-3), "reports": ("commanded",)}


def _ripple(joint: int) -> Fault:
    def drawn(size: float, rng: np.random.Generator) -> dict[str, Any]:
        phase, order = rng.uniform(0, 2 * np.pi), float(rng.integers(3, 24, endpoint=True))
        share = (DRIVING.ripple * size * float(np.cos(phase)), DRIVING.ripple * size * float(np.sin(phase)))
        return {"ripple": _of(joint, share, (0.0, 0.0)), "ripple_order": order}

    return drawn


def _of(joint: int, value: Any, other: Any) -> tuple[Any, Any]:
    return (value, other) if joint == 0 else (other, value)


FAULTS: Mapping[str, Fault] = {
    TORQUE_SCALE[0].name: lambda size, rng: {"gain": (1 + DRIVING.scale * size, 1.0)},
    TORQUE_SCALE[1].name: lambda size, rng: {"gain": (1.0, 1 + DRIVING.scale * size)},
    TORQUE_OFFSET[0].name: lambda size, rng: {"offset_Nm": (DRIVING.offset_Nm * size, 0.0)},
    TORQUE_OFFSET[1].name: lambda size, rng: {"offset_Nm": (0.0, DRIVING.offset_Nm * size)},
    INPUT_DELAY.name: _delay,
    TORQUE_RIPPLE[0].name: _ripple(0),
    TORQUE_RIPPLE[1].name: _ripple(1),
}
"""Function that draws the values of a drive with each library effect."""


ANY_FAULT = EffectRequest("driven")


def drawn_fault(seed: int, wanted: EffectRequest = ANY_FAULT) -> DriveFault | None:
    """Draw a fault in `FAULTS` or None with equal probability, or return the requested one.

    Raises:
        ConfigError: the requested effect is not a fault of drives.
    """
    rng = generator(seed, RandomStream.DRAW)
    names = list(wanted.effects) or [*FAULTS, None]
    if wanted.effects and (len(names) > 1 or names[0] not in FAULTS):
        raise ConfigError(f"draw driven: the faults of drives are {', '.join(FAULTS)}, not {', '.join(wanted.effects)}")
    name = names[int(rng.integers(len(names)))]
    size = float(rng.uniform(0.2, 1.0) * rng.choice([-1.0, 1.0])) * (DRIVING.subtle if wanted.level == "subtle" else 1)
    return None if name is None else DriveFault(name, FAULTS[name](size, rng))


def driven(plant: PlantConfig, fault: DriveFault | None) -> PlantConfig:
    """Return the plant with drives that have the given fault, or no fault."""
    drives = DriveConfig(noise_Nm=DRIVING.noise_Nm, **(fault.drives if fault else {}))
    return plant.model_copy(update={"drives": drives})


def drawn_drives(plant: PlantConfig) -> JointDrives:
    """Return the drives of the plant, with a table of torques that is drawn from the seed of the plant."""
    rng, t = generator(plant.seed, RandomStream.DRIVES), np.arange(0.0, DRIVING.length_s, DRIVING.row_s)
    size, phase, rate_hz = (
        rng.uniform(low, high, (DRIVING.tones, 2))
        for low, high in ((0, DRIVING.largest_Nm), (0, 2 * np.pi), (0.2, DRIVING.highest_hz))
    )
    joints = np.sum(size * np.sin(2 * np.pi * rate_hz * t[:, None, None] + phase), axis=1)
    return JointDrives(t, joints, plant.drives, plant.seed)


def driven_runs(
    rig: Rig, seed: int, base: str = "paper", fault: DriveFault | None = None, duration: float = 3.0
) -> tuple[PlantConfig, list[Run]]:
    """Draw a plant near a plant file, and record one driven swing from each pose of the rig."""
    plant = driven(drawn(load_plant(base, seed), rig), fault)
    return plant, record(plant, rig, duration, drives=drawn_drives(plant))


def done_by_drives(config: DriveConfig) -> dict[str, dict[str, float]]:
    """Return the library effects that the drives cause, with their sizes.

    Measured torques already contain the delay, so that a board that reports them has no such effect.
    """
    effects: dict[str, dict[str, float]] = {}
    for joint in range(2):
        if config.gain[joint] != 1.0:
            effects[TORQUE_SCALE[joint].name] = {"excess": config.gain[joint] - 1.0}
        if config.offset_Nm[joint]:
            effects[TORQUE_OFFSET[joint].name] = {"offset_Nm": config.offset_Nm[joint]}
        if any(config.ripple[joint]):
            sizes = dict(zip(("cos_share", "sin_share"), config.ripple[joint], strict=True))
            effects[TORQUE_RIPPLE[joint].name] = {**sizes, "order": config.ripple_order}
    if config.delay_s and "measured" not in config.reports:
        effects[INPUT_DELAY.name] = {"delay_s": config.delay_s}
    return effects

"""Sealed plants whose joints are driven: parameters and torques that nobody chose."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.effects.torque_offset import TORQUE_OFFSET
from dpr_lab.effects.torque_scale import TORQUE_SCALE
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from sim_device.plant.config import DriveConfig, PlantConfig, load_plant
from sim_device.plant.drives import JointDrives
from sim_device.random_streams import RandomStream, generator
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import drawn


@dataclass(frozen=True, slots=True)
class Driving:
    """How joints are driven."""

    length_s: float = 3.0
    row_s: float = 0.01
    """Between rows of the table of torques."""
    tones: int = 4
    """Sines of each joint, up to `highest_hz`."""
    highest_hz: float = 3.0
    largest_Nm: float = 0.2
    """Amplitude of a sine at most: about the weight's torque on a rod of the paper's rig."""
    noise_Nm: float = 2e-3
    """Standard deviation of the measured torques."""


DRIVING = Driving()


@dataclass(frozen=True, slots=True)
class DriveFault:
    """What a drive does that its torques do not tell, and the effect of the library that is a right name for it."""

    name: str
    drives: dict[str, Any]
    """What differs in the plant's `[drives]`."""


def drawn_fault(seed: int) -> DriveFault | None:
    """None in one of seven plants; else a torque constant off by 3 to 15 %, an offset of 5 to 30 mN m, or a delay.

    The delay is of 2 to 10 ms, and shows where the commanded torques are told.
    """
    rng = generator(seed, RandomStream.DRAW)
    kind, joint = divmod(int(rng.integers(7)), 2)
    size, sign = float(rng.uniform(0.2, 1.0)), float(rng.choice([-1.0, 1.0]))
    match kind:
        case 0:
            return DriveFault(TORQUE_SCALE[joint].name, {"gain": _of(joint, 1 + 0.15 * sign * size, 1.0)})
        case 1:
            return DriveFault(TORQUE_OFFSET[joint].name, {"offset_Nm": _of(joint, 0.03 * sign * size, 0.0)})
        case 2:
            return DriveFault(INPUT_DELAY.name, {"delay_s": round(0.01 * size, 3), "tells": ("commanded",)})
    return None


def _of(joint: int, value: float, other: float) -> tuple[float, float]:
    return (value, other) if joint == 0 else (other, value)


def driven_runs(
    rig: Rig, seed: int, base: str = "paper", how: Driving = DRIVING, fault: DriveFault | None = None
) -> tuple[PlantConfig, list[Run]]:
    """A plant drawn around a plant file's, and a recording of it under torques from each of the rig's poses."""
    drives = DriveConfig(noise_Nm=how.noise_Nm, **(fault.drives if fault else {}))
    plant = drawn(load_plant(base, seed), rig).model_copy(update={"drives": drives})
    rng, t = generator(seed, RandomStream.DRIVES), np.arange(0.0, how.length_s, how.row_s)
    size, phase = rng.uniform(0, how.largest_Nm, (how.tones, 2)), rng.uniform(0, 2 * np.pi, (how.tones, 2))
    turn = 2 * np.pi * rng.uniform(0.2, how.highest_hz, (how.tones, 2))
    joints = np.sum(size * np.sin(turn * t[:, None, None] + phase), axis=1)
    return plant, record(plant, rig, how.length_s, drives=JointDrives(t, joints, plant.drives, seed))

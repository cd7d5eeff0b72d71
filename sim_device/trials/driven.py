"""Sealed plants whose joints are driven: parameters and torques that nobody chose."""

from dataclasses import dataclass

import numpy as np

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


def driven_runs(rig: Rig, seed: int, base: str = "paper", how: Driving = DRIVING) -> tuple[PlantConfig, list[Run]]:
    """A plant drawn around a plant file's, and a recording of it under torques from each of the rig's poses."""
    plant = drawn(load_plant(base, seed), rig).model_copy(update={"drives": DriveConfig(noise_Nm=how.noise_Nm)})
    rng, t = generator(seed, RandomStream.DRIVES), np.arange(0.0, how.length_s, how.row_s)
    size, phase = rng.uniform(0, how.largest_Nm, (how.tones, 2)), rng.uniform(0, 2 * np.pi, (how.tones, 2))
    turn = 2 * np.pi * rng.uniform(0.2, how.highest_hz, (how.tones, 2))
    joints = np.sum(size * np.sin(turn * t[:, None, None] + phase), axis=1)
    return plant, record(plant, rig, how.length_s, drives=JointDrives(t, joints, plant.drives, seed))

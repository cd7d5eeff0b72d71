"""Simulate noiseless encoder readings of a plant, and compute the gap that its effects cause."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.hidden import plant_of
from sim_device.trials.arm_gap import arm_gap
from sim_device.trials.gap_size import MEASURE, gap_size, reading_noise

Array = NDArray[np.float64]


def plant_gap(config: PlantConfig, rig: Rig) -> float:
    """Return the gap of the effects of a plant over one release from each pose, in units of the noise.

    It is infinite for a plant whose swing diverges.

    Raises:
        ConfigError: effects that the plant cannot have.
    """
    if config.arm.mode != "clamped":
        return arm_gap(config, rig)
    frame = (rig.rig.L1, rig.rig.g)
    truth = ratios(base_parameters(config.Z, *frame))
    readings = [noiseless(config, rig, number) for number in range(1, len(rig.poses) + 1)]
    if not all(np.isfinite(release).all() for release in readings):
        return math.inf
    relative = rig.encoders.joint2 == "relative"
    return gap_size(truth, frame, 1 / MEASURE.rate_hz, readings, reading_noise(config, rig)[:2], relative)


def noiseless(config: PlantConfig, rig: Rig, release: int) -> Array:
    """Return the readings (n, 2) of encoders 1 and 2 after a release, without noise, rad.

    `release` is the number of the pose, counted from 1.
    """
    plant, pose = plant_of(config, rig), list(rig.poses.values())[release - 1]
    ticks = np.arange(round(MEASURE.duration * MEASURE.rate_hz))
    theta = plant.let_go(pose.theta, np.zeros(3), MEASURE.rate_hz, release).theta(0, len(ticks))
    positions = rig.positions(plant.misread(theta, ticks / MEASURE.rate_hz, release - 1))
    if np.isfinite(positions).all():
        whole = np.rint(positions).astype(np.int64)
        positions += plant.counted(whole) - whole
    return (positions - rig.encoders.zero_counts)[:, 1:] * rig.radians_per_count[1:]

"""Recordings of a plant without device, link and waiting, for hundreds of trials.

The counts of the swings are identical to those over a link.
"""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_mounted
from sim_device.plant.arm_drive import ArmDrive
from sim_device.plant.config import PlantConfig
from sim_device.plant.drives import JointDrives
from sim_device.plant.hidden import plant_of
from sim_device.plant.rods import SimulatedRods

REST = 0.5
"""Duration of the rest before each release, s."""


def record(
    config: PlantConfig,
    rig: Rig,
    duration: float = 10.0,
    rate_hz: int | None = None,
    drives: JointDrives | ArmDrive | None = None,
    before: int = 0,
) -> list[Run]:
    """Record one run from each pose of the rig, as dpr-lab would record it.

    The counts of the swings equal those that the protocol would transmit. The noise of the counts at rest before the
    release differs, but has the same distribution.

    Args:
        config: the plant
        rig: the rig on which it is mounted
        duration: duration of each swing, s
        rate_hz: sample rate, Hz; None: the rate of the rig file
        drives: drives of its joints or of its arm; None for free swings
        before: number of earlier releases, whose operator errors and noise are not repeated

    Raises:
        ConfigError: effects that the plant cannot have.
    """
    rods = SimulatedRods(plant_of(config, rig), rig, drives=drives, before=before)
    return [
        _released(rods, rig, number, pose, duration, rate_hz or rig.link.rate_hz, drives)
        for number, pose in enumerate(rig.poses, 1)
    ]


def _released(
    rods: SimulatedRods,
    rig: Rig,
    number: int,
    pose: str,
    duration: float,
    rate_hz: int,
    drives: JointDrives | ArmDrive | None,
) -> Run:
    rods.place(number, 0.0)
    before = np.arange(-round(REST * rate_hz), 0)
    rest = rods.held_counts(before / rate_hz, 0)
    rods.let_go(0.0, rate_hz)
    count = round(duration * rate_hz) + 1
    sent = ~rods.missing(0, count)
    counts = np.concatenate([rest, rods.swing_counts(0, count)[sent]])
    torque_rows = rods.torques(0, count)
    torques = {}
    for k, kind in enumerate(() if drives is None else drives.kinds):
        assert drives is not None
        given = np.array([row[k] for row in torque_rows])[sent] * drives.unit
        torques[kind.name.lower()] = np.concatenate([np.zeros((len(rest), *given.shape[1:])), given])
    arm_input = next(iter(torques.values())) if isinstance(drives, ArmDrive) else None
    torques = {} if isinstance(drives, ArmDrive) else torques
    theta = _near(rig.theta(counts), rig.poses[pose].theta, len(rest))
    return Run(
        name=pose,
        t=np.concatenate([before, np.flatnonzero(sent)]) / rate_hz,
        theta=as_mounted(theta, rig.rods.mounting, pose),
        mounting=rig.rods.mounting,
        counts=counts,
        pose=pose,
        rig_name=rig.name,
        rig_sha256=rig.sha256,
        rate_hz=rate_hz,
        added_mass=rig.added_mass,
        arm_mode=rig.arm.mode,
        arm_input=arm_input,
        lost={"tick_gap": int(count - sent.sum())},
        torque_kind=next(iter(torques), ""),
        torques=next(iter(torques.values()), None),
        commanded=torques.get("commanded") if len(torques) == 2 else None,
    )


def _near(theta: NDArray[np.float64], pose: NDArray[np.float64], release: int) -> NDArray[np.float64]:
    """Subtract full turns, so that each rod is within half a turn of its pose at the row `release`."""
    turns = np.rint((theta[release] - pose) / (2 * np.pi))
    return theta - 2 * np.pi * np.where([False, True, True], turns, 0.0)

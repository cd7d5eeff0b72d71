"""Simulated rods, moved by operator, latch and gravity, and the readings of their encoders."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from sim_device.faults import Faults
from sim_device.plant import sampling_faults
from sim_device.plant.arm_drive import ArmDrive
from sim_device.plant.drives import JointDrives
from sim_device.plant.encoders import NoisyEncoders
from sim_device.plant.hidden import HiddenPlant, HiddenSwing
from sim_device.plant.operator import HABITS, HeldRods, placement, release_speed
from sim_device.plant.plant import Swing
from sim_device.random_streams import RandomStream

Counts = NDArray[np.int64]

HANGING = Pose(theta1=np.pi, theta2=np.pi)

LONGEST_REPEAT = 8
"""Maximum number of successive samples that repeat an earlier sample."""


class SimulatedRods:
    """Angles of the rods at any device time, while the operator, the latch or gravity moves or holds them.

    Args:
        plant: plant that moves the rods during a swing
        rig: rig with the poses and encoders
        placing_time: time that the operator takes to reach a pose, s of device time
        hand_error: deliberate error of both rods at every pose, rad
        clock_rate: device seconds per true second
        faults: faults of the encoders
        drives: drives of the joints or the arm during a swing; None without drives
        ready: whether the rods can be released; until then the operator does not move them
        before: number of earlier releases
    """

    def __init__(
        self,
        plant: HiddenPlant,
        rig: Rig,
        placing_time: float = 0.0,
        hand_error: float = 0.0,
        clock_rate: float = 1.0,
        faults: Faults | None = None,
        drives: JointDrives | ArmDrive | None = None,
        ready: Callable[[], bool] = lambda: True,
        before: int = 0,
    ) -> None:
        self._plant, self._config, self._faults = plant, plant.config, faults or Faults()
        self._rig, self._poses = rig, list(rig.poses.values())
        encoders = plant.config.encoders
        self._encoders = NoisyEncoders(rig, encoders.noise_counts, plant.config.seed, encoders.step_counts)
        self._placing_time, self._hand_error, self._clock_rate = placing_time, hand_error, clock_rate
        self._ready, self._drives = ready, drives
        self._held = HeldRods(HANGING.theta, HANGING.theta)
        self._swing: HiddenSwing | None = None
        self._released_at, self._rate_hz, self._release = 0.0, 1.0, before
        self._at_release = np.zeros(3, dtype=np.int64)

    def place(self, pose_number: int, now: float) -> None:
        """Let the operator move the rods to a pose of the rig, counted from 1.

        If the rig has no pose with this number, the rods stay in place. Otherwise full turns of the last swing are
        removed, so that the counters do not depend on its duration.
        """
        start = target = self._theta(now)
        if 1 <= pose_number <= len(self._poses):
            pose, config = self._poses[pose_number - 1], self._config
            target = placement(config.hand, pose, config.seed, self._release + 1, self._hand_error)
            target = self._guided(target, HABITS.near * pose.tolerance)
            if self._rig.rods.mounting == "clamped":  # the elbow is clamped before the rods are moved
                start = np.array([*start[:2], start[1] + target[2] - target[1]])
        begins = now if self._ready() else math.inf
        self._held, self._swing = HeldRods(start, target, begins, self._placing_time), None

    def let_go(self, time_s: float, rate_hz: float) -> None:
        """Open the latch at the device time `time_s`; the swing is then read at `rate_hz` ticks per second."""
        theta = self._held.theta(np.array([time_s]))[0]
        self._release += 1
        omega = release_speed(self._config.hand, self._config.seed, self._release)
        driven = None
        if self._drives is not None:
            act = self._drives.block if isinstance(self._drives, ArmDrive) else self._drives.exerted
            driven = partial(act, rate_hz=rate_hz)
        self._swing = self._plant.let_go(theta, omega, rate_hz * self._clock_rate, self._release, driven)
        self._released_at, self._rate_hz = time_s, rate_hz
        self._at_release = self._read(theta[None], RandomStream.SWING, self._release, 0)[0]

    def held_counts(self, t: NDArray[np.float64], first: int) -> Counts:
        """Return the counts (n, 3) before a release at the device times `t`.

        `first` is the tick of the first time.
        """
        self._begin_placing(float(t[0]))
        return self._read(self._held.theta(t), RandomStream.REST, self._release + 1, first)

    def swing_counts(self, first: int, count: int) -> Counts:
        """Return the counts (count, 3) of the swing.

        `first` is the first tick since the release.
        """
        before = min(first, LONGEST_REPEAT)
        again = sampling_faults.repeated(self._config, self._release, first - before, count + before, self._rate_hz)
        shown = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        counts = self._swung(first - before, count + before)[shown][before:]
        since = np.arange(first, first + count) / self._rate_hz
        return self._faults.counts(counts, self._at_release, since)

    def torques(self, first: int | None, count: int) -> NDArray[np.int64]:
        """Return the values (count, kinds, ...) that the drives report at consecutive ticks.

        The last axis is that of joints 1 and 2; the drive of the arm has no such axis. `first` is the number of the
        first tick since the release, or None while the drives are at rest.
        """
        if self._drives is None:
            return np.zeros((count, 0), dtype=np.int64)
        if isinstance(self._drives, ArmDrive):
            if first is None or not isinstance(self._swing, Swing):
                return 0 * self._drives.reported(self._release, 0, np.zeros(count))
            return self._drives.reported(self._release, first, self._swing.asked(first, count))
        if first is None:
            return 0 * self._drives.reported(self._release, 0, count, self._rate_hz)
        return self._drives.reported(self._release, first, count, self._rate_hz)

    def missing(self, first: int, count: int) -> NDArray[np.bool_]:
        """Return the flags (count,) of the samples of the swing that are never sent."""
        return sampling_faults.missing(self._config, self._release, first, count, self._rate_hz)

    def idle_counts(self, now: float, tick: int) -> Counts:
        """Return the counts (3,) at the device time `now` while nothing is streamed."""
        self._begin_placing(now)
        return self._read(self._theta(now)[None], RandomStream.IDLE, 0, tick)[0]

    def _begin_placing(self, now: float) -> None:
        """Start a movement for which the operator had to wait until the rods can be released."""
        if self._ready() and self._held.begins == math.inf:
            self._held = replace(self._held, begins=now)

    def _guided(self, target: NDArray[np.float64], near: float) -> NDArray[np.float64]:
        """Return the angles (3,) at which the operator holds the rods, so that the encoders read `target`, rad.

        The operator corrects displayed errors above `near`, rad. If no angle gives the correct reading, for example
        because of a stuck bit, the result is the target itself.
        """
        theta = target
        for _ in range(HABITS.looks):
            counts = self._read(theta[None], RandomStream.IDLE, self._release + 1, 0)[0]
            off = np.where([False, True, True], self._rig.mounted_theta(counts) - target, 0.0)
            if np.abs(off).max() <= near:
                return theta
            theta = theta - off
        return target

    def _swung(self, first: int, count: int) -> Counts:
        """Return the counts (count, 3) of the swing, each at the instant at which it is sampled."""
        assert self._swing is not None
        later = sampling_faults.instants(self._config, self._release, first, count)
        since = np.arange(first, first + count) / self._rate_hz
        if not later.any():
            return self._read(self._swing.theta(first, count), RandomStream.SWING, self._release, first, since)
        edge, ticks = min(first, 1), later * self._rate_hz
        theta = self._swing.theta(first - edge, count + 1 + edge + max(0, math.floor(ticks.max())))
        theta = sampling_faults.between_ticks(theta if edge else np.concatenate([theta[:1], theta]), ticks)
        return self._read(theta, RandomStream.SWING, self._release, first, since + later)

    def _read(
        self, theta: NDArray[np.float64], stream: RandomStream, release: int, first: int, since: ArrayLike = -np.inf
    ) -> Counts:
        """Return the counts (n, 3) for given angles at the encoders.

        `since` contains the device times since the release, s.
        """
        misread = self._plant.misread(theta, np.full(len(theta), since), release - 1)
        return self._faults.connected(self._plant.counted(self._encoders.read(misread, stream, release, first)))

    def _theta(self, now: float) -> NDArray[np.float64]:
        if self._swing is None:
            return self._held.theta(np.array([now]))[0]
        tick = max(self._swing.first, int((now - self._released_at) * self._rate_hz))
        return self._swing.theta(tick, 1)[0]

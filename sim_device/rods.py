"""The rods as hand, latch and gravity move them, and what the encoders make of it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.rig import Pose, Rig
from sim_device import dirt
from sim_device.chance import Stream
from sim_device.encoders import Encoders
from sim_device.faults import Faults
from sim_device.foreign.plant import ForeignPlant, ForeignSwing
from sim_device.hand import Held, placement, release_speed
from sim_device.plant import Plant, Swing

Counts = NDArray[np.int64]

HANGING = Pose(theta1=np.pi, theta2=np.pi)

LONGEST_REPEAT = 8  # samples in a row that say what one before them says

LOOKS = 8
"""How often the hand looks at the screen before it gives up, where that does not say what it should."""

NEAR = 0.5
"""Share of a pose's tolerance within which the hand takes what the screen says for the pose."""


class Rods:
    """Where the rods are at any device time: in the hand, in the latch, or swinging.

    Args:
        plant: moves them while they swing
        rig: poses and encoders
        placing_time: how long the hand takes to a pose, s of device time
        hand_error: how far off every pose the hand leaves both rods, on purpose, rad
        clock_rate: device seconds per true second
        faults: what is wrong with the encoders
    """

    def __init__(
        self,
        plant: Plant | ForeignPlant,
        rig: Rig,
        placing_time: float = 0.0,
        hand_error: float = 0.0,
        clock_rate: float = 1.0,
        faults: Faults | None = None,
    ) -> None:
        self._plant, self._config, self._faults = plant, plant.config, faults or Faults()
        self._rig, self._poses = rig, list(rig.poses.values())
        encoders = plant.config.encoders
        self._encoders = Encoders(rig, encoders.noise_counts, plant.config.seed, encoders.step_counts)
        self._placing_time, self._hand_error, self._clock_rate = placing_time, hand_error, clock_rate
        self._held = Held(HANGING.theta, HANGING.theta)
        self._swing: Swing | ForeignSwing | None = None
        self._released_at, self._rate_hz, self._release = 0.0, 1.0, 0
        self._at_release = np.zeros(3, dtype=np.int64)

    def place(self, pose_number: int, now: float) -> None:
        """The hand takes the rods to the rig's pose, counted from 1; 0 or a pose there is not keeps them as they are.

        Turns made by the last swing are unwound, so that the counters do not depend on how long it went on.
        """
        start = target = self._theta(now)
        if 1 <= pose_number <= len(self._poses):
            pose, config = self._poses[pose_number - 1], self._config
            target = placement(config.hand, pose, config.seed, self._release + 1, self._hand_error)
            target = self._guided(target, NEAR * pose.tolerance)
        self._held, self._swing = Held(start, target, now, self._placing_time), None

    def let_go(self, at: float, rate_hz: float) -> None:
        """The latch opens at the device time `at`; from then on the swing is read at `rate_hz` ticks a second."""
        theta = self._held.theta(np.array([at]))[0]
        self._release += 1
        omega = release_speed(self._config.hand, self._config.seed, self._release)
        self._swing = self._plant.let_go(theta, omega, rate_hz * self._clock_rate, self._release)
        self._released_at, self._rate_hz = at, rate_hz
        self._at_release = self._read(theta[None], Stream.SWING, self._release, 0)[0]

    def held_counts(self, t: NDArray[np.float64], first: int) -> Counts:
        """(n, 3) counts of the rest before a release at the device times `t`; `first` is the tick of the first."""
        return self._read(self._held.theta(t), Stream.REST, self._release + 1, first)

    def swing_counts(self, first: int, count: int) -> Counts:
        """(count, 3) counts of the swing; `first` is the tick of the first since the release."""
        before = min(first, LONGEST_REPEAT)
        again = dirt.repeated(self._config, self._release, first - before, count + before)
        said = np.maximum.accumulate(np.where(again, 0, np.arange(len(again))))
        counts = self._swung(first - before, count + before)[said][before:]
        since = np.arange(first, first + count) / self._rate_hz
        return self._faults.counts(counts, self._at_release, since)

    def missing(self, first: int, count: int) -> NDArray[np.bool_]:
        """(count,) which samples of the swing the board never sends."""
        return dirt.missing(self._config, self._release, first, count)

    def idle_counts(self, now: float, tick: int) -> Counts:
        """(3,) counts at the device time `now` while nothing is streamed."""
        return self._read(self._theta(now)[None], Stream.IDLE, 0, tick)[0]

    def _guided(self, target: NDArray[np.float64], near: float) -> NDArray[np.float64]:
        """(3,) where the encoders read `target`, if they misread that itself by more than `near`, rad.

        A hand follows the screen. Where no place reads right, such as under a bit that is stuck, it is the target.
        """
        theta = target
        for _ in range(LOOKS):
            counts = self._read(theta[None], Stream.IDLE, self._release + 1, 0)[0]
            off = np.where([False, True, True], self._rig.theta(counts) - target, 0.0)
            if np.abs(off).max() <= near:
                return theta
            theta = theta - off
        return target

    def _swung(self, first: int, count: int) -> Counts:
        """(count, 3) counts of the swing, each at its own instant."""
        assert self._swing is not None
        later = dirt.instants(self._config, self._release, first, count)
        since = np.arange(first, first + count) / self._rate_hz
        if not later.any():
            return self._read(self._swing.theta(first, count), Stream.SWING, self._release, first, since)
        edge = min(first, 1)
        theta = self._swing.theta(first - edge, count + 1 + edge)
        theta = dirt.between_ticks(theta if edge else np.concatenate([theta[:1], theta]), later * self._rate_hz)
        return self._read(theta, Stream.SWING, self._release, first, since + later)

    def _read(
        self, theta: NDArray[np.float64], stream: Stream, release: int, first: int, since: ArrayLike = -np.inf
    ) -> Counts:
        """(n, 3) counts of the angles that encoders are shown at the device times `since` the release."""
        misread = self._plant.misread(theta, np.full(len(theta), since), release - 1)
        return self._plant.counted(self._encoders.read(misread, stream, release, first))

    def _theta(self, now: float) -> NDArray[np.float64]:
        if self._swing is None:
            return self._held.theta(np.array([now]))[0]
        tick = max(self._swing.first, int((now - self._released_at) * self._rate_hz))
        return self._swing.theta(tick, 1)[0]

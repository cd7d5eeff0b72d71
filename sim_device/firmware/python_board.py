"""Simulated board: the device role of the protocol, with readings of the simulated rods."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import Rig
from firmware_protocol.device_role import Answer, DeviceSession, Task
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    NUMBERS,
    ClearFault,
    Frame,
    Hold,
    Ping,
    Release,
    Sample,
    State,
    Stop,
    Stream,
)
from sim_device.faults import Faults
from sim_device.firmware.clock import Clock
from sim_device.plant.rods import SimulatedRods

FIRMWARE = "1.0.0"
RATE_DEFAULT_HZ = 1000
"""Ticks per second until the host requests another rate, Hz."""
REPORTS_HZ = 10
"""Number of POSITION and of STATUS messages per second."""


def identity(rig: Rig, uid: int, rate_max_hz: int, simulated_time: bool) -> DeviceInfo:
    """Return the identity that the simulated board reports."""
    return DeviceInfo(
        firmware=FIRMWARE,
        uid=f"{uid:016x}",
        counts_per_rev=rig.encoders.counts_per_rev,
        rate_max_hz=rate_max_hz,
        rate_default_hz=min(RATE_DEFAULT_HZ, rate_max_hz),
        simulated_time=simulated_time,
    )


@dataclass(frozen=True, slots=True)
class TickBase:
    """Relation of ticks to device time: tick `first` is at the time `origin`, then `rate_hz` ticks per second."""

    origin: float
    rate_hz: int
    first: int = 0

    def at(self, now: float) -> float:
        """Return the number of ticks, with fraction, at the device time `now`, s."""
        return self.first + (now - self.origin) * self.rate_hz

    def times(self, first: int, count: int) -> NDArray[np.float64]:
        """Return the device times (count,) of the ticks `first`, `first` + 1, ..., s."""
        return self.origin + (np.arange(first, first + count) - self.first) / self.rate_hz


def streamed(
    rods: SimulatedRods, ticks: TickBase, released_at: int | None, first: int, count: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Read counts (count, 3) at the ticks from `first` on, and flags (count,) of samples that the board loses.

    Args:
        rods: the measured rods
        ticks: relation of ticks to device time
        released_at: tick of the release; None while the rods are held
        first: the first tick
        count: number of ticks
    """
    if released_at is None:
        return rods.held_counts(ticks.times(first, count), first), np.zeros(count, dtype=np.bool_)
    return rods.swing_counts(first - released_at, count), rods.missing(first - released_at, count)


def is_sample(frame: Frame) -> bool:
    """Return whether a frame contains a sample."""
    return frame.number == NUMBERS[Sample]


@dataclass(slots=True)
class Counters:
    """Numbers of samples since the last message STREAM, for the message STATUS."""

    taken: int = 0
    overruns: int = 0
    dropped: int = 0

    def count(self, in_time: bool) -> None:
        """Count a tick, whose sample was taken in time or not."""
        self.taken += in_time
        self.overruns += not in_time


class PythonBoard:
    """Board on a link: it converts received frames to frames to send.

    The wall time is an argument of its methods, s. `clock` measures the lease and the ticks.
    """

    def __init__(self, info: DeviceInfo, rods: SimulatedRods, clock: Clock, faults: Faults | None = None) -> None:
        self._info, self._rods, self._clock, self._faults = info, rods, clock, faults or Faults()
        self.streamed = 0.0
        """Device time spent streaming since the first start, s."""
        self._start()

    def _start(self) -> None:
        self._session = DeviceSession(self._info)
        self._counters = Counters()
        self._restart_ticks(self._info.rate_default_hz)

    def reset(self) -> None:
        """Restart the board, as after a power failure: a closed latch opens, and all state is lost."""
        if self._session.latched:
            self._rods.let_go(self._clock.now, self._info.rate_default_hz)
        self._start()

    @property
    def streams(self) -> bool:
        """Whether samples are being sent."""
        return self._session.streams

    def service(self, wall: float, blocked: bool = False) -> list[Frame]:
        """Return the messages to send by the wall time `wall`, s.

        `blocked` states that the link accepts no more frames.
        """
        now = self._clock.advance(wall, self._session.state, self._ticks.rate_hz, blocked)
        frames = self._carry_out(self._session.check_lease(self._clock.watch(wall), self._next_tick), now)
        first, self._next_tick = self._next_tick, max(self._next_tick, int(self._ticks.at(now)) + 1)
        count = self._next_tick - first
        return frames + (self._samples(first, count) if self._session.streams else self._reports(first, count, now))

    def receive(self, frame: Frame, wall: float) -> list[Frame]:
        """Process a frame that arrived at the wall time `wall`, s, and return the answers."""
        now = self._clock.advance(wall, self._session.state, self._ticks.rate_hz)
        return self._carry_out(self._session.receive(frame, self._clock.watch(wall)), now)

    def note_dropped(self, frames: Iterable[Frame]) -> None:
        """Register the samples in frames for which the link had no room."""
        self._counters.dropped += sum(map(is_sample, frames))

    def _carry_out(self, answer: Answer, now: float) -> list[Frame]:
        return [*answer.frames, *(self._do(answer.task, now) if answer.task else [])]

    def _do(self, task: Task, now: float) -> list[Frame]:
        match task:
            case Hold(pose=pose):
                self._rods.place(pose, now)
            case Stream(rate_hz=rate_hz):
                self._counters = Counters()
                self._ticks, self._next_tick = TickBase(now, rate_hz), 0
            case Release():
                return self._let_go()
            case Stop():
                self._restart_ticks(self._info.rate_default_hz)
            case Ping():
                tick, fraction = divmod(self._ticks.at(now), 1.0)
                return [self._session.pong(task, int(tick), fraction)]
            case ClearFault():
                pass
        return []

    def _let_go(self) -> list[Frame]:
        """Open the latch at the instant of the next sample, which becomes the first sample of the swing."""
        self._release_tick = self._next_tick
        self._rods.let_go(float(self._ticks.times(self._release_tick, 1)[0]), self._ticks.rate_hz)
        return [self._session.released(self._release_tick)]

    def _restart_ticks(self, rate_hz: int) -> None:
        self._ticks, self._next_tick = TickBase(self._clock.now, rate_hz), 0

    def _samples(self, first: int, count: int) -> list[Frame]:
        if not count:
            return []
        frames: list[Frame] = []
        in_time = self._faults.taken(count)
        released_at = self._release_tick if self._session.state is State.RELEASED else None
        streamed_counts, missing = streamed(self._rods, self._ticks, released_at, first, count)
        sent = in_time & ~missing
        torques = self._rods.torques(None if released_at is None else first - released_at, count).tolist()
        for tick, counts in enumerate(streamed_counts.tolist(), first):
            if self._reports_due(tick):
                frames += self._report(tick, counts)
            if sent[tick - first]:
                frames.append(self._session.sample(tick, counts))
                frames += self._drives(tick, torques[tick - first])
            self._counters.count(bool(in_time[tick - first]))
        self.streamed += count / self._ticks.rate_hz
        return frames

    def _drives(self, tick: int, by_kind: list[Any]) -> list[Frame]:
        if self._info.input_kinds:
            inputs = zip(self._info.input_kinds, by_kind, strict=True)
            return [self._session.arm_input(kind, tick, value) for kind, value in inputs]
        torques = zip(self._info.torque_kinds, by_kind, strict=True)
        return [self._session.torque(kind, tick, pair) for kind, pair in torques]

    def _reports(self, first: int, count: int, now: float) -> list[Frame]:
        last = first + count - 1
        if not self._session.greeted or not any(self._reports_due(tick) for tick in range(first, last + 1)):
            return []
        return self._report(last, self._rods.idle_counts(now, last).tolist())

    def _reports_due(self, tick: int) -> bool:
        return tick % max(1, self._ticks.rate_hz // REPORTS_HZ) == 0

    def _report(self, tick: int, counts: list[int]) -> list[Frame]:
        counters = self._counters
        return [
            *self._session.report(tick, counts, counters.overruns, counters.dropped, counters.taken - counters.dropped)
        ]

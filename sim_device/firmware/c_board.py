"""Simulated board with the reference firmware in C, which behaves like `PythonBoard`."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import NUMBERS, ArmInput, Frame, Sample, State, Torque
from firmware_protocol.session import STREAMS
from sim_device.faults import Faults
from sim_device.firmware.c_firmware import Firmware
from sim_device.firmware.clock import Clock
from sim_device.firmware.python_board import TickBase, is_sample, streamed
from sim_device.plant.rods import SimulatedRods


class CBoard:
    """Board on a link: the reference firmware with latch, timer and encoders.

    The wall time is an argument of its methods, s.
    """

    def __init__(self, info: DeviceInfo, rods: SimulatedRods, clock: Clock, faults: Faults | None = None) -> None:
        self._info, self._rods, self._clock, self._faults = info, rods, clock, faults or Faults()
        self.streamed = 0.0
        """Device time spent streaming since the first start, s."""
        self._start()

    def _start(self) -> None:
        self._firmware = Firmware(self._info)
        self._release_tick = 0
        self._act(self._clock.now)

    def reset(self) -> None:
        """Restart the board, as after a power failure: a closed latch opens, and all state is lost."""
        if self._firmware.latched:
            self._rods.let_go(self._clock.now, self._info.rate_default_hz)
        self._start()

    @property
    def streams(self) -> bool:
        """Whether samples are being sent."""
        return self._firmware.state in STREAMS

    def service(self, wall: float, blocked: bool = False) -> list[Frame]:
        """Return the messages to send by the wall time `wall`, s.

        `blocked` states that the link accepts no more frames.
        """
        now = self._clock.advance(wall, self._firmware.state, self._ticks.rate_hz, blocked)
        frames = self._firmware.poll(self._millis(wall))
        self._act(now)
        first, self._next_tick = self._next_tick, max(self._next_tick, int(self._ticks.at(now)) + 1)
        count = self._next_tick - first
        if not count:
            return frames
        if not self.streams:
            return frames + self._firmware.poll(self._millis(wall), self._idle_reading(now))
        return frames + self._samples(wall, first, count)

    def receive(self, frame: Frame, wall: float) -> list[Frame]:
        """Process a frame that arrived at the wall time `wall`, s, and return the answers."""
        now = self._clock.advance(wall, self._firmware.state, self._ticks.rate_hz)
        frames = self._firmware.receive(frame, self._millis(wall), self._ticks.at(now))
        self._act(now)
        return frames

    def note_dropped(self, frames: Iterable[Frame]) -> None:
        """Register the samples in frames for which the link had no room."""
        self._firmware.note_dropped(sum(map(is_sample, frames)))

    def _millis(self, wall: float) -> int:
        return int(self._clock.watch(wall) * 1000)

    def _act(self, now: float) -> None:
        actions = self._firmware.hardware_actions()
        if actions.hold:
            self._rods.place(actions.pose, now)
        if actions.release:
            self._release_tick = actions.release_tick
            self._rods.let_go(float(self._ticks.times(self._release_tick, 1)[0]), self._ticks.rate_hz)
        if actions.start_ticks:
            self._ticks, self._next_tick = TickBase(now, actions.rate_hz), 0

    def _idle_reading(self, now: float) -> NDArray[np.int64]:
        """Return the newest reading (1, 4).

        While nothing is streamed, earlier readings are discarded.
        """
        tick = self._next_tick - 1
        return np.concatenate([[tick], self._rods.idle_counts(now, tick)])[None]

    def _samples(self, wall: float, first: int, count: int) -> list[Frame]:
        ticks, in_time = np.arange(first, first + count), self._faults.taken(count)
        released_at = self._release_tick if self._firmware.state is State.RELEASED else None
        counts, missing = streamed(self._rods, self._ticks, released_at, first, count)
        reported = self._rods.torques(None if released_at is None else first - released_at, count)[in_time]
        torques, inputs = (None, reported) if self._info.input_kinds else (reported, None)
        readings = np.column_stack([ticks, counts])[in_time]
        frames = self._firmware.poll(self._millis(wall), readings, torques, inputs)
        self.streamed += count / self._ticks.rate_hz
        return _arrived(frames, missing[in_time].tolist())


def _arrived(frames: Iterable[Frame], missing: Iterable[bool]) -> list[Frame]:
    """Return the frames that a board sends, without lost samples and without the torques at their ticks."""
    arrived: list[Frame] = []
    following, gone = iter(missing), False
    for frame in frames:
        gone = next(following) if is_sample(frame) else gone
        if not (gone and frame.number in (NUMBERS[Sample], NUMBERS[Torque], NUMBERS[ArmInput])):
            arrived.append(frame)
    return arrived

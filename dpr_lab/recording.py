"""A recording under way: what is held in memory for the gate, and written to the run file as it arrives."""

import signal
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from dpr_lab.device import Batch, arrays
from dpr_lab.gate import Verdict, judge, pose_error
from dpr_lab.rig import JOINTS, Rig
from dpr_lab.run import Run
from dpr_lab.storage.metadata import RunSummary
from dpr_lab.storage.writer import RunWriter
from firmware_protocol.clock import ClockFit
from firmware_protocol.messages import Event, EventKind, Message, Status
from firmware_protocol.stream import Row

NANOSECONDS = 1_000_000_000
INTERRUPTS = (signal.SIGINT, signal.SIGTERM)


class Samples:
    """Ticks and counts that grow while recording, 32 bytes a sample."""

    def __init__(self) -> None:
        self._table = np.empty((4096, 1 + JOINTS), dtype=np.int64)
        self._used = 0

    def __len__(self) -> int:
        return self._used

    @property
    def ticks(self) -> NDArray[np.int64]:
        """(n,) sample numbers."""
        return self._table[: self._used, 0]

    @property
    def counts(self) -> NDArray[np.int64]:
        """(n, 3) position counters."""
        return self._table[: self._used, 1:]

    def extend(self, ticks: NDArray[np.int64], counts: NDArray[np.int64]) -> None:
        """Take in newer samples."""
        end = self._used + len(ticks)
        if end > len(self._table):
            self._table = np.concatenate([self._table, np.empty((end, 1 + JOINTS), dtype=np.int64)])
        self._table[self._used : end, 0], self._table[self._used : end, 1:] = ticks, counts
        self._used = end


class Recording:
    """One release going to its file.

    Args:
        writer: the open run file
        lost: the device's losses so far; only what comes on top belongs to this run
        duration: how long to record after the release, s; later samples are left out, so that the length of a run does
            not depend on how fast the host was
    """

    def __init__(self, writer: RunWriter, lost: Mapping[str, int], duration: float) -> None:
        self.release_tick: int | None = None
        self.samples = Samples()
        self._writer = writer
        self._duration = duration
        self._end_tick: int | None = None
        self._newest_tick = -1
        self._finished = False
        self._lost_before = dict(lost)
        self._lost = dict(lost)
        self._to_epoch = time.time() - time.monotonic()

    @property
    def rig(self) -> Rig:
        """The rig it is recorded on."""
        return self._writer.metadata.rig

    @property
    def t(self) -> float:
        """Time from the release to the newest sample, s; 0 before the release."""
        if self.release_tick is None or not len(self.samples):
            return 0.0
        return float(self.samples.ticks[-1] - self.release_tick) / self._writer.metadata.rate_hz

    def add(self, batches: Iterable[Batch]) -> None:
        """Write new batches to the file."""
        rows: list[Row] = []
        with unbroken():
            for batch in batches:
                host_ns = self._host_ns(batch.host_time)
                self._writer.raw(host_ns, batch.raw)
                for message in batch.messages:
                    self._message(host_ns, message)
                rows += batch.rows
            if rows:
                self._newest_tick = rows[-1].tick
            if self._end_tick is not None:
                rows = [row for row in rows if row.tick <= self._end_tick]
            if rows:
                ticks, counts = arrays(rows)
                self._writer.samples(ticks, counts)
                self.samples.extend(ticks, counts)

    @property
    def full(self) -> bool:
        """Whether the recording has reached its end."""
        return self._end_tick is not None and self._newest_tick >= self._end_tick

    def end_here(self) -> None:
        """Take no further samples."""
        self._end_tick, self._duration = int(self.samples.ticks[-1]), self.t

    def tail(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Time (n,), s, and angles (n, 3), rad, of the newest samples."""
        rate_hz = self._writer.metadata.rate_hz
        newest = slice(-round(seconds * rate_hz), None)
        return self.samples.ticks[newest] / rate_hz, self._writer.metadata.rig.theta(self.samples.counts[newest])

    def count_losses(self, lost: Mapping[str, int]) -> None:
        """Note the device's losses as they stand now."""
        self._lost = dict(lost)

    @property
    def lost(self) -> dict[str, int]:
        """Samples lost during this recording, by cause.

        Every missing tick counts once: as damaged or overrun where the link or the device said so, as `tick_gap` where
        nothing explains it.
        """
        lost = {cause: self._lost[cause] - before for cause, before in self._lost_before.items()}
        explained = sum(number for cause, number in lost.items() if cause != "tick_gap")
        ticks = self.samples.ticks
        missing = int(ticks[-1] - ticks[0]) + 1 - len(ticks) if len(ticks) else 0
        return {**lost, "tick_gap": max(0, missing - explained)}

    @property
    def pose_measured(self) -> tuple[float, float, float] | None:
        """Mean angles just before the release, whole turns aside, rad; None without rest or pose."""
        run, pose = self.run(), self._writer.metadata.rig.poses.get(self._writer.metadata.pose or "")
        if pose is None or self.release_tick is None or not len(run.rest):
            return None
        theta1, theta2 = pose.theta[1:] + pose_error(run.rest, pose).mean(axis=0)
        return float(run.rest[:, 0].mean()), float(theta1), float(theta2)

    def run(self, complete: bool = True) -> Run:
        """The recording as it stands, for the gate; without a release, time counts from the first sample."""
        metadata = self._writer.metadata
        ticks, counts = self.samples.ticks, self.samples.counts
        start = self.release_tick if self.release_tick is not None else ticks[0] if len(ticks) else 0
        return Run(
            name=self._writer.path.stem,
            t=(ticks - start) / metadata.rate_hz,
            theta=metadata.rig.theta(counts),
            counts=counts,
            pose=metadata.pose,
            rig_name=metadata.rig.name,
            rig_sha256=metadata.rig.sha256,
            rate_hz=metadata.rate_hz,
            complete=complete,
            lost=self.lost,
        )

    def finish(self, clock: ClockFit | None) -> Verdict:
        """Judge the recording and complete its file."""
        verdict = judge(self.run(), self._writer.metadata.rig, self._duration)
        with unbroken():
            if clock is not None:
                self._writer.clock(self._host_ns(time.monotonic()), asdict(clock))
            self._writer.finish(self._summary(verdict, clock))
            self._finished = True
        return verdict

    def abort(self, reason: str) -> None:
        """Close the file as an incomplete run, saying why; a finished one stays finished."""
        if self._finished:
            return
        verdict = judge(self.run(complete=False), self._writer.metadata.rig) if len(self.samples) else None
        with unbroken():
            self._writer.abort(reason, self._summary(verdict, None))

    def _summary(self, verdict: Verdict | None, clock: ClockFit | None) -> RunSummary:
        return RunSummary(
            release_tick=self.release_tick,
            lost=self.lost,
            clock=asdict(clock) if clock is not None else {},
            gate=verdict.sentence if verdict is not None else "",
            gate_figures={f"{c.name} ({c.unit})": c.measured for c in verdict.checks} if verdict is not None else {},
            pose_measured=self.pose_measured,
        )

    def _message(self, host_ns: int, message: Message) -> None:
        if isinstance(message, Event):
            self._writer.event(host_ns, message.kind.name, message.tick, str(message.detail))
            if message.kind is EventKind.RELEASED:
                self.release_tick = message.tick
                self._end_tick = message.tick + round(self._duration * self._writer.metadata.rate_hz)
        elif isinstance(message, Status):
            state = {"state": message.state.name, "latched": message.latched, "fault": message.fault.name}
            counters = {"overruns": message.overruns, "dropped": message.dropped, "sent": message.sent}
            self._writer.status(host_ns, state | counters)

    def _host_ns(self, host_time: float) -> int:
        return round((host_time + self._to_epoch) * NANOSECONDS)


@contextmanager
def unbroken() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back until the block is done: a record half written would cost the rest of the file."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held_back: list[int] = []
    ours = {number: signal.signal(number, lambda caught, frame: held_back.append(caught)) for number in INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)
    if held_back:
        signal.raise_signal(signal.SIGINT)

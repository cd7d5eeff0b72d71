"""Recording of samples to the run file, and to a temporary file for the quality checks."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace

import numpy as np

from dpr_lab.acquisition.arrivals import Arrivals
from dpr_lab.acquisition.batch import AnyRow, Batch, arrays, torques_of
from dpr_lab.acquisition.gate import DeviceState, JudgedRun, QualityReport, judge
from dpr_lab.acquisition.interrupts import unbroken
from dpr_lab.acquisition.rest import RodAngles, RodPair, pose_error
from dpr_lab.acquisition.settings import QUALITY_LIMITS, QualityLimits
from dpr_lab.arrays import Array
from dpr_lab.errors import DeviceFault
from dpr_lab.run import Run, turned_arm
from dpr_lab.storage.metadata import RunSummary
from dpr_lab.storage.spool import Spool
from dpr_lab.storage.writer import RunWriter
from firmware_protocol.clock import ClockFit
from firmware_protocol.messages import Event, EventKind, Message, Status
from firmware_protocol.torques import DrivenRow


class Recording:
    """Recording of one release to a file; a context manager.

    Args:
        writer: the open run file
        lost: number of samples lost before the first sample, by cause; only later losses are attributed to this run
        duration: duration after the release, s; later samples are ignored, so that the length of a run does not depend
            on the speed of the host
        hanging: deviation of the hanging rods from the vertical before they were raised, rad; None if not measured
        limits: limits of the quality checks
    """

    def __init__(
        self,
        writer: RunWriter,
        lost: Mapping[str, int],
        duration: float,
        hanging: RodPair | None = None,
        limits: QualityLimits = QUALITY_LIMITS,
    ) -> None:
        self.release_tick: int | None = None
        with writer.disk():
            self.samples = Spool(writer.path.parent)
        self._writer = writer
        self.rig, self.rate_hz = writer.metadata.rig, writer.metadata.rate_hz
        self._hanging, self._limits = hanging, limits
        self._clock: dict[str, float] = {}
        self._clock_at = 0.0
        self._no_clock_fit = ""
        self._arrivals = Arrivals(writer.metadata.rate_hz)
        self._statuses = self._latched = 0
        self._duration = duration
        self._end_tick: int | None = None
        self._newest_tick = -1
        self._earliest_release: int | None = None
        self._finished = False
        self._lost_before = dict(lost)
        self._lost = dict(lost)
        self._to_epoch = time.time() - time.monotonic()
        self._inputs: list[Array] = []
        self._motor: list[tuple[int, int]] = []

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.samples.close()

    def expect_release(self) -> None:
        """Accept a reported release from the newest sample on; call this just before RELEASE is sent."""
        self._earliest_release = max(self._newest_tick, 0)

    @property
    def t(self) -> float:
        """Time from the release to the newest sample, s.

        The time is 0 before the release.
        """
        if self.release_tick is None or not len(self.samples):
            return 0.0
        return (self.samples.last_tick - self.release_tick) / self.rate_hz

    def add(self, batches: Iterable[Batch]) -> None:
        """Write new batches to the file."""
        rows: list[AnyRow] = []
        with unbroken():
            for batch in batches:
                host_ns = self._host_ns(batch.host_time)
                self._writer.raw(host_ns, batch.raw)
                for message in batch.messages:
                    self._message(host_ns, message)
                rows += batch.rows
                if batch.rows:
                    self._arrivals.add(batch.rows[-1].tick, batch.host_time)
            if rows:
                self._newest_tick = rows[-1].tick
            if self._end_tick is not None:
                rows = [row for row in rows if row.tick <= self._end_tick]
            if rows:
                ticks, counts = arrays(rows)
                extra = self._writer.metadata.extra
                unit = int(extra.get("torque_unit_uNm", extra.get("input_unit_micro", 0)))
                torques = torques_of(rows, unit)
                self._writer.samples(ticks, counts, torques)
                with self._writer.disk():
                    self.samples.extend(ticks, counts)
                if torques is not None and "input_unit_micro" in extra:
                    self._inputs.append(torques[0, :, 0])
                if self.rig.arm.mode == "free" and "torque_unit_uNm" not in extra:
                    self._motor += [(row.tick, row.torques[0][0]) for row in rows if isinstance(row, DrivenRow)]

    @property
    def full(self) -> bool:
        """Whether the recording has its full duration."""
        return self._end_tick is not None and self._newest_tick >= self._end_tick

    def end_here(self) -> None:
        """End the recording with the newest sample; later samples are ignored."""
        self._end_tick, self._duration = self.samples.last_tick, self.t

    def tail(self, seconds: float) -> tuple[Array, Array]:
        """Return the times (n,), s, and angles (n, 3), rad, of the last `seconds`."""
        ticks, counts = self.samples.newest(round(seconds * self.rate_hz))
        return ticks / self.rate_hz, self.rig.mounted_theta(counts)

    @property
    def clock_due(self) -> bool:
        """Whether a clock fit must be written now.

        The file of a killed recording then contains a clock fit.
        """
        return time.monotonic() >= self._clock_at

    def note_clock(self, fit: ClockFit | None, missing: str = "", next_in_s: float = 5.0) -> None:
        """Write a clock fit; without a fit, store the reason `missing`.

        A finished file is not changed. The next fit is due after `next_in_s`.
        """
        if self._finished:
            return
        now = time.monotonic()
        self._clock_at, self._no_clock_fit = now + next_in_s, missing
        arrivals = self._arrivals.fit() if self._in_real_time else None
        fitted = {} if fit is None else {**asdict(fit), "offset_unix": fit.offset + self._to_epoch}
        self._clock = fitted | ({} if arrivals is None else asdict(arrivals))
        if self._clock:
            with unbroken():
                self._writer.clock(self._host_ns(now), self._clock)

    @property
    def _in_real_time(self) -> bool:
        """Whether the device's clock must agree with the host's clock.

        It must agree if the device declares real time, or if its samples arrive steadily near real time. A simulated
        clock is many times faster or slower, or irregular. A real clock that is declared as simulated runs steadily
        near real time. A device of a `sim:` link has no real clock.
        """
        if self._writer.metadata.extra.get("simulated_time") != "true":
            return True
        if self._writer.metadata.url.startswith("sim:"):
            return False
        arrivals, limits = self._arrivals.fit(), self._limits
        return (
            arrivals is not None
            and abs(arrivals.arrival_ppm) < limits.real_pace_ppm
            and arrivals.arrival_margin_ppm < limits.clock_std_ppm
        )

    def _judged(self, run: Run, duration: float) -> QualityReport:
        device = DeviceState(self._in_real_time, self._no_clock_fit, self._statuses, self._latched)
        return judge(JudgedRun(run, self.rig, duration, self._hanging, self._limits, device))

    def since(self, first: int) -> tuple[Array, Array]:
        """Return times and angles of the samples from index `first` on.

        The times (n,) are in s since the release; the angles (n, 3) are in rad.
        """
        ticks, counts = self.samples.newest(len(self.samples) - first)
        return (ticks - (self.release_tick or 0)) / self.rate_hz, self.rig.mounted_theta(counts)

    def new_inputs(self) -> Array | None:
        """Return the input of the arm's drive (n,) at the samples since the last call.

        The unit is that of the rig file. The result is None if there is no drive.
        """
        inputs, self._inputs = self._inputs, []
        return np.concatenate(inputs) if inputs else None

    def count_losses(self, lost: Mapping[str, int]) -> None:
        """Store the current loss counters of the device."""
        self._lost = dict(lost)

    @property
    def lost(self) -> dict[str, int]:
        """Number of samples lost during this recording, by cause.

        Every missing tick counts once: under the cause that the link or the device reported, or as `tick_gap` if
        neither reported the loss. A contradicted POSITION explains no missing tick.
        """
        lost = {cause: count - self._lost_before.get(cause, 0) for cause, count in self._lost.items()}
        explained = sum(number for cause, number in lost.items() if cause not in ("tick_gap", "contradicted_position"))
        return {**lost, "tick_gap": max(0, self.samples.missing - explained)}

    @property
    def pose_measured(self) -> RodAngles | None:
        """Mean angles just before the release without whole turns, rad.

        The value is None if there are no samples at rest, or if the recording has no pose.
        """
        pose = self.rig.poses.get(self._writer.metadata.pose or "")
        if pose is None or self.release_tick is None:
            return None
        ticks, counts = self.samples.oldest(max(0, self.release_tick - self.samples.first_tick))
        rest = self.rig.mounted_theta(counts[ticks < self.release_tick])
        if not len(rest):
            return None
        theta1, theta2 = pose.theta[1:] + pose_error(rest, pose).mean(axis=0)
        return float(rest[:, 0].mean()), float(theta1), float(theta2)

    def run(self, complete: bool = True) -> Run:
        """Return the recording so far as a run, for the quality gate.

        If there was no release, the time of the run starts at the first sample.
        """
        metadata = self._writer.metadata
        ticks, counts = self.samples.newest(len(self.samples))
        start = self.release_tick if self.release_tick is not None else ticks[0] if len(ticks) else 0
        return Run(
            name=self._writer.path.stem,
            t=(ticks - start) / metadata.rate_hz,
            theta=metadata.rig.mounted_theta(counts),
            counts=counts,
            pose=metadata.pose,
            rig_name=metadata.rig.name,
            rig_sha256=metadata.rig.sha256,
            rate_hz=metadata.rate_hz,
            mounting=metadata.rig.rods.mounting,
            complete=complete,
            clock=self._clock,
            lost=self.lost,
        )

    def finish(self, clock: tuple[ClockFit | None, str], notes: tuple[str, ...] = ()) -> QualityReport:
        """Check the recording, add `notes` to the quality report, and complete the run file."""
        self.note_clock(*clock)
        notes = (*notes, *self._torque_notes(), *self._arm_notes())
        report = self._judged(self.run(), self._duration)
        report = replace(report, notes=notes)
        with unbroken():
            self._writer.finish(self._summary(report))
            self._finished = True
        return report

    def _torque_notes(self) -> tuple[str, ...]:
        lost = self.lost.get("torque", 0)
        note = (
            f"{lost} samples arrived without their torques and were discarded, because the drive torque"
            f" at these samples is unknown"
        )
        return (note,) if lost else ()

    def _arm_notes(self) -> tuple[str, ...]:
        """Return a note if a clamped arm moves, or if the motor of a free arm has an input."""
        if self.release_tick is None:
            return ()
        if self.rig.arm.mode == "clamped":
            return tuple(filter(None, [turned_arm(self.run().swing.theta)]))
        if not self._motor:
            return ()
        ticks, inputs = np.array(self._motor, dtype=np.float64).T
        rest, swing = inputs[ticks < self.release_tick], inputs[ticks >= self.release_tick]
        noise = float(np.std(rest)) if len(rest) else 0.0
        if not len(swing) or float(np.sqrt(np.mean(swing**2))) <= self._limits.motor_on * (noise + 1.0):
            return ()
        return (
            "the arm is described as free, but the device reported an input of its motor during the swing: if the"
            " motor was on, record with --arm driven and [motor] in the rig file",
        )

    def abort(self, reason: str) -> None:
        """Close an unfinished file as an incomplete run, and state the reason."""
        if self._finished:
            return
        report = self._judged(self.run(complete=False), 0.0) if len(self.samples) else None
        with unbroken():
            self._writer.abort(reason, self._summary(report))

    def _summary(self, report: QualityReport | None) -> RunSummary:
        return RunSummary(
            release_tick=self.release_tick,
            lost=self.lost,
            clock=self._clock,
            gate=report.sentence if report is not None else "",
            gate_figures={f"{c.name} ({c.unit})": c.measured for c in report.checks} if report is not None else {},
            pose_measured=self.pose_measured,
            notes=self._arm_notes(),
        )

    def _message(self, host_ns: int, message: Message) -> None:
        if isinstance(message, Event):
            if message.kind is EventKind.RELEASED and not self._take_release(message.tick):
                return
            self._writer.event(host_ns, message.kind.name, message.tick, str(message.detail))
        elif isinstance(message, Status):
            if self.release_tick is not None:
                self._statuses += 1
                self._latched += message.latched
            state = {"state": message.state.name, "latched": message.latched, "fault": message.fault.name}
            counters = {"overruns": message.overruns, "dropped": message.dropped, "sent": message.sent}
            self._writer.status(host_ns, state | counters)

    def _take_release(self, tick: int, within_s: float = 60.0) -> bool:
        """Accept the tick of the release, and return whether it is new and valid.

        The device repeats the tick. A tick more than `within_s` after the newest sample was damaged by the link.

        Raises:
            DeviceFault: the tick is before RELEASE was sent, so the device does not know when the rods were released.
        """
        if self.release_tick is not None or tick - max(self._newest_tick, 0) > within_s * self.rate_hz:
            return False
        if self._earliest_release is None or tick < self._earliest_release:
            newest = max(self._newest_tick, 0)
            raise DeviceFault(
                f"the device reports a release at tick {tick}, but RELEASE was sent after its tick"
                f" {newest}, so the instant of the release is unknown: check its firmware and record again"
            )
        self.release_tick = tick
        self._end_tick = tick + round(self._duration * self.rate_hz)
        return True

    def _host_ns(self, host_time: float) -> int:
        return max(0, round((host_time + self._to_epoch) * 1e9))  # the file cannot contain a time before 1970

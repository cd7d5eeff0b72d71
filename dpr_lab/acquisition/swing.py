"""Recording of a swing: release, record, stop the device, and check."""

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dpr_lab.acquisition.batch import Batch
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.gate import QualityReport
from dpr_lab.acquisition.holding import RestWindow, raise_faults
from dpr_lab.acquisition.live_speed import LiveSpeed
from dpr_lab.acquisition.recording import Recording
from dpr_lab.acquisition.rest import RodAngles, RodPair, at_rest
from dpr_lab.acquisition.settings import CaptureSettings
from dpr_lab.arrays import Array
from dpr_lab.errors import DeviceFault, DeviceLost, DprError, LeaseLost, LinkError, LinkTimeout, RunError
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.writer import RunWriter
from firmware_protocol.messages import State, Status

STOPPED = "stopped by the operator"


@dataclass(frozen=True, slots=True)
class Released:
    """Event: the latch opened, and samples are written to `file`."""

    tick: int
    file: Path


@dataclass(frozen=True, slots=True)
class SwingReading:
    """Progress of a recording."""

    t: float
    """Time since the release, s."""
    theta: RodAngles
    """Newest absolute angles, rad."""
    omega: RodPair
    """Newest speeds of inner and outer rod from a Kalman filter, rad/s."""
    samples: int
    fresh: tuple[Array, Array]
    """Times since the release (n,), s, and absolute angles (n, 3), rad, of the samples since the last report."""
    inputs: Array | None = None
    """(n,) input of the arm's drive at these samples, in the unit of the rig file; None without a drive."""


@dataclass(frozen=True, slots=True)
class Captured:
    """A finished capture."""

    run_file: Path
    quality: QualityReport
    release_tick: int
    duration: float
    """Time from the release to the last sample, s."""
    lost: Mapping[str, int]
    """Number of samples lost, by cause (`dpr_lab.run.LOSS_CAUSES`)."""
    pose_measured: RodAngles | None
    """Absolute angles just before the release, rad."""


@dataclass(frozen=True, slots=True)
class SwingRecorder:
    """Recorder of one swing, for a given duration or until rest; it also reports the progress."""

    device: Device
    longest: float
    """Duration of the recording after the release, s; with `until_rest` the maximum duration."""
    until_rest: bool
    """Whether the recording ends when both rods have come to rest."""
    speed: LiveSpeed
    """Filter for the reported speeds."""
    on_progress: Callable[[Released | SwingReading], None]
    settings: CaptureSettings

    def record(self, path: Path, metadata: RunMetadata, rest: RestWindow, hanging: RodPair | None) -> Captured:
        """Release the rods, which must be at rest, and record their swing.

        Args:
            path: file of the run
            metadata: metadata of the run
            rest: samples of the held rods before the release
            hanging: deviation of the hanging rods from the vertical before they were raised, rad

        Raises:
            LinkError, DeviceLost, RunError: as for `dpr_lab.acquisition.capture.capture`; the message names the file.
            KeyboardInterrupt: re-raised with the name of the file, which is finished as incomplete.
        """
        with (
            RunWriter(path, metadata) as writer,
            Recording(writer, rest.lost_before, self.longest, hanging, self.settings.limits) as recording,
        ):
            try:
                recording.add(rest.batches)
                recording.expect_release()
                _release(self.device)
                self._await_release(recording)
                self.on_progress(Released(recording.release_tick or 0, path))
                self._follow(recording)
                notes = self._stop(recording)
                report = recording.finish(self.device.clock(), (*self._notes(recording), *notes))
            except BaseException as error:
                recording.count_losses(self.device.losses)
                with suppress(RunError):
                    recording.note_clock(*self.device.clock())
                    recording.abort(_reason(error))
                data_kept = f"the data recorded so far are kept in {path}"
                if isinstance(error, KeyboardInterrupt):
                    raise KeyboardInterrupt("; ".join(filter(None, (STOPPED, str(error), data_kept)))) from error
                if isinstance(error, DprError) and not isinstance(error, RunError):  # a RunError already names the file
                    raise type(error)(f"{error}; {data_kept}") from error
                raise
            tick, measured = recording.release_tick or 0, recording.pose_measured
            return Captured(path, report, tick, recording.t, recording.lost, measured)

    def _take(self, recording: Recording) -> list[Batch]:
        batches = self.device.poll(self.settings.poll_s)
        recording.add(batches)
        raise_faults(self.device.url, batches)
        return batches

    def _await_release(self, recording: Recording) -> None:
        deadline = time.monotonic() + self.settings.release_timeout_s
        while recording.release_tick is None:
            if time.monotonic() > deadline:
                raise LinkError(
                    f"{self.device.url}: the device opened the latch, but the message with the instant was lost: record"
                    " again"
                )
            self._take(recording)

    def _follow(self, recording: Recording) -> None:
        """Record for the requested duration, or until the rods have come to rest."""
        device, settings = self.device, self.settings
        next_look = heard_at = time.monotonic()
        pace = _Pace(device, recording, settings)
        reported = 0
        while not recording.full:
            batches = self._take(recording)
            now = time.monotonic()
            if any(batch.rows for batch in batches):
                heard_at = now
            elif now - heard_at > (longest := settings.silences_without_samples * device.silence_s):
                raise DeviceLost(
                    f"{device.url}: the device sends status messages, but sent no samples for {longest:g} s"
                )
            pace.check(now)
            if now < next_look:
                continue
            next_look = now + settings.report_s
            if recording.clock_due:
                recording.note_clock(*device.clock())
            still_s = settings.rest_after_s
            t, theta = recording.tail(still_s)
            theta0, theta1, theta2 = theta[-1].tolist()
            fresh, inputs = recording.since(reported), recording.new_inputs()
            omega, reported = self.speed.after(*fresh), len(recording.samples)
            self.on_progress(SwingReading(recording.t, (theta0, theta1, theta2), omega, reported, fresh, inputs))
            if self.until_rest and recording.t >= still_s and at_rest(t, theta, recording.rig, settings.limits.rest):
                recording.end_here()

    def _notes(self, recording: Recording) -> tuple[str, ...]:
        last = recording.tail(self.settings.rest_after_s)
        if not self.until_rest or at_rest(*last, recording.rig, self.settings.limits.rest):
            return ()
        return (
            f"the rods were still moving at the end of the recording, {recording.t:g} s after the release:"
            f" their hanging position at rest was not checked",
        )

    def _stop(self, recording: Recording) -> tuple[str, ...]:
        """Stop the stream; read the remaining samples and the status with the final counts.

        The recording is complete, so it is kept if the device does not answer, is lost or reports a fault: the result
        is then a note.

        Raises:
            LinkError: the samples are not reliable, because their ticks decreased or two devices answered.
        """
        notes: tuple[str, ...] = ()
        try:
            self.device.stop()
            deadline = time.monotonic() + self.settings.last_status_s
            counted = False
            while not counted and time.monotonic() < deadline:
                messages = [message for batch in self._take(recording) for message in batch.messages]
                counted = any(isinstance(message, Status) and message.state is State.IDLE for message in messages)
        except (LinkTimeout, DeviceLost, LeaseLost, DeviceFault) as error:
            notes = (f"the recording is complete, but {self._stop_again(error)}{error}",)
        recording.count_losses(self.device.losses)
        return notes

    def _stop_again(self, error: DprError) -> str:
        """Repeat an unanswered STOP; return a warning if it is not answered either."""
        if isinstance(error, LinkTimeout):  # a lost device stops by itself, because it receives no keepalives
            try:
                self.device.stop()
            except DprError:
                return "the device may still be sampling: "
        return ""


def _release(device: Device) -> None:
    warning = "RELEASE was sent, so the rods may be free: keep clear until you have checked them"
    try:
        device.release()
    except LinkError as error:
        raise type(error)(f"{error}; {warning}") from error
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(warning) from error


class _Pace:
    """Monitor of the rate at which samples arrive.

    It raises an exception if far too few samples arrive, because the recording would then take too long.
    """

    def __init__(self, device: Device, recording: Recording, settings: CaptureSettings) -> None:
        patience = device.silence_s / device.timing.silence_s
        self._window_s, self._slowest = settings.pace_window_s * patience, settings.slowest_pace / patience
        self._recording, self._url = recording, device.url
        self._at, self._t = time.monotonic(), recording.t

    def check(self, now: float) -> None:
        """Check the rate at the host time `now`.

        Raises:
            DeviceLost: the device is far too slow.
        """
        elapsed_s, received_s = now - self._at, self._recording.t - self._t
        if elapsed_s < self._window_s:
            return
        if received_s < self._slowest * elapsed_s:
            raise DeviceLost(
                f"{self._url}: in {elapsed_s:.0f} s only {received_s:.2g} s of samples arrived: the device does not"
                f" sample at {self._recording.rate_hz:g} Hz; check its sample timer"
            )
        self._at, self._t = now, self._recording.t


def _reason(error: BaseException) -> str:
    """Return the reason why a recording ended early.

    If the error is not a `DprError`, its type is included.
    """
    if isinstance(error, KeyboardInterrupt):
        return STOPPED
    return str(error) if isinstance(error, DprError) else f"{type(error).__name__}: {error}"

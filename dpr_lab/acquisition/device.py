"""Device driver: it sends typed commands, receives samples and messages, and counts losses by cause.

A reader thread reads the link in blocks, adds the host time to each block, and sends the keepalives. A slow disk or a
busy screen can therefore neither lose a byte nor stop a stream. All other work is done in the caller's thread, in
`poll` and in the commands.
"""

import threading
import time
from collections import deque
from collections.abc import Sequence

from dpr_lab.acquisition.batch import AnyRow, Batch, Counter
from dpr_lab.acquisition.device_errors import no_answer, translated
from dpr_lab.acquisition.interrupts import unbroken
from dpr_lab.acquisition.ping_clock import PingClock
from dpr_lab.acquisition.settings import DEVICE_TIMING, DeviceTiming
from dpr_lab.errors import DeviceFault, DeviceLost, LinkError, LinkTimeout, SafetyStop
from dpr_lab.transports.software_link import leads_to_software
from dpr_lab.transports.transport import Received, Transport
from firmware_protocol.clock import ClockFit
from firmware_protocol.errors import DevicesCollide, RemoteProtocolError
from firmware_protocol.host_role import HostSession
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    DEVICE_NODE,
    NUMBERS,
    Ack,
    ArmInput,
    Command,
    Frame,
    Hello,
    Hold,
    Message,
    Pong,
    Release,
    Sample,
    Status,
    Stop,
    Stream,
    Torque,
    encode,
)
from firmware_protocol.stream import Row, SampleStream, blind_ticks
from firmware_protocol.torques import TorquePairs

_STREAM, _STOP = NUMBERS[Stream], NUMBERS[Stop]


class Device:
    """Device on an open transport; a context manager that closes the transport.

    Commands and `poll` belong to one thread. Every method can raise DeviceLost after the link is lost or the device has
    stopped sending. A command raises DeviceFault if the device refuses it, LinkTimeout if the device does not answer,
    and SafetyStop if the device was opened read-only.

    Args:
        transport: the open link
        node: node of the device
        read_only: whether only handshake and PING are sent, but no commands and no keepalives
        timing: timing of the connection
    """

    def __init__(
        self,
        transport: Transport,
        node: int = DEVICE_NODE,
        *,
        read_only: bool = False,
        timing: DeviceTiming = DEVICE_TIMING,
    ) -> None:
        self._transport = transport
        self._read_only, self.timing = read_only, timing
        self._software = leads_to_software(transport.url)
        self._session = HostSession(node)
        self._stream = SampleStream()
        self._torques: TorquePairs | None = None
        self._rate_hz = 0
        self._batches: deque[Batch] = deque()
        self._lost_before: dict[str, int] = {}
        """Losses up to the newest batch, by cause."""
        self._bytes = self._frames = self._invalid_frames = 0
        self._held: Row | None = None
        """The newest sample, delayed until the next sample arrives; discarded if the next sample contradicts it."""
        self._overruns, self._dropped = Counter(), Counter()
        self.heard_at = time.monotonic()
        """Time of the last sample or status, `time.monotonic()`, s."""
        self._stream_token = -1  # a repeated ACK of STREAM has the same token
        self._clock = PingClock(timing, self.heard_at)
        self._failure: Exception | None = None
        self._closing = threading.Event()
        self._lock = threading.RLock()
        self._changed = threading.Condition(self._lock)
        self._reader = threading.Thread(target=self._read, name=f"reader of {transport.url}", daemon=True)
        self._reader.start()

    def __enter__(self) -> "Device":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """URL of the device."""
        return self._transport.url

    @property
    def info(self) -> DeviceInfo:
        """Description of the device from the handshake.

        Raises:
            ValueError: before `connect`.
        """
        if self._session.info is None:
            raise ValueError("connect first")
        return self._session.info

    @property
    def status(self) -> Status | None:
        """Last STATUS of the device, or None before the first STATUS."""
        return self._session.status

    @property
    def silence_s(self) -> float:
        """Time without a sample and a STATUS after which the device counts as lost, s."""
        patience = self.timing.simulated_patience if self.simulated_time else 1.0
        return self.timing.silence_s * patience

    def connect(self, timeout: float = 2.0) -> DeviceInfo:
        """Perform the handshake.

        The handshake is repeated until the device answers or `timeout` s have passed.

        Raises:
            LinkTimeout: the device does not answer; the message states whether any bytes arrived.
            MismatchError: the device uses another version of the protocol.
        """
        deadline = time.monotonic() + timeout
        while True:
            try:
                with unbroken(), self._lock:
                    self._raise_failure()
                    self._transport.send(self._session.hello(time.monotonic()))
                    self._await_outcome()
                return self.info
            except LinkTimeout as error:
                if time.monotonic() >= deadline:
                    invalid_bytes = 0 if self._frames else self._bytes
                    raise no_answer(self.url, timeout, self._transport.capacities, invalid_bytes) from error

    def check_rate(self, rate_hz: int) -> None:
        """Check a sample rate before anything moves.

        Raises:
            LinkError: the link is too slow for this rate; the message contains the calculation.
            DeviceFault: the device cannot sample at this rate.
        """
        for capacity in self._transport.capacities:
            capacity.with_frames(self.info.frames).check(rate_hz)
        if rate_hz > self.info.rate_max_hz:
            raise DeviceFault(f"{rate_hz} Hz is too fast for the device: choose at most {self.info.rate_max_hz} Hz")

    def hold(self, pose_number: int = 0) -> None:
        """Engage the latch, and show the number of the pose, from 1, on the device."""
        self._command(Hold(pose=pose_number))

    def stream(self, rate_hz: int) -> None:
        """Start sampling at tick 0.

        Raises:
            LinkError, DeviceFault: as for `check_rate`, or the device refuses the command.
        """
        self.check_rate(rate_hz)
        with self._lock:
            self._held, self._rate_hz = None, rate_hz
            kinds = self.info.torque_kinds or self.info.input_kinds
            self._torques = self._torques or (TorquePairs(kinds) if kinds else None)
            if self._torques is not None:
                self._torques.restart()
            self._stream.restart(blind_ticks(rate_hz, self.info.counts_per_rev))
        self._command(Stream(rate_hz=rate_hz))

    def release(self) -> None:
        """Open the latch; the device reports the tick of the opening in an EVENT."""
        self._command(Release())

    def stop(self) -> None:
        """Stop sampling; the state of the latch does not change."""
        self._clock.stop()
        try:
            self._command(Stop())
        finally:
            self._stream.stop()

    def poll(self, timeout: float) -> list[Batch]:
        """Return all messages since the last call.

        If there are none, wait at most `timeout` s. No message is discarded between calls, so call the method regularly
        while the device streams. Messages that arrived before the link was lost are returned first; the next call
        raises an exception.
        """
        with unbroken(), self._lock:
            self._changed.wait_for(lambda: self._batches or self._failure, timeout)
            batches = list(self._batches)
            self._batches.clear()
            if not batches:
                self._raise_failure()
        return batches

    @property
    def losses(self) -> dict[str, int]:
        """Number of samples and frames lost since the device was opened, by cause (`dpr_lab.run.LOSS_CAUSES`).

        `tick_gap` counts every missing tick, including ticks whose frames are counted as damaged.
        """
        with self._lock:
            errors = self._transport.errors
            return {
                "device_overrun": self._overruns.total + self._dropped.total,
                "crc": errors["crc"],
                "framing": errors["framing"] + self._invalid_frames,
                "contradicted": self._stream.contradicted,
                "contradicted_position": self._stream.contradicted_position,
                "tick_gap": self._stream.lost_tick_gap,
                **({"torque": self._torques.missing} if self._torques is not None else {}),
            }

    @property
    def simulated_time(self) -> bool:
        """Whether ticks may differ from real time.

        The device must declare simulated time, and its link must be inside this computer.
        """
        return self.info.simulated_time and self._software

    def clock(self) -> tuple[ClockFit | None, str]:
        """Return the clock fit of the last stream and an empty text.

        Before enough pings were answered, the result is None and the reason. For simulated time, it is None and an
        empty text.
        """
        if self.simulated_time:
            return None, ""
        with self._lock:
            return self._clock.fit(self._rate_hz)

    def close(self) -> None:
        """Close the link; repeated calls have no effect.

        A streaming device stops when its lease expires.
        """
        self._closing.set()
        self._reader.join()
        self._transport.close()

    def _command(self, command: Command) -> None:
        if self._read_only:
            raise SafetyStop(f"{self.url}: {type(command).__name__} was not sent, because this view is read-only")
        with unbroken(), self._lock:
            self._raise_failure()
            self._transport.send(self._session.command(command, time.monotonic()))
            self._await_outcome()

    def _await_outcome(self) -> None:
        while (outcome := self._session.outcome) is None:
            self._changed.wait()
            self._raise_failure()
        if outcome.error is not None:
            raise translated(self.url, outcome.error, self.status) from outcome.error

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _read(self) -> None:
        """Run the reader thread: convert received data to batches, and send keepalives and pings."""
        try:
            while not self._closing.is_set():
                received = self._transport.receive(self.timing.read_s)
                with self._lock:
                    self._take(received)
                    self._send_due(time.monotonic())
                    self._changed.notify_all()
        except Exception as error:  # every error must be reported to the caller, not only end the thread
            with self._lock:
                self._failure = error
                try:
                    self._append(Received(time.monotonic(), (), b""), self._last_rows(), [])
                finally:
                    self._changed.notify_all()

    def _take(self, received: Received) -> None:
        self._bytes += len(received.raw)
        self._frames += len(received.frames)
        rows: list[AnyRow] = []
        messages: list[Message] = []
        try:
            for frame in received.frames:
                self._take_frame(frame, received.host_time, rows, messages)
        finally:  # an error must not discard the data before it
            self._append(received, rows, messages)
        sampled = any(frame.number == NUMBERS[Sample] for frame in received.frames)
        self._check_silence(received.host_time, sampled or any(not isinstance(m, Pong) for m in messages))

    def _take_frame(self, frame: Frame, host_time: float, rows: list[AnyRow], messages: list[Message]) -> None:
        try:
            message = self._session.receive(frame)
        except DevicesCollide as error:
            raise LinkError(f"{self.url}: {error}") from error
        except RemoteProtocolError:
            self._invalid_frames += 1
            return
        if isinstance(message, Sample):
            rows += self._driven(self._trusted(message))
        elif isinstance(message, Torque | ArmInput):
            self._note_torque(message)
        elif message is not None:
            self._stream.feed(message)
            self._note(message, host_time)
            messages.append(message)
            if isinstance(message, Ack) and message.command == _STOP:
                rows += self._last_rows()

    def _append(self, received: Received, rows: Sequence[AnyRow], messages: Sequence[Message]) -> None:
        if received.raw or rows or messages:
            lost_before, self._lost_before = self._lost_before, self.losses
            self._batches.append(Batch(received.host_time, received.raw, tuple(rows), tuple(messages), lost_before))

    def _last_rows(self) -> list[AnyRow]:
        """Return the delayed samples at the end of a stream, with their torques if the device has drives."""
        rows = self._driven(self._hand_over(None))
        return [*rows, *(self._torques.rest() if self._torques is not None else [])]

    def _trusted(self, sample: Sample) -> list[Row]:
        """Return the previous sample as a list, unless `sample` has the same tick and contradicts it."""
        if self._held is not None and self._stream.contradicts(self._held, sample):
            self._held = None
        row = self._stream.feed(sample)
        if self._stream.went_back:
            raise LinkError(
                f"{self.url}: the ticks of the device decreased during the stream, so the times of its"
                f" samples are unknown: restart the device and record again"
            )
        return self._hand_over(row) if row is not None else []

    def _hand_over(self, newest: Row | None) -> list[Row]:
        before, self._held = self._held, newest
        return [before] if before is not None else []

    def _driven(self, rows: list[Row]) -> Sequence[AnyRow]:
        """Return the samples with their torques, for a device with drives.

        Samples are delayed until their torques arrive.
        """
        return rows if self._torques is None else self._torques.take(rows)

    def _note_torque(self, torque: Torque | ArmInput) -> None:
        info, of_arm = self._session.info, isinstance(torque, ArmInput)
        if info is not None and not (info.input_kinds if of_arm else info.torque_kinds):
            raise LinkError(
                f"{self.url}: the device sends {'inputs of its arm' if of_arm else 'torques'}, but the INFO"
                " page that contains their unit was lost: connect again"
            )
        if self._torques is not None:
            self._torques.note(torque)

    def _check_silence(self, now: float, heard: bool) -> None:
        """Raise DeviceLost if the device has sent neither samples nor reports for too long.

        A device reports ten times per second. A device that was restarted only answers pings.
        """
        if heard or self._session.info is None:
            self.heard_at = now
            return
        if now - self.heard_at > self.silence_s:
            raise DeviceLost(
                f"{self.url}: neither sample nor status for {self.silence_s:g} s: check cable and power; the device"
                " may have restarted"
            )

    def _note(self, message: Message, host_time: float) -> None:
        if isinstance(message, Status):
            self._overruns.read(message.overruns)
            self._dropped.read(message.dropped)
        elif isinstance(message, Pong):
            self._clock.note(message, host_time)
        elif isinstance(message, Ack) and message.command == _STREAM and message.token != self._stream_token:
            self._stream_token = message.token
            self._overruns.restart()
            self._dropped.restart()
            self._clock.restart(host_time)

    def _send_due(self, now: float) -> None:
        for frame in self._session.due(now):
            if not self._read_only or frame.number == NUMBERS[Hello]:
                self._transport.send(frame)
        if self._session.info is not None and (ping := self._clock.due(now)) is not None:
            self._transport.send(encode(ping, self._session.node))

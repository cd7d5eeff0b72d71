"""Conformance test of a device: exchanges of `traces.json`, and a timing test.

The test opens and closes the latch many times, so the rods must be removed.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import accumulate, pairwise
from typing import Any

from dpr_lab.errors import DprError, LinkTimeout
from dpr_lab.transports.transport import Transport
from firmware_protocol.errors import RemoteProtocolError
from firmware_protocol.identity import ARM_PAGE, PAGES
from firmware_protocol.messages import (
    DEVICE_NODE,
    MESSAGES,
    ArmInput,
    ClearFault,
    Event,
    EventKind,
    Fault,
    Frame,
    Hello,
    Hold,
    Info,
    KeepAlive,
    Message,
    Ping,
    Pong,
    Position,
    Release,
    Sample,
    State,
    Status,
    Stop,
    Stream,
    Torque,
    decode,
    encode,
)

Step = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ConformanceSettings:
    """Time limits of a conformance test."""

    answer_s: float = 0.1
    """Time without an answer after which the host repeats a command, s."""
    patience_s: float = 5.0
    """Maximum waiting time for a message that the device must send, s."""
    timing_s: float = 2.0
    """Duration of the timing test, s."""
    rate_hz: int = 500
    """Sample rate of the timing test, Hz. Every link supports it."""
    rate_off: float = 0.01
    """Maximum relative error of the sample rate by the host's clock."""
    reports_hz: tuple[float, float] = (7.0, 13.0)
    """Minimum and maximum rate of STATUS messages, Hz; the nominal rate is 10 Hz."""


@dataclass(frozen=True, slots=True)
class Conformity:
    """Result of one exchange, or of the timing, in a conformance test."""

    what: str
    ok: bool
    message: str
    """Description of the fault, or of the measured value."""


DRIVES = {"joints": PAGES, "arm": ARM_PAGE}
"""For each kind of drives in a trace: the INFO page that only devices with such drives send."""

MARK = 0xBA00
"""First token of the pings that follow a command. A device processes messages in order, so the answers to the pings
mark the end of the command."""


def conformity(link: Transport, settings: ConformanceSettings = ConformanceSettings()) -> Iterator[Conformity]:
    """Test a device against the protocol.

    Every exchange that the port of the device permits is run, and the timing is measured.

    Args:
        link: open link to the device, on which no rods are mounted
        settings: time limits

    Raises:
        LinkTimeout: the device does not answer.
    """
    peer = _Peer(link, settings)
    pages = [page for page in peer.ask(Hello(token=1)) if isinstance(page, Info)]
    simulated_time = any(page.fields.get("simulated_time") for page in pages)
    peer.drives = {name for name, number in DRIVES.items() if any(page.page == number for page in pages)}
    traces = json.loads(files("firmware_protocol").joinpath("traces.json").read_text(encoding="utf-8"))
    for trace in traces["traces"]:
        steps: Sequence[Step] = trace["steps"]
        if any("fault" in step for step in steps) or steps[0].get("send", [""])[0] != "HELLO":
            continue  # this exchange requires an intervention in the hardware
        if simulated_time and any("silent_s" in step for step in steps):
            continue  # the simulated clock stops while nothing is sent
        if trace.get("drives", "") not in {"", *peer.drives}:
            continue
        peer.topic = trace.get("drives", "")
        peer.to_idle()
        wrong = next((error for n, step in enumerate(steps, 1) if (error := _step(peer, step, f"step {n}"))), "")
        yield Conformity(trace["why"], not wrong, wrong or f"{len(steps)} steps")
    peer.to_idle()
    yield from _timing(peer, settings, simulated_time)
    peer.to_idle()


class _Peer:
    """Host side of an exchange, without automatic keepalives and repetitions of commands."""

    def __init__(self, link: Transport, settings: ConformanceSettings) -> None:
        self.link, self.settings = link, settings
        self.invalid_frames = 0
        self.drives: set[str] = set()
        """Kinds of drives in `DRIVES` that the device has."""
        self.topic: str | None = None
        """Kind of drives in the current trace, empty for none; None before the first trace."""
        self._mark = 0
        self._released: Event | None = None
        self._heard: list[Message] = []

    def to_idle(self) -> None:
        """Start a new session, and bring the device to the state IDLE from any other state."""
        self._released = None
        self.ask(Hello(token=200))
        for command in (Stop(token=201), ClearFault(token=202), Hold(token=203), Stream(token=204)):
            self.ask(command)
        self.ask(Release(token=205))
        self.ask(Stop(token=206))
        self._released = None

    def ask(self, message: Message) -> list[Message]:
        """Send a message and return the answers."""
        return self.send(encode(message))

    def send(self, frame: Frame) -> list[Message]:
        """Send a frame and return the answers."""
        self.link.send(frame)
        return self.answers()

    def wait_silently(self, seconds: float) -> list[Message]:
        """Send nothing for some seconds, and return the messages that arrive."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.read()
        return self.answers()

    def answers(self) -> list[Message]:
        """Return the messages received since the last call, except reports, samples and repeated releases."""
        self._mark = self._mark % 255 + 1
        mark = Ping(MARK + self._mark)
        self._await(lambda: any(isinstance(m, Pong) and m.token == mark.token for m in self._heard), mark)
        messages, self._heard = self._heard, []
        return [message for message in messages if self._is_answer(message)]

    def status(self) -> Status:
        """Return the next STATUS message."""
        self._heard.clear()
        self._await(lambda: any(isinstance(message, Status) for message in self._heard), KeepAlive())
        return next(message for message in self._heard if isinstance(message, Status))

    def read(self) -> list[Message]:
        """Return the messages that the device sends within 0.02 s; frames that cannot be decoded are counted."""
        fresh: list[Message] = []
        for frame in self.link.receive(0.02).frames:
            try:
                fresh += [decode(frame)] if frame.node == DEVICE_NODE else []
            except RemoteProtocolError:
                self.invalid_frames += 1
        self._heard += fresh
        return fresh

    def _await(self, done: Callable[[], bool], again: Message) -> None:
        deadline, next_at = time.monotonic() + self.settings.patience_s, 0.0
        while not done():
            now = time.monotonic()
            if now > deadline:
                raise LinkTimeout(
                    f"{self.link.url}: no answer to {type(again).__name__} for {self.settings.patience_s:g} s"
                )
            if now >= next_at:
                self.link.send(encode(again))
                next_at = now + self.settings.answer_s
            self.read()

    def _is_answer(self, message: Message) -> bool:
        if isinstance(message, Sample | Torque | ArmInput | Position | Status):
            return False
        if isinstance(message, Info) and message.page in DRIVES.values():
            return self.topic is None or message.page == DRIVES.get(self.topic)
        if isinstance(message, Pong):
            return message.token & 0xFF00 != MARK
        if isinstance(message, Event) and message.kind is EventKind.RELEASED:
            before, self._released = self._released, message
            return message != before
        return True


def _step(peer: _Peer, step: Step, where: str) -> str:
    """Run a step of a trace, and describe how the device deviates from the step.

    The text is empty if the device does not deviate.
    """
    if "silent_s" in step:
        request, answers = f"{step['silent_s']} s of silence", peer.wait_silently(step["silent_s"])
    elif "frame" in step:
        identifier, payload = step["frame"]
        request, answers = f"frame {identifier:#x} {payload}", peer.send(Frame(identifier, bytes.fromhex(payload)))
    else:
        name, fields = step["send"]
        request, answers = name, peer.ask(MESSAGES[name](**fields))
    expected = [(MESSAGES[name], fields) for name, fields in step["answers"]]
    if [type(answer) for answer in answers] != [kind for kind, _ in expected]:
        required = ", ".join(name for name, _ in step["answers"]) or "nothing"
        return f"{where}, {request}: answered {_names(answers)}, not {required}"
    for answer, (_, fields) in zip(answers, expected, strict=True):
        values = {name: getattr(answer, name) for name in fields}
        if values != fields:
            return f"{where}, {request}: the device answered {answer}, but the required values are {fields}"
    if "then" in step:
        state, latched, fault = step["then"]
        status = peer.status()
        if (status.state, status.latched, status.fault) != (State[state], latched, Fault[fault]):
            reported = f"{status.state.name}, latched {status.latched}, fault {status.fault.name}"
            required = f"{state}, latched {latched}, fault {fault}"
            return f"{where}, after {request}: the device reports {reported}, but {required} is required"
    return ""


def _names(messages: Sequence[Message]) -> str:
    return ", ".join(type(message).__name__.upper() for message in messages) or "nothing"


def _timing(peer: _Peer, settings: ConformanceSettings, simulated_time: bool) -> Iterator[Conformity]:
    """Measure the rates of samples and STATUS messages by the host's clock; yield the results."""
    peer.ask(Hello(token=1))
    peer.ask(Hold(token=2))
    peer.ask(Stream(token=3, rate_hz=settings.rate_hz))
    began = time.monotonic()
    keep_at, arrived, torques, reports = began, list[tuple[float, int]](), list[int](), 0
    while (now := time.monotonic()) < began + settings.timing_s:
        if now >= keep_at:
            peer.link.send(encode(KeepAlive()))
            keep_at = now + settings.answer_s
        fresh = peer.read()
        now = time.monotonic()
        arrived += [(now, message.tick) for message in fresh if isinstance(message, Sample)]
        torques += [message.tick for message in fresh if isinstance(message, Torque | ArmInput)]
        reports += sum(isinstance(message, Status) for message in fresh)
    if len(arrived) < 2:
        yield Conformity("samples arrive", False, f"{len(arrived)} in {settings.timing_s:g} s")
        return
    steps = [(b - a) & 0xFFFF for (_, a), (_, b) in pairwise(arrived)]
    missing = sum(step != 1 for step in steps)
    yield Conformity(
        "every tick has a sample", not missing, f"{len(arrived)} samples, {missing} tick steps other than 1"
    )
    if peer.drives:
        # torques of the last samples may still be pending
        without = len({tick for _, tick in arrived[:-1]} - set(torques))
        yield Conformity(
            "every sample has its torques",
            not without,
            f"{len(torques)} torque messages, missing for {without} samples",
        )
    if not simulated_time:
        rate = sample_rate(arrived, settings.rate_hz)
        relative_error = abs(rate / settings.rate_hz - 1)
        yield Conformity(
            "the sample rate is correct",
            relative_error < settings.rate_off,
            f"{rate:.1f} Hz, requested {settings.rate_hz} Hz",
        )
        low, high = settings.reports_hz
        hz = reports / settings.timing_s
        yield Conformity("STATUS is sent ten times per second", low <= hz <= high, f"{hz:.1f} Hz")
    yield Conformity("every frame is valid", not peer.invalid_frames, f"{peer.invalid_frames} invalid")


def sample_rate(arrived: Sequence[tuple[float, int]], nominal_hz: float) -> float:
    """Return the sample rate by the host's clock, Hz.

    The rate follows from the least delayed samples of the first and the last third. A sample can arrive late, because
    host or device is busy, but never early.

    Args:
        arrived: host time, s, and 16-bit tick of each sample, at least 2
        nominal_hz: requested rate, Hz
    """
    ticks = [0, *accumulate((b - a) & 0xFFFF for (_, a), (_, b) in pairwise(arrived))]
    samples = [(instant, tick) for (instant, _), tick in zip(arrived, ticks, strict=True)]
    third = max(len(samples) // 3, 1)
    first, last = (
        min(part, key=lambda sample: sample[0] - sample[1] / nominal_hz) for part in (samples[:third], samples[-third:])
    )
    return (last[1] - first[1]) / (last[0] - first[0])


def refuse_with_rods(rods_are_off: bool) -> None:
    """Refuse the test unless the operator confirmed that no rods are mounted.

    Raises:
        DprError: the operator did not confirm that no rods are mounted.
    """
    if not rods_are_off:
        raise DprError(
            "this test opens and closes the latch repeatedly without checking the rods: remove the rods,"
            " then confirm with --rods-off"
        )

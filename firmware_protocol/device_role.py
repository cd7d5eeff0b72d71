"""Device side of the protocol, independent of hardware."""

from collections.abc import Sequence
from dataclasses import dataclass

from firmware_protocol.errors import RemoteProtocolError
from firmware_protocol.identity import DeviceInfo, info_pages
from firmware_protocol.messages import (
    DEVICE_NODE,
    FIRST_HOST_NUMBER,
    NUMBERS,
    Ack,
    ArmInput,
    ClearFault,
    Command,
    Event,
    EventKind,
    Fault,
    Frame,
    Hello,
    Hold,
    KeepAlive,
    Message,
    Nak,
    NakCode,
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
    TorqueKind,
    decode,
    encode,
)
from firmware_protocol.session import LATCHED, LEASE_S, STREAMS, TRANSITIONS, Trigger

REMEMBERED = 16
"""Number of answers that are stored for repetition. A host has only one pending command, so older answers are not
needed."""

Task = Hold | Release | Stream | Stop | ClearFault | Ping
"""Task that the owner of a `DeviceSession` must execute: the command itself."""

_TRIGGERS: dict[type[Command], Trigger] = {
    Hold: Trigger.HOLD,
    Release: Trigger.RELEASE,
    Stream: Trigger.STREAM,
    Stop: Trigger.STOP,
}


@dataclass(frozen=True, slots=True)
class Answer:
    """Frames to send, and at most one task for the owner."""

    frames: tuple[Frame, ...] = ()
    task: Task | None = None


class DeviceSession:
    """Rules of the protocol for a device, independent of hardware.

    The owner passes received frames with their times, sends the returned frames, then executes the task: `Hold`: engage
    the latch; `Stream`: restart the tick at 0 and sample (send three `positions` first); `Release`: open the latch and
    send `released(tick)`; `Stop`: stop sampling; `ClearFault`: retry; `Ping`: send `pong`. It calls `check_lease`
    regularly and, once `greeted`, sends a `report` ten times per second. Times are in seconds of any monotonic clock.
    Ticks and positions may have any size.
    """

    def __init__(self, identity: DeviceInfo, node: int = DEVICE_NODE):
        self.identity = identity
        self.node = node
        self.state = State.IDLE
        self.latched = False
        self.fault_code = Fault.NONE
        self.greeted = False
        self._heard_at = 0.0
        self._release_tick = 0
        self._answers: dict[tuple[int, int], Frame] = {}

    @property
    def streams(self) -> bool:
        """Whether samples should be sent."""
        return self.state in STREAMS

    def receive(self, frame: Frame, now: float) -> Answer:
        """Process a frame from the link.

        Damaged frames and frames for other nodes are ignored.

        Args:
            frame: the received frame
            now: time of its arrival, s
        """
        if frame.node != self.node or frame.number < FIRST_HOST_NUMBER:
            return Answer()
        try:
            message = decode(frame)
        except RemoteProtocolError:
            return self._refuse_undecodable(frame)
        self._heard_at = now
        if isinstance(message, Ping):
            return Answer(task=message)
        if isinstance(message, KeepAlive):
            return Answer()
        return self._answer_once(message)

    def check_lease(self, now: float, tick: int) -> Answer:
        """Stop streaming if the host has been silent for `LEASE_S`; the state of the latch does not change."""
        if now - self._heard_at < LEASE_S or not self._move(Trigger.LEASE_LOST):
            return Answer()
        return Answer((self.event(EventKind.LEASE_LOST, tick),), Stop())

    def fault(self, fault: Fault, tick: int) -> Answer:
        """Stop because of a fault that the owner detected; the state of the latch does not change."""
        if fault is Fault.NONE:
            raise ValueError("Fault.NONE is no fault; CLEAR_FAULT is for the host to send")
        self.fault_code = fault
        self._move(Trigger.FAULT)
        return Answer((self.event(EventKind.FAULT, tick, fault),), Stop())

    def event(self, kind: EventKind, tick: int, detail: int = 0) -> Frame:
        """Create an EVENT at a tick."""
        return self._frame(Event(kind, detail, tick & 0xFFFFFFFF))

    def released(self, tick: int) -> Frame:
        """Create the EVENT for the opening of the latch at a tick.

        Every `report` repeats it while the device is RELEASED.
        """
        self._release_tick = tick
        return self.event(EventKind.RELEASED, tick)

    def sample(self, tick: int, positions: Sequence[int]) -> Frame:
        """Create the SAMPLE with the low 16 bits of the tick and of the three counters."""
        arm, inner, outer = positions
        return self._frame(Sample(tick & 0xFFFF, arm & 0xFFFF, inner & 0xFFFF, outer & 0xFFFF))

    def torque(self, kind: TorqueKind, tick: int, torques: Sequence[int]) -> Frame:
        """Create the TORQUE of joints 1 and 2 at the tick of a sample.

        The values are in the unit of the identity, and limited to the range of the message.
        """
        first, second = (min(max(torque, -0x8000), 0x7FFF) for torque in torques)
        return self._frame(Torque(kind, tick & 0xFFFF, first, second))

    def arm_input(self, kind: TorqueKind, tick: int, value: int) -> Frame:
        """Create the ARM_INPUT at the tick of a sample.

        The value is in the unit of the identity, and limited to the range of the message.
        """
        return self._frame(ArmInput(kind, tick & 0xFFFF, min(max(value, -(1 << 31)), (1 << 31) - 1)))

    def positions(self, tick: int, positions: Sequence[int]) -> tuple[Frame, ...]:
        """Create three POSITION frames with the complete counters at a tick, counts."""
        return tuple(
            self._frame(Position(joint, tick & 0xFFFF, (position + (1 << 31)) % (1 << 32) - (1 << 31)))
            for joint, position in enumerate(positions)
        )

    def status(self, overruns: int, dropped: int, sent: int) -> Frame:
        """Create the STATUS with the numbers of samples since STREAM."""
        counters = (overruns & 0xFFFF, dropped & 0xFFFF, sent & 0xFFFF)
        return self._frame(Status(self.state, self.fault_code, self.latched, *counters))

    def report(self, tick: int, positions: Sequence[int], overruns: int, dropped: int, sent: int) -> tuple[Frame, ...]:
        """Return the frames of the report that is sent ten times per second.

        The report repeats the EVENT of a release, so that the loss of one frame has no effect.
        """
        frames = (*self.positions(tick, positions), self.status(overruns, dropped, sent))
        return (*frames, self.released(self._release_tick)) if self.state is State.RELEASED else frames

    def pong(self, ping: Ping, tick: int, fraction: float) -> Frame:
        """Create the PONG for a PING that arrived a `fraction` (0 to 1) of a tick after `tick`."""
        return self._frame(Pong(ping.token, tick & 0xFFFFFFFF, min(int(fraction * 65536), 65535)))

    def _answer_once(self, message: Message) -> Answer:
        assert isinstance(message, Command)
        if isinstance(message, Hello):
            return self._greet(message)
        key = (NUMBERS[type(message)], message.token)
        if key in self._answers:
            return Answer((self._answers[key],))
        refusal = self._refusal(message)
        if not refusal:
            self._move(self._trigger(message))
        answer = self._answers[key] = self._verdict(message, refusal)
        if len(self._answers) > REMEMBERED:
            del self._answers[next(iter(self._answers))]
        return Answer((answer,), None if refusal else message)

    def _greet(self, hello: Hello) -> Answer:
        """Start a new session.

        Answers of the previous session are not repeated.
        """
        self._answers.clear()
        refusal = self._hello_refusal(hello)
        self.greeted = refusal is None
        return Answer((self._verdict(hello, refusal), *map(self._frame, info_pages(self.identity))))

    def _hello_refusal(self, hello: Hello) -> NakCode | None:
        ours = self.identity
        if hello.major != ours.major:
            return NakCode.VERSION
        if hello.minor == ours.minor and hello.schema_hash != ours.schema_hash:
            return NakCode.SCHEMA
        return None

    def _refusal(self, command: Hold | Release | Stream | Stop | ClearFault) -> NakCode | None:
        if not self.greeted:
            return NakCode.NOT_GREETED
        if (self.state, self._trigger(command)) not in TRANSITIONS:
            return NakCode.FAULTED if self.state is State.FAULT else NakCode.WRONG_STATE
        if isinstance(command, Stream) and command.rate_hz > self.identity.rate_max_hz:
            return NakCode.RATE_TOO_HIGH
        return None

    def _trigger(self, command: Command) -> Trigger:
        if isinstance(command, ClearFault):
            return Trigger.CLEAR_LATCHED if self.latched else Trigger.CLEAR_OPEN
        return _TRIGGERS[type(command)]

    def _move(self, trigger: Trigger) -> bool:
        target = TRANSITIONS.get((self.state, trigger))
        if target is None:
            return False
        self.state = target
        self.latched = LATCHED.get(target, self.latched)
        if target is not State.FAULT:
            self.fault_code = Fault.NONE
        return True

    def _refuse_undecodable(self, frame: Frame) -> Answer:
        if frame.number in (NUMBERS[KeepAlive], NUMBERS[Ping]):
            return Answer()
        known = frame.number in NUMBERS.values()
        code = NakCode.BAD_VALUE if known else NakCode.UNKNOWN_COMMAND
        return Answer((self._frame(Nak(frame.number, frame.data[0] if frame.data else 0, code)),))

    def _verdict(self, command: Command, refusal: NakCode | None) -> Frame:
        number = NUMBERS[type(command)]
        return self._frame(Nak(number, command.token, refusal) if refusal else Ack(number, command.token))

    def _frame(self, message: Message) -> Frame:
        return encode(message, self.node)

"""Messages of dpr.dbc as typed values, and their conversion to and from frames.

There is one dataclass per message, with the signals of dpr.dbc as fields in the same order. A frame is the same on both
links: an 11-bit identifier, node * 64 + number, and up to eight bytes.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

from cantools.database import EncodeError

from firmware_protocol.codec import Codec, paged_codec, plain_codec
from firmware_protocol.definition import DATABASE, PROTOCOL_VERSION, SCHEMA_HASH
from firmware_protocol.errors import LocalProtocolError, RemoteProtocolError

MAX_DATA = 8
"""Maximum data bytes of a frame, as in classic CAN."""
DEVICE_NODE = 1
"""Default node of a device."""
FIRST_HOST_NUMBER = 32
"""Number of the first message of the host. The messages of the device have lower numbers."""
# together the 11 bits of a CAN identifier
_NODE_BITS, _NUMBER_BITS = 5, 6
_NUMBER_MASK = (1 << _NUMBER_BITS) - 1

RELEASE_KEY = 0xD0B1
"""Key that a RELEASE must contain, so that a damaged identifier cannot turn another command into a release."""


class State(IntEnum):
    """State of a device."""

    IDLE = 0
    HOLDING = 1
    STREAMING = 2
    RELEASED = 3
    FAULT = 4


class Fault(IntEnum):
    """Reason why a device stopped."""

    NONE = 0
    ENCODER0 = 1
    ENCODER1 = 2
    ENCODER2 = 3
    LATCH = 4
    OVERRUN = 5
    INTERNAL = 6


class NakCode(IntEnum):
    """Reason why a device refused a command."""

    UNKNOWN_COMMAND = 1
    WRONG_STATE = 2
    BAD_VALUE = 3
    RATE_TOO_HIGH = 4
    VERSION = 5
    SCHEMA = 6
    NOT_GREETED = 7
    FAULTED = 8


class EventKind(IntEnum):
    """Kind of an EVENT."""

    RELEASED = 1
    INDEX = 2
    FAULT = 3
    LEASE_LOST = 4


class TorqueKind(IntEnum):
    """Kind of a TORQUE or an ARM_INPUT."""

    MEASURED = 1
    COMMANDED = 2


class ArmQuantity(IntEnum):
    """Quantity of the input of an arm's drive."""

    TORQUE = 1
    CURRENT = 2
    VOLTAGE = 3


@dataclass(frozen=True, slots=True)
class Event:
    """Event at a tick. `detail` is the joint of an INDEX, or the fault of a FAULT."""

    kind: EventKind
    detail: int
    tick: int


@dataclass(frozen=True, slots=True)
class Sample:
    """Readings of the encoders at one tick: low 16 bits of the tick and of each multi-turn counter."""

    tick: int
    position0: int
    position1: int
    position2: int


@dataclass(frozen=True, slots=True)
class Position:
    """Complete multi-turn counter of one joint, counts, with the low 16 bits of its tick."""

    joint: int
    tick: int
    position: int


@dataclass(frozen=True, slots=True)
class Status:
    """State of the device.

    The counters are the low 16 bits of numbers of samples since STREAM.
    """

    state: State
    fault: Fault
    latched: bool
    overruns: int
    dropped: int
    sent: int


@dataclass(frozen=True, slots=True)
class Pong:
    """Answer to a PING: device time at its arrival, tick + fraction / 65536."""

    token: int
    tick: int
    fraction: int


@dataclass(frozen=True, slots=True)
class Ack:
    """Acceptance of a command; `command` is the number of its message."""

    command: int
    token: int


@dataclass(frozen=True, slots=True)
class Nak:
    """Refusal of a command, which had no effect."""

    command: int
    token: int
    code: NakCode


@dataclass(frozen=True, slots=True)
class Info:
    """One page of the identity: its signals by name, or empty for an unknown page."""

    page: int
    fields: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Torque:
    """Torques of the joint drives at the tick of a SAMPLE, in the unit of INFO.

    `tick` is the low 16 bits of this tick.
    """

    kind: TorqueKind
    tick: int
    torque1: int
    torque2: int


@dataclass(frozen=True, slots=True)
class ArmInput:
    """Input of the arm's drive at the tick of a SAMPLE, in the unit of INFO.

    `tick` is the low 16 bits of this tick.
    """

    kind: TorqueKind
    tick: int
    input: int


@dataclass(frozen=True, slots=True)
class Hello:
    """Command to start a session."""

    token: int = 0
    major: int = PROTOCOL_VERSION[0]
    minor: int = PROTOCOL_VERSION[1]
    schema_hash: int = SCHEMA_HASH


@dataclass(frozen=True, slots=True)
class Hold:
    """Command to engage the latch.

    `pose` counts from 1 in the order of the rig file; 0 means none.
    """

    token: int = 0
    pose: int = 0


@dataclass(frozen=True, slots=True)
class Release:
    """Command to open the latch."""

    token: int = 0
    key: int = RELEASE_KEY


@dataclass(frozen=True, slots=True)
class Stream:
    """Command to sample at a given rate; the first sample has tick 0."""

    token: int = 0
    rate_hz: int = 1000


@dataclass(frozen=True, slots=True)
class Stop:
    """Command to end sampling; the latch does not open."""

    token: int = 0


@dataclass(frozen=True, slots=True)
class KeepAlive:
    """Message that confirms that the host is still active."""


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Command to leave the state FAULT; the latch does not change."""

    token: int = 0


@dataclass(frozen=True, slots=True)
class Ping:
    """Request for the device's time."""

    token: int


Command: TypeAlias = Hello | Hold | Release | Stream | Stop | ClearFault
"""Commands of the host that the device answers with ACK or NAK."""

Message: TypeAlias = (
    Event | Sample | Position | Status | Pong | Ack | Nak | Info | Torque | ArmInput | Command | KeepAlive | Ping
)

MESSAGES: dict[str, type[Message]] = {
    "EVENT": Event,
    "SAMPLE": Sample,
    "POSITION": Position,
    "STATUS": Status,
    "PONG": Pong,
    "ACK": Ack,
    "NAK": Nak,
    "INFO": Info,
    "TORQUE": Torque,
    "ARM_INPUT": ArmInput,
    "HELLO": Hello,
    "HOLD": Hold,
    "RELEASE": Release,
    "STREAM": Stream,
    "STOP": Stop,
    "KEEPALIVE": KeepAlive,
    "CLEAR_FAULT": ClearFault,
    "PING": Ping,
}
"""Class of every message, by its name in dpr.dbc."""

_CODECS: dict[type[Message], Codec] = {
    kind: (paged_codec if kind is Info else plain_codec)(kind, DATABASE.get_message_by_name(name))
    for name, kind in MESSAGES.items()
}
_CODEC_OF_NUMBER: dict[int, Codec] = {codec.number: codec for codec in _CODECS.values()}

NUMBERS: dict[type[Message], int] = {kind: codec.number for kind, codec in _CODECS.items()}
"""Number of every message, by its class: the low six bits of its identifier."""

NAMES: dict[int, str] = {NUMBERS[kind]: name for name, kind in MESSAGES.items()}
"""Name of every message, by its number."""


def frame_id(node: int, number: int) -> int:
    """Return the 11-bit identifier of a message to or from a node.

    Raises:
        ValueError: node beyond 5 bits or number beyond 6.
    """
    if not 0 <= node < 1 << _NODE_BITS or not 0 <= number < 1 << _NUMBER_BITS:
        raise ValueError(f"node {node} must be below {1 << _NODE_BITS} and number {number} below {1 << _NUMBER_BITS}")
    return node << _NUMBER_BITS | number


@dataclass(frozen=True, slots=True)
class Frame:
    """Frame of a link: an 11-bit identifier and at most eight bytes."""

    id: int
    data: bytes

    @property
    def node(self) -> int:
        """Node of the device that sends or receives the frame."""
        return self.id >> _NUMBER_BITS

    @property
    def number(self) -> int:
        """Message number."""
        return self.id & _NUMBER_MASK


def encode(message: Message, node: int = DEVICE_NODE) -> Frame:
    """Convert a message to or from a node to a frame.

    Raises:
        LocalProtocolError: a field is out of its range in dpr.dbc.
    """
    codec = _CODECS[type(message)]
    try:
        data = codec.pack(message)
    except (struct.error, ValueError, EncodeError) as error:
        raise LocalProtocolError(f"{message} does not match dpr.dbc: {error}") from error
    return Frame(node << _NUMBER_BITS | codec.number, data)


def decode(frame: Frame) -> Message:
    """Convert a frame from any node to a message.

    Raises:
        RemoteProtocolError: the number of the message or a value in it is not in dpr.dbc, or the frame has a wrong
            length.
    """
    codec = _CODEC_OF_NUMBER.get(frame.id & _NUMBER_MASK)
    if codec is None:
        raise RemoteProtocolError(f"message number {frame.number} is not in dpr.dbc")
    if len(frame.data) != codec.length:
        raise RemoteProtocolError(f"{NAMES[codec.number]} has {len(frame.data)} bytes, not {codec.length}")
    try:
        return codec.unpack(frame.data)
    except ValueError as error:
        raise RemoteProtocolError(f"{NAMES[codec.number]} {frame.data.hex()}: {error}") from error


_EXPLAINED: dict[type[NakCode | Fault | EventKind], tuple[str, str]] = {
    NakCode: ("NAK", "code"),
    Fault: ("STATUS", "fault"),
    EventKind: ("EVENT", "kind"),
}


def explain_fault(number: int) -> str:
    """Return meaning and remedy of the fault in an EVENT, also if dpr.dbc lacks it."""
    if number in tuple(Fault):
        return " ".join(explain(Fault(number)))
    return f"The device reports fault {number}, which is not in dpr.dbc. Read its documentation, then clear it."


def explain(code: NakCode | Fault | EventKind) -> tuple[str, str]:
    """Return the meaning of a code and its remedy: two sentences from dpr.dbc."""
    message, signal = _EXPLAINED[type(code)]
    comment = DATABASE.get_message_by_name(message).get_signal_by_name(signal).comment or ""
    lines = dict(line.split(": ", 1) for line in comment.splitlines())
    text, remedy = lines[code.name].split(". ", 1)
    return f"{text}.", remedy

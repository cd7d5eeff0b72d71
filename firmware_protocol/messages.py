"""The messages of dpr.dbc as typed values, and the frames that carry them.

One dataclass a message, with the signals of dpr.dbc as fields in the same order. A frame is what both links carry:
an 11-bit identifier, node * 64 + number, and up to eight bytes.
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
"""Bytes of data in a frame, as in one of classic CAN."""
DEVICE_NODE = 1
"""The node of a device that was given no other."""
FIRST_HOST_NUMBER = 32
"""Numbers below come from the device, numbers from here on from the host."""
# Together the 11 bits of a CAN identifier.
_NODE_BITS, _NUMBER_BITS = 5, 6
_NUMBER_MASK = (1 << _NUMBER_BITS) - 1

RELEASE_KEY = 0xD0B1
"""Must come with RELEASE, so that no damaged identifier turns another command into one."""


class State(IntEnum):
    """Where a device stands."""

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
    """Why a device refused a command."""

    UNKNOWN_COMMAND = 1
    WRONG_STATE = 2
    BAD_VALUE = 3
    RATE_TOO_HIGH = 4
    VERSION = 5
    SCHEMA = 6
    NOT_GREETED = 7
    FAULTED = 8


class EventKind(IntEnum):
    """What an EVENT tells."""

    RELEASED = 1
    INDEX = 2
    FAULT = 3
    LEASE_LOST = 4


class TorqueKind(IntEnum):
    """Which torques a TORQUE tells, and which input an ARM_INPUT."""

    MEASURED = 1
    COMMANDED = 2


class ArmQuantity(IntEnum):
    """What the input of an arm's drive is."""

    TORQUE = 1
    CURRENT = 2
    VOLTAGE = 3


@dataclass(frozen=True, slots=True)
class Event:
    """Something happened at an instant; `detail` is the joint of INDEX, the fault of FAULT."""

    kind: EventKind
    detail: int
    tick: int


@dataclass(frozen=True, slots=True)
class Sample:
    """The encoders at one tick: the low 16 bits of the tick and of each multi-turn counter."""

    tick: int
    position0: int
    position1: int
    position2: int


@dataclass(frozen=True, slots=True)
class Position:
    """One whole multi-turn counter, counts, and the low 16 bits of the tick it was latched at."""

    joint: int
    tick: int
    position: int


@dataclass(frozen=True, slots=True)
class Status:
    """State of the device; the counters are samples since STREAM, low 16 bits."""

    state: State
    fault: Fault
    latched: bool
    overruns: int
    dropped: int
    sent: int


@dataclass(frozen=True, slots=True)
class Pong:
    """The device's time when a PING arrived: tick + fraction / 65536."""

    token: int
    tick: int
    fraction: int


@dataclass(frozen=True, slots=True)
class Ack:
    """A command was accepted; `command` is the number of its message."""

    command: int
    token: int


@dataclass(frozen=True, slots=True)
class Nak:
    """A command was refused and changed nothing."""

    command: int
    token: int
    code: NakCode


@dataclass(frozen=True, slots=True)
class Info:
    """One page of what the device is: the signals of that page by name, none for a page not in dpr.dbc."""

    page: int
    fields: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Torque:
    """Torques of the joint drives, in the unit that INFO names, at the tick of a SAMPLE; low 16 bits of that tick."""

    kind: TorqueKind
    tick: int
    torque1: int
    torque2: int


@dataclass(frozen=True, slots=True)
class ArmInput:
    """Input of the arm's drive, in the unit that INFO names, at the tick of a SAMPLE; low 16 bits of that tick."""

    kind: TorqueKind
    tick: int
    input: int


@dataclass(frozen=True, slots=True)
class Hello:
    """Opens a conversation."""

    token: int = 0
    major: int = PROTOCOL_VERSION[0]
    minor: int = PROTOCOL_VERSION[1]
    schema_hash: int = SCHEMA_HASH


@dataclass(frozen=True, slots=True)
class Hold:
    """Engages the latch; `pose` counts from 1 in the order of the rig file, 0 is none."""

    token: int = 0
    pose: int = 0


@dataclass(frozen=True, slots=True)
class Release:
    """Opens the latch."""

    token: int = 0
    key: int = RELEASE_KEY


@dataclass(frozen=True, slots=True)
class Stream:
    """Starts sampling at a rate; the first sample is tick 0."""

    token: int = 0
    rate_hz: int = 1000


@dataclass(frozen=True, slots=True)
class Stop:
    """Stops sampling; never opens the latch."""

    token: int = 0


@dataclass(frozen=True, slots=True)
class KeepAlive:
    """The host is alive."""


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leaves FAULT; the latch stays as it is."""

    token: int = 0


@dataclass(frozen=True, slots=True)
class Ping:
    """Asks for the device's time."""

    token: int


Command: TypeAlias = Hello | Hold | Release | Stream | Stop | ClearFault
"""What the host asks for and the device answers by ACK or NAK."""

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
"""Every message by its name in dpr.dbc."""

_CODECS: dict[type[Message], Codec] = {
    kind: (paged_codec if kind is Info else plain_codec)(kind, DATABASE.get_message_by_name(name))
    for name, kind in MESSAGES.items()
}
_CODEC_OF_NUMBER: dict[int, Codec] = {codec.number: codec for codec in _CODECS.values()}

NUMBERS: dict[type[Message], int] = {kind: codec.number for kind, codec in _CODECS.items()}
"""The number of every message: the low six bits of its identifier."""

NAMES: dict[int, str] = {NUMBERS[kind]: name for name, kind in MESSAGES.items()}
"""The name of every number."""


def frame_id(node: int, number: int) -> int:
    """The 11-bit identifier of a message to or from a node.

    Raises:
        ValueError: node beyond 5 bits or number beyond 6.
    """
    if not 0 <= node < 1 << _NODE_BITS or not 0 <= number < 1 << _NUMBER_BITS:
        raise ValueError(f"node {node} must be below {1 << _NODE_BITS} and number {number} below {1 << _NUMBER_BITS}")
    return node << _NUMBER_BITS | number


@dataclass(frozen=True, slots=True)
class Frame:
    """What a link carries: an 11-bit identifier and at most eight bytes."""

    id: int
    data: bytes

    @property
    def node(self) -> int:
        """Which device the frame is to or from."""
        return self.id >> _NUMBER_BITS

    @property
    def number(self) -> int:
        """Which message it is."""
        return self.id & _NUMBER_MASK


def encode(message: Message, node: int = DEVICE_NODE) -> Frame:
    """The frame that carries a message to or from a node.

    Raises:
        LocalProtocolError: a field is out of its range in dpr.dbc.
    """
    codec = _CODECS[type(message)]
    try:
        data = codec.pack(message)
    except (struct.error, ValueError, EncodeError) as error:
        raise LocalProtocolError(f"{message} does not fit dpr.dbc: {error}") from error
    return Frame(node << _NUMBER_BITS | codec.number, data)


def decode(frame: Frame) -> Message:
    """The message in a frame, whichever node it is from.

    Raises:
        RemoteProtocolError: a number or a value that dpr.dbc does not know, or a wrong length.
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
    """What the fault that an EVENT names means and what to do, also of one that dpr.dbc does not know."""
    if number in tuple(Fault):
        return " ".join(explain(Fault(number)))
    return f"The device reports fault {number}, which is not in dpr.dbc. Read its documentation, then clear it."


def explain(code: NakCode | Fault | EventKind) -> tuple[str, str]:
    """What a code means and what to do about it, two sentences from dpr.dbc."""
    message, signal = _EXPLAINED[type(code)]
    comment = DATABASE.get_message_by_name(message).get_signal_by_name(signal).comment or ""
    lines = dict(line.split(": ", 1) for line in comment.splitlines())
    text, remedy = lines[code.name].split(". ", 1)
    return f"{text}.", remedy

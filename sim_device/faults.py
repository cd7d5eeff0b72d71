"""Simulated faults of cable, board, encoders and link, which can be requested by name."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.missed_counts import MISSED_COUNTS
from dpr_lab.errors import ConfigError
from dpr_lab.rig import JOINTS
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import NUMBERS, ArmInput, Event, Frame, Pong, Status, Torque, decode, encode
from sim_device.random_streams import RandomStream, generator


@dataclass(frozen=True, slots=True)
class FaultKind:
    """Meaning of a fault's value, and the part of the device that it affects."""

    site: Literal["frame", "byte", "board", "encoder", "time", "identity"]
    meaning: str
    highest: float = 1.0
    whole: bool = False


FAULTS: dict[str, FaultKind] = {
    "drop": FaultKind("frame", "probability that a frame is lost, in either direction"),
    "duplicate": FaultKind("frame", "probability that a frame arrives twice, in either direction"),
    "reorder": FaultKind("frame", "probability that two successive frames are exchanged, in either direction"),
    "lose_torques": FaultKind("frame", "probability that a TORQUE or ARM_INPUT frame is lost"),
    "lose_events": FaultKind("frame", "number of the first EVENT frames that are lost", np.inf, whole=True),
    "lose_pongs": FaultKind("frame", "probability that a PONG frame is lost"),
    "pong_scale": FaultKind("frame", "factor on the tick in PONG; 0: constant", 10.0),
    "stuck_latch": FaultKind("frame", "1: every STATUS reports that the latch holds", whole=True),
    "flip": FaultKind("byte", "probability that a byte has one bit inverted, in either direction"),
    "garbage": FaultKind("byte", "probability that a write to the host is preceded by stray bytes"),
    "truncate": FaultKind("byte", "probability that a frame to the host is truncated"),
    "overrun": FaultKind("board", "probability that the board is too late for a sample"),
    "stuck_encoder": FaultKind(
        "encoder", "joint (0, 1, 2) whose counter stays constant after the release", JOINTS - 1, whole=True
    ),
    "constant_encoder2": FaultKind(
        "encoder", "constant reading of encoder 2 in counts, as of an encoder without a rod", 32767, whole=True
    ),
    MISSED_COUNTS.name: FaultKind(
        "encoder", "counts that encoder 2 misses, a quarter of a second after the release", 32767, whole=True
    ),
    "stall_ms": FaultKind("time", "duration in ms of repeated interruptions of the link while streaming", 60_000),
    "bus_off_after_s": FaultKind("time", "device seconds of streaming after which the link transmits nothing", np.inf),
    "cut_after_s": FaultKind("time", "device seconds of streaming after which the link is cut", np.inf),
    "cut_at_release": FaultKind("time", "1: the link is cut immediately after the release", whole=True),
    "reset_after_s": FaultKind("time", "device seconds of streaming after which the device restarts", np.inf),
    "major": FaultKind("identity", "major version of the protocol that the device claims", 255, whole=True),
    "schema": FaultKind("identity", "schema hash that the device claims", 0xFFFFFFFF, whole=True),
}
"""Description of each fault, by its name on the command line. Several faults can be combined."""

STRAY_BYTES = 24
"""Number of bytes that `garbage` inserts before a write."""

MISSED_AFTER_S = 0.25
"""Time after the release at which an encoder misses several counts, s."""


class Faults:
    """Requested faults, with the random numbers that determine when they occur."""

    def __init__(self, values: dict[str, float] | None = None, seed: int = 0) -> None:
        self._values = values or {}
        self._rng = generator(seed, RandomStream.FAULTS, 1)
        self._events_to_lose = self._values.get("lose_events", 0.0)

    def value(self, name: str) -> float | None:
        """Return the value of a fault, or None if it is not requested."""
        return self._values.get(name)

    def strikes_bytes(self) -> bool:
        """Return whether any requested fault changes bytes; a CAN bus does not transmit such frames."""
        return any(FAULTS[name].site == "byte" for name in self._values)

    def frames(self, frames: list[Frame]) -> list[Frame]:
        """Return the frames that arrive when these frames are sent."""
        drop, twice, swap = (self._values.get(name, 0.0) for name in ("drop", "duplicate", "reorder"))
        frames = self._without_events(frames) if self._events_to_lose else frames
        for drive in (Torque, ArmInput):
            frames = self._without("lose_torques", NUMBERS[drive], frames)
        frames = self._without("lose_pongs", NUMBERS[Pong], frames)
        if self._values.keys() & {"pong_scale", "stuck_latch"}:
            frames = [self._untrue(frame) for frame in frames]
        if not frames or drop == twice == swap == 0.0:
            return frames
        remaining = [frame for frame, u in zip(frames, self._rng.random(len(frames)), strict=True) if u >= drop]
        copies = 1 + (self._rng.random(len(remaining)) < twice)
        arrived = [frame for frame, n in zip(remaining, copies, strict=True) for _ in range(n)]
        for place in np.flatnonzero(self._rng.random(max(0, len(arrived) - 1)) < swap):
            arrived[place], arrived[place + 1] = arrived[place + 1], arrived[place]
        return arrived

    def _without_events(self, frames: list[Frame]) -> list[Frame]:
        events = [place for place, frame in enumerate(frames) if frame.number == NUMBERS[Event]][
            : int(self._events_to_lose)
        ]
        self._events_to_lose -= len(events)
        return [frame for place, frame in enumerate(frames) if place not in events]

    def _without(self, fault: str, number: int, frames: list[Frame]) -> list[Frame]:
        if fault not in self._values:
            return frames
        lost = self._rng.random(len(frames)) < self._values[fault]
        return [frame for frame, gone in zip(frames, lost, strict=True) if not (gone and frame.number == number)]

    def _untrue(self, frame: Frame) -> Frame:
        """Falsify a PONG or STATUS if this fault is requested; return other frames unchanged."""
        if frame.number == NUMBERS[Pong] and "pong_scale" in self._values:
            pong = decode(frame)
            assert isinstance(pong, Pong)
            tick, fraction = divmod((pong.tick + pong.fraction / 65536) * self._values["pong_scale"], 1.0)
            return encode(replace(pong, tick=int(tick) & 0xFFFFFFFF, fraction=int(fraction * 65536)), frame.node)
        if frame.number == NUMBERS[Status] and self._values.get("stuck_latch"):
            status = decode(frame)
            assert isinstance(status, Status)
            return encode(replace(status, latched=True), frame.node)
        return frame

    def framed(self, data: bytes) -> bytes:
        """Return the bytes of a frame, which the fault `truncate` may shorten."""
        share = self._values.get("truncate", 0.0)
        if not share or len(data) < 2 or self._rng.random() >= share:
            return data
        return data[: self._rng.integers(1, len(data))]

    def taken(self, count: int) -> NDArray[np.bool_]:
        """Return the flags (count,) of the samples that the board takes in time."""
        late = self._values.get("overrun", 0.0)
        return self._rng.random(count) >= late if late else np.ones(count, dtype=np.bool_)

    def identity(self, info: DeviceInfo) -> DeviceInfo:
        """Return the identity that the device reports."""
        major, schema = self._values.get("major", info.major), self._values.get("schema", info.schema_hash)
        return replace(info, major=int(major), schema_hash=int(schema))

    def to_host(self, data: bytes) -> bytes:
        """Return the bytes that arrive at the host: with flipped bits, and preceded by stray bytes."""
        garbage = self._values.get("garbage", 0.0)
        stray = self._rng.bytes(STRAY_BYTES) if data and garbage and self._rng.random() < garbage else b""
        return stray + self.flipped(data)

    def flipped(self, data: bytes) -> bytes:
        """Return the bytes that arrive over a noisy cable, which the fault `flip` may change."""
        flip = self._values.get("flip", 0.0)
        if not data or not flip:
            return data
        octets = np.frombuffer(data, dtype=np.uint8)
        bits = np.uint8(1) << self._rng.integers(0, 8, len(octets), dtype=np.uint8)
        struck = np.where(self._rng.random(len(octets)) < flip, octets ^ bits, octets)
        return struck.tobytes()

    def connected(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the counts (n, 3) of the encoders.

        The count of joint 2 is constant if its encoder is not connected to a rod.
        """
        constant = self._values.get("constant_encoder2")
        return counts if constant is None else np.column_stack([counts[:, :2], np.full(len(counts), int(constant))])

    def counts(
        self, counts: NDArray[np.int64], released_at: NDArray[np.int64], since: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """Return the counts (n, 3) of a swing with the requested encoder faults.

        Args:
            counts: (n, 3) counts without faults
            released_at: (3,) counts at the release
            since: (n,) time since the release, s
        """
        joint, missed = self._values.get("stuck_encoder"), self._values.get(MISSED_COUNTS.name, 0.0)
        if joint is None and not missed:
            return counts
        given = counts.copy()
        given[:, 2] -= np.where(since >= MISSED_AFTER_S, int(missed), 0)
        if joint is not None:
            given[:, int(joint)] = released_at[int(joint)]
        return given


def parse_faults(texts: Iterable[str], seed: int = 0) -> Faults:
    """Parse faults from texts such as `drop=0.01`.

    Raises:
        ConfigError: the text is not `name=value`, the fault is unknown, or its value is out of range.
    """
    return Faults(dict(_parsed(text) for text in texts), seed)


def _parsed(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    if name not in FAULTS:
        raise ConfigError(f"fault {text!r}: unknown fault {name!r} (available: {', '.join(FAULTS)})")
    kind = FAULTS[name]
    number = _number(value)
    if number is None or not 0 <= number <= kind.highest or (kind.whole and number != int(number)):
        raise ConfigError(f"fault {text!r}: write {name}=VALUE with the {kind.meaning}, 0 to {kind.highest:g}")
    return name, number


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None

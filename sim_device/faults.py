"""Faults on request: what a bad cable, a dying board or a broken encoder does to a recording."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import ConfigError
from dpr_lab.rig import JOINTS
from firmware_protocol.messages import Frame
from sim_device.chance import Stream, generator


@dataclass(frozen=True, slots=True)
class FaultKind:
    """What a fault's value means and where it strikes."""

    site: Literal["frame", "byte", "encoder", "time"]
    meaning: str
    highest: float = 1.0


FAULTS: dict[str, FaultKind] = {
    "drop": FaultKind("frame", "probability that a frame is lost, either way"),
    "duplicate": FaultKind("frame", "probability that a frame arrives twice, either way"),
    "flip": FaultKind("byte", "probability that a byte to the host has one bit flipped"),
    "garbage": FaultKind("byte", "probability that a write to the host is preceded by stray bytes"),
    "stuck_encoder": FaultKind(
        "encoder", "joint (0, 1, 2) whose counter stays where it was at the release", JOINTS - 1
    ),
    "cut_after_s": FaultKind("time", "device seconds of streaming after which the link is cut", np.inf),
    "reset_after_s": FaultKind("time", "device seconds of streaming after which the device restarts", np.inf),
}
"""Name on the command line -> kind. Everything here can be given several times and combined."""

STRAY_BYTES = 24


class Faults:
    """The faults asked for, and their own stream of chance."""

    def __init__(self, values: dict[str, float] | None = None, seed: int = 0) -> None:
        self._values = values or {}
        self._chance = generator(seed, Stream.FAULTS, 1)

    def value(self, name: str) -> float | None:
        """The value of a fault; None when it was not asked for."""
        return self._values.get(name)

    def strikes_bytes(self) -> bool:
        """Whether any fault works on bytes, which a CAN bus does not show."""
        return any(FAULTS[name].site == "byte" for name in self._values)

    def frames(self, frames: list[Frame]) -> list[Frame]:
        """The frames that arrive."""
        drop, twice = self._values.get("drop", 0.0), self._values.get("duplicate", 0.0)
        if not frames or drop == twice == 0.0:
            return frames
        kept = [frame for frame, u in zip(frames, self._chance.random(len(frames)), strict=True) if u >= drop]
        copies = 1 + (self._chance.random(len(kept)) < twice)
        return [frame for frame, n in zip(kept, copies, strict=True) for _ in range(n)]

    def bytes(self, data: bytes) -> bytes:
        """The bytes that arrive."""
        flip, garbage = self._values.get("flip", 0.0), self._values.get("garbage", 0.0)
        if not data or flip == garbage == 0.0:
            return data
        octets = np.frombuffer(data, dtype=np.uint8)
        bits = np.uint8(1) << self._chance.integers(0, 8, len(octets), dtype=np.uint8)
        struck = np.where(self._chance.random(len(octets)) < flip, octets ^ bits, octets)
        stray = self._chance.bytes(STRAY_BYTES) if self._chance.random() < garbage else b""
        return stray + struck.tobytes()

    def counts(self, counts: NDArray[np.int64], released_at: NDArray[np.int64]) -> NDArray[np.int64]:
        """(n, 3) counts of a swing as the encoders give them; `released_at` (3,) are those at the release."""
        joint = self._values.get("stuck_encoder")
        if joint is None:
            return counts
        stuck = counts.copy()
        stuck[:, int(joint)] = released_at[int(joint)]
        return stuck


def parse_faults(texts: Iterable[str], seed: int = 0) -> Faults:
    """Faults from texts such as `drop=0.01`.

    Raises:
        ConfigError: not `name=value`, no such fault, or a value out of range.
    """
    return Faults(dict(_parsed(text) for text in texts), seed)


def _parsed(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    if name not in FAULTS:
        raise ConfigError(f"fault {text!r}: there is no fault {name!r} (there are: {', '.join(FAULTS)})")
    kind = FAULTS[name]
    number = _number(value)
    if number is None or not 0 <= number <= kind.highest or (kind.site == "encoder" and number != int(number)):
        raise ConfigError(f"fault {text!r}: write {name}=VALUE with the {kind.meaning}, 0 to {kind.highest:g}")
    return name, number


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None

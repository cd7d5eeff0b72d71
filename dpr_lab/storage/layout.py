"""Layout of a run file: channels and their schemas, metadata records, limits.

On every channel, `log_time` counts nanoseconds from the start of the stream. For samples and for events with a tick,
`log_time` is the device time, tick / rate_hz. For an imported table, it is the time column. On the other channels,
`log_time` is the host time since the first message, and `publish_time` is the host time itself.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

FORMAT = "dpr-lab run 1"
"""Value of the key `format` in the provenance record. This version reads no other layout."""

SUFFIX = ".mcap"
RIG_ATTACHMENT = "rig.toml"
RELEASED = "RELEASED"
"""Kind of the event that contains the tick of the release."""

PROVENANCE, UNITS, END = "provenance", "units", "end"
"""Names of the metadata records before the first and after the last sample."""

INTERRUPTED = "interrupted"
"""Key in `RunMetadata.extra` for the text that states where and why a recovered recording was interrupted."""

SAMPLES, RAW, EVENTS, STATUS, CLOCK = "/samples", "/raw", "/events", "/status", "/clock"


@dataclass(frozen=True, slots=True)
class FileLimits:
    """Limits of run files that writer and reader share."""

    chunk_bytes: int = 1 << 20
    """Maximum size of the samples in a chunk, before compression."""
    record_bytes: int = 4 << 20
    """Maximum size of a record, bytes. It is far above the largest chunk of the writer, and limits lengths in damaged
    or malicious files."""
    expansion: int = 100
    """Maximum ratio of unpacked to compressed size, over all chunks together. Chunks with samples at rest have a ratio
    of 15."""
    small_chunk_bytes: int = 2 << 20
    """Maximum unpacked size of a small chunk, bytes: twice the chunk size of the writer."""
    surplus_bytes: int = 1 << 26
    """Additional unpacked size that all chunks together may have, bytes. Chunks that repeat one message compress
    further than `expansion` allows."""
    ticks: int = 1 << 53
    """Maximum tick: 70,000 years at 4 kHz. Ticks up to this value are exact as floats."""


LIMITS = FileLimits()

NANOSECONDS = 1_000_000_000
"""Nanoseconds per second: the unit of every time in the file."""

TORQUE_KEYS = ("tau", "tau_commanded")
"""Keys of the torques in a sample. If both kinds are known, the first is measured and the second commanded. If one kind
is known, it has the first key."""

UNIT_TABLE = {
    "tick": "sample periods since the stream started; row number in an imported table",
    "t": "s since tick 0, device time",
    "counts": "encoder counts of joints 0, 1, 2, multi-turn",
    "tau": "N m, known torques of joints 1, 2, each held until the next sample; with a driven arm its input, and 0",
    "tau_commanded": "N m, commanded torques; if present, tau contains the measured torques",
    "theta": "rad, absolute angles of arm, inner and outer rod; 0 = upright, pi = hanging",
    "log_time": "ns since the stream started: device time on /samples, host time on the other channels",
    "publish_time": "ns, host clock; equal to log_time on /samples",
}


SCHEMAS: dict[str, dict[str, Any]] = json.loads(Path(__file__).with_name("channels.json").read_text(encoding="utf-8"))
"""JSON schema of each channel with JSON content. The channel `/raw` has no schema: it contains the received bytes."""


class Stored(NamedTuple):
    """One message as it is stored in the file."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


def sealed(record: Mapping[str, str]) -> dict[str, str]:
    """Add a digest to a metadata record.

    MCAP protects chunks with a CRC, but not metadata records.
    """
    return {**record, "digest": _digest(record)}


def unsealed(record: Mapping[str, str]) -> dict[str, str] | None:
    """Remove the digest from a metadata record; return None if it does not match."""
    content = {key: value for key, value in record.items() if key != "digest"}
    return content if record.get("digest") == _digest(content) else None


def _digest(record: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(record), sort_keys=True).encode()).hexdigest()[:16]

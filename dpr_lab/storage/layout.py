"""Layout of a run file: channels and their schemas, metadata records, limits.

Time in the file: `log_time` counts nanoseconds from the start of the stream on every channel. On `/samples` and on
events that name a tick it is device time, tick / rate_hz (the row's own time in an imported table); on the other
channels it is host time since the first host time seen, and `publish_time` keeps the host time itself.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

FORMAT = "dpr-lab run 1"
"""Value of `format` in the provenance record; this version cannot read other layouts."""

SUFFIX = ".mcap"
RIG_ATTACHMENT = "rig.toml"
RELEASED = "RELEASED"
"""Kind of the event that contains the release tick."""

PROVENANCE, UNITS, END = "provenance", "units", "end"
"""Names of the metadata records before the first and after the last sample."""

SAMPLES, RAW, EVENTS, STATUS, CLOCK = "/samples", "/raw", "/events", "/status", "/clock"


@dataclass(frozen=True, slots=True)
class FileLimits:
    """Limits of run files, for the writer and the reader."""

    chunk_bytes: int = 1 << 20
    """Maximum size of the samples in a chunk, before compression."""
    record_bytes: int = 4 << 20
    """Maximum size of a record, far above that of any chunk of the writer; limits damaged or malicious lengths."""
    expansion: int = 100
    """Maximum compression ratio of all chunks together; rods at rest compress by a factor of fifteen."""
    small_chunk_bytes: int = 2 << 20
    """Size to which even a small chunk may expand: twice that of the writer."""
    surplus_bytes: int = 1 << 26
    """Additional total size to which the chunks may expand, because a chunk that repeats one message compresses
    further.
    """
    ticks: int = 1 << 53
    """Maximum tick: 70,000 years at 4 kHz, and exact as a float."""


LIMITS = FileLimits()

NANOSECONDS = 1_000_000_000
"""Nanoseconds per second: the unit of every time in the file."""

TORQUE_KEYS = ("tau", "tau_commanded")
"""Keys of the torques of a sample: the torques, or the measured and then the commanded torques if both are known."""

UNIT_TABLE = {
    "tick": "sample periods since the stream started; row number in an imported table",
    "t": "s since tick 0, device time",
    "counts": "encoder counts of joints 0, 1, 2, multi-turn",
    "tau": "N m, known torques of joints 1, 2, each held until the next sample; with a driven arm its input, and 0",
    "tau_commanded": "N m, commanded torques; tau then contains the measured torques",
    "theta": "rad, absolute angles of arm, inner and outer rod; 0 = upright, pi = hanging",
    "log_time": "ns since the stream started: device time on /samples, host time on the other channels",
    "publish_time": "ns, host clock; equal to log_time on /samples",
}


def _object(properties: Mapping[str, Any], required: tuple[str, ...] = ()) -> dict[str, Any]:
    return {"type": "object", "properties": dict(properties), "required": list(required)}


_INTEGER, _NUMBER, _TEXT, _FLAG = {"type": "integer"}, {"type": "number"}, {"type": "string"}, {"type": "boolean"}

SCHEMAS: dict[str, dict[str, Any]] = {
    SAMPLES: _object(
        {
            "tick": _INTEGER,
            "t": _NUMBER,
            "counts": {"type": "array", "items": _INTEGER},
            "theta": {"type": "array", "items": _NUMBER},
            "tau": {"type": "array", "items": _NUMBER},
            "tau_commanded": {"type": "array", "items": _NUMBER},
        },
        required=("tick", "t", "theta"),
    ),
    EVENTS: _object({"kind": _TEXT, "tick": _INTEGER, "detail": _TEXT}, required=("kind",)),
    STATUS: _object(
        {
            "state": _TEXT,
            "latched": _FLAG,
            "fault": _TEXT,
            "overruns": _INTEGER,
            "dropped": _INTEGER,
            "sent": _INTEGER,
        }
    ),
    CLOCK: _object({}),
}
"""JSON schema of each channel with JSON content; `/raw` contains the received bytes."""


class Stored(NamedTuple):
    """One message as stored in the file."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


def sealed(record: Mapping[str, str]) -> dict[str, str]:
    """A metadata record with its own digest, because MCAP protects chunks with a CRC but not these records."""
    return {**record, "digest": _digest(record)}


def unsealed(record: Mapping[str, str]) -> dict[str, str] | None:
    """The record without its digest, or None if they do not match."""
    content = {key: value for key, value in record.items() if key != "digest"}
    return content if record.get("digest") == _digest(content) else None


def _digest(record: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(record), sort_keys=True).encode()).hexdigest()[:16]

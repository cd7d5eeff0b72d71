"""What a run file is made of: channels and their schemas, metadata records, limits.

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
"""Value of `format` in the provenance record; another number is a layout this version cannot read."""

SUFFIX = ".mcap"
RIG_ATTACHMENT = "rig.toml"
RELEASED = "RELEASED"
"""Kind of the event that carries the release tick."""

PROVENANCE, UNITS, END = "provenance", "units", "end"
"""Names of the metadata records: before the first sample, and after the last one."""

SAMPLES, RAW, EVENTS, STATUS, CLOCK = "/samples", "/raw", "/events", "/status", "/clock"


@dataclass(frozen=True, slots=True)
class FileLimits:
    """Limits of run files, for the writer and the reader."""

    chunk_bytes: int = 1 << 20
    """Of samples, before compression, in one chunk at most."""
    record_bytes: int = 4 << 20
    """Of one record: far above any chunk the writer makes; a damaged or hostile length stops here."""
    expansion: int = 100
    """Bytes in the chunks for each compressed one, all chunks together; rods at rest compress fifteenfold."""
    small_chunk_bytes: int = 2 << 20
    """A chunk may expand to this, however small it is: twice what the writer makes."""
    surplus_bytes: int = 1 << 26
    """What the chunks may expand to beyond that, all together: one that repeats a message compresses further."""
    ticks: int = 1 << 53
    """Seventy thousand years at 4 kHz, and exact as a float."""


LIMITS = FileLimits()

NANOSECONDS = 1_000_000_000
"""In a second: the unit of every time in the file."""

TORQUE_KEYS = ("tau", "tau_commanded")
"""Of a sample: its torques, or the measured ones and then the commanded ones where both are known."""

UNIT_TABLE = {
    "tick": "sample periods since the stream started; row number in an imported table",
    "t": "s since tick 0, device time",
    "counts": "encoder counts of joints 0, 1, 2, multi-turn",
    "tau": "N m, known torques of joints 1 and 2, each held until the next sample; of a driven arm its input, and 0",
    "tau_commanded": "N m, the commanded ones; tau then holds the measured ones",
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
"""JSON schema of each channel that holds JSON; `/raw` holds bytes as received."""


class Stored(NamedTuple):
    """One message as the file holds it."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


def sealed(record: Mapping[str, str]) -> dict[str, str]:
    """A metadata record with its own digest, since MCAP guards chunks with a CRC but not these records."""
    return {**record, "digest": _digest(record)}


def unsealed(record: Mapping[str, str]) -> dict[str, str] | None:
    """The record without its digest, or None if one does not fit the other."""
    content = {key: value for key, value in record.items() if key != "digest"}
    return content if record.get("digest") == _digest(content) else None


def _digest(record: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(dict(record), sort_keys=True).encode()).hexdigest()[:16]

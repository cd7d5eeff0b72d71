"""Read `sensor_msgs/JointState` from MCAP files and ROS 2 bags, without ROS."""

import re
import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from dpr_lab.errors import RunError, printable
from dpr_lab.storage.export import JOINT_STATE, JOINT_STATE_DEFINITION, extra
from dpr_lab.storage.layout import NANOSECONDS, PROVENANCE
from dpr_lab.storage.readers.arrays import library_of, refuse_large
from dpr_lab.storage.scan import mapped
from dpr_lab.storage.tables.table import Column, Table
from dpr_lab.whole_file import regular

KIND = "ROS 2 bag"
BROKEN_MCAP = (McapError, zstandard.ZstdError, struct.error)
"""Exceptions of the libraries for a file with invalid bytes."""


@dataclass(frozen=True, slots=True)
class BagLimits:
    """Limits on the sizes of records and messages of a bag."""

    record_bytes: int = 64 << 20
    """Maximum size of a record or chunk, compressed or unpacked, bytes. A chunk may contain images next to the joint
    states."""
    message_bytes: int = 1 << 16
    """Maximum size of a JointState message, bytes; enough for some hundred joints."""
    joints: int = 100


LIMITS = BagLimits()

Stamped = tuple[str, int, bytes]
"""One message: topic, log time in ns, and CDR bytes."""


def read_mcap(path: Path, take: Sequence[str]) -> Table:
    """Read the joint positions of an MCAP file; `take` names the topic.

    Raises:
        RunError: the file is damaged or is a run file; JointState is on no topic or on several topics; or two joints
            have the same name.
        DprError: mcap-ros2-support is not installed.
    """
    return _table(path, "MCAP file", _mcap_messages(path), take)


def read_sqlite(path: Path, take: Sequence[str]) -> Table:
    """Read the joint positions of a `.db3` file of a ROS 2 bag.

    See `read_mcap` for arguments and errors.
    """
    return _table(path, KIND, _sqlite_messages(path), take)


def read_bag(folder: Path, take: Sequence[str]) -> Table:
    """Read the joint positions of a ROS 2 bag, which is a folder with `metadata.yaml`.

    See `read_mcap` for the argument `take` and the errors.
    """
    if not (folder / "metadata.yaml").is_file():
        raise RunError(
            f"{folder}: is a folder without metadata.yaml and therefore not a ROS 2 bag: give a file in this folder"
        )
    files = sorted((p for p in folder.iterdir() if p.suffix in (".mcap", ".db3")), key=_by_number)
    if not files:
        raise RunError(f"{folder}: is a ROS 2 bag without a .mcap or .db3 file; decompress a compressed bag first")
    return _table(folder, KIND, chain.from_iterable(map(_messages_of_part, files)), take)


def _messages_of_part(path: Path) -> Iterator[Stamped]:
    """Read the messages of one file of a bag; an error names this file."""
    with library_of(path, KIND, *BROKEN_MCAP):
        yield from (_mcap_messages if path.suffix == ".mcap" else _sqlite_messages)(path)


def _by_number(path: Path) -> list[tuple[int, str]]:
    return [(int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d{1,9})", path.name)]


def _table(path: Path, kind: str, messages: Iterable[Stamped], take: Sequence[str]) -> Table:
    with library_of(path, kind, *BROKEN_MCAP):
        times, names, rows, topic = _gathered(path, messages, take)
    values = np.full((len(rows), len(names)), np.nan)
    for row, positions in enumerate(rows):
        values[row, list(positions)] = list(positions.values())
    t = (np.array(times) - times[0]) / NANOSECONDS
    return Table(
        path,
        tuple(map(Column, ("t", *names), (t, *values.T))),
        np.arange(1, len(rows) + 1),
        (f"joints of {topic}: {', '.join(names)}",),
        kind,
    )


@cache
def _decoder() -> Callable[[bytes], Any]:
    """Return a function that decodes a JointState from CDR.

    Raises:
        DprError: mcap-ros2-support is not installed.
    """
    with extra("ros2"):
        from mcap_ros2.decoder import DecoderFactory
    # The stored definition of the message is not needed, so it is not read.
    schema = Schema(id=1, name=JOINT_STATE, encoding="ros2msg", data=JOINT_STATE_DEFINITION.encode())
    decode = DecoderFactory().decoder_for("cdr", schema)
    assert decode is not None
    return decode


def _gathered(
    path: Path, messages: Iterable[Stamped], take: Sequence[str]
) -> tuple[list[int], list[str], list[dict[int, float]], str]:
    """Collect the content of all messages on the JointState topic.

    Return the times, ns, the names of the joints, the positions of each message by joint index, and the topic.
    """
    logged: list[int] = []
    stamped: list[int] = []
    joints: dict[str, int] = {}
    rows: list[dict[int, float]] = []
    topics: set[str] = set()
    for topic, log_time, data in messages:
        topics.add(topic)
        if take and topic not in take:
            continue
        if len(topics) > 1 and not take:
            available = ", ".join(sorted(map(printable, topics)))
            raise RunError(f"{path}: contains JointState on several topics: choose one with --take: {available}")
        if len(data) > LIMITS.message_bytes:
            raise RunError(
                f"{path}: contains a JointState of {len(data):,} bytes; the maximum is {LIMITS.message_bytes:,}"
            )
        message = _decoder()(data)
        rows.append(_positions(path, message, joints))
        refuse_large(path, len(rows) * (len(joints) + 1))
        logged.append(log_time)
        stamped.append(message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec)
    if not rows:
        available = f"; its topics of that type: {', '.join(sorted(map(printable, topics)))}" if topics else ""
        raise RunError(f"{path}: contains no sensor_msgs/JointState{f' on {take[0]}' if take else ''}{available}")
    # A driver without time stamps writes zero.
    return (stamped if all(stamped) else logged), list(joints), rows, printable(min(take or topics))


def _positions(path: Path, message: Any, joints: dict[str, int]) -> dict[int, float]:
    names = [printable(name) for name in message.name]
    if len(set(names)) < len(names):
        raise RunError(f"{path}: two joints of a JointState have the same name: {', '.join(names[:10])}: rename one")
    if len(message.position) != len(names):
        raise RunError(f"{path}: contains a JointState with {len(names)} names but {len(message.position)} positions")
    for name in names:
        joints.setdefault(name, len(joints))
    if len(joints) > LIMITS.joints:
        raise RunError(f"{path}: contains more than {LIMITS.joints} joints")
    return {joints[name]: float(position) for name, position in zip(names, message.position, strict=True)}


def _mcap_messages(path: Path) -> Iterator[Stamped]:
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    with mapped(path) as file:
        reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=LIMITS.record_bytes)  # pyright: ignore[reportArgumentType]
        for record in reader.records:
            for inner in breakup_chunk(_expanded(record), validate_crc=True) if isinstance(record, Chunk) else [record]:
                match inner:
                    case Metadata(name=name) if name == PROVENANCE:
                        raise RunError(f"{path}: is already a run of dpr-lab and needs no import")
                    case Schema():
                        schemas[inner.id] = inner.name
                    case Channel() if schemas.get(inner.schema_id) in (JOINT_STATE, "sensor_msgs/JointState"):
                        _refuse_encoding(path, inner)
                        channels[inner.id] = inner
                    case Message() if inner.channel_id in channels:
                        yield channels[inner.channel_id].topic, inner.log_time, inner.data
                    case _:
                        pass


def _refuse_encoding(path: Path, channel: Channel) -> None:
    if channel.message_encoding != "cdr":
        encoding = printable(channel.message_encoding[:20])
        raise RunError(f"{path}: the encoding of its JointState is {encoding!r}: convert the bag to ROS 2")


def _expanded(chunk: Chunk) -> Chunk:
    """Unpack a chunk; its size must not exceed the declared size and the limit."""
    size = chunk.uncompressed_size
    if size > LIMITS.record_bytes:
        raise McapError(f"a chunk that would expand to {size:,} bytes; the maximum is {LIMITS.record_bytes:,}")
    if chunk.compression == "zstd":
        if zstandard.frame_content_size(chunk.data) > size:
            raise McapError("a chunk larger than its declared size")
        return replace(chunk, compression="", data=zstandard.decompress(chunk.data, size))
    if chunk.compression == "lz4":
        import lz4.frame

        expanded = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        return replace(chunk, compression="", data=expanded)
    return chunk


def _sqlite_messages(path: Path) -> Iterator[Stamped]:
    regular(path, RunError)
    with (
        library_of(path, KIND, sqlite3.Error),
        closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as bag,
    ):
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LIMITS.record_bytes)
        bag.execute("PRAGMA trusted_schema = OFF")
        tables = bag.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        if not {("topics",), ("messages",)} <= set(tables.fetchmany(LIMITS.joints)):
            raise RunError(f"{path}: is a database, but not a ROS 2 bag")
        kinds = (JOINT_STATE, "cdr")
        query = (
            "SELECT name, timestamp, data FROM messages JOIN topics ON topics.id = topic_id"
            " WHERE topics.type = ? AND serialization_format = ? ORDER BY timestamp"
        )
        for name, stamp, message in bag.execute(query, kinds):
            yield str(name), int(stamp), bytes(message)

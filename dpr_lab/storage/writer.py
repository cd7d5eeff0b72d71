"""Write a run file during the recording.

If the process is killed, at most the last chunk is lost.
"""

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from io import BufferedWriter
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.rig import JOINTS
from dpr_lab.shown import in_command
from dpr_lab.storage.chunk_index import ChunkIndices, keep_on_disk, write_rows
from dpr_lab.storage.layout import (
    CLOCK,
    END,
    EVENTS,
    LIMITS,
    NANOSECONDS,
    PROVENANCE,
    RAW,
    RELEASED,
    RIG_ATTACHMENT,
    SAMPLES,
    SCHEMAS,
    STATUS,
    UNIT_TABLE,
    UNITS,
    Stored,
    sealed,
)
from dpr_lab.storage.metadata import RunMetadata, RunSummary, plain, rig_toml
from dpr_lab.storage.row_text import Samples, message_records, sample_messages, sample_texts
from dpr_lab.storage.sidecar import write_sidecar


@dataclass(frozen=True, slots=True)
class WriterSettings:
    """Settings of the writer: timing, sizes of blocks, and resolution of angles."""

    flush_s: float = 0.2
    """Maximum age of a chunk before it is passed to the operating system, s. The age is checked at each call, every 50
    ms during a recording, so that a killed process loses at most the last 250 ms."""
    sync_s: float = 5.0
    """Interval at which the file is synchronised with the disk (fsync), s. A call can block for 100 ms. Between the
    calls, data passed to the operating system are lost only in a power failure."""
    messages_a_chunk: int = 500
    """Maximum number of messages between two flushes, for each kind of event and for STATUS. Further messages are
    counted but not stored."""
    block_rows: int = 8192
    """Number of table rows that are written at a time; about a chunk."""
    many_rows: int = 1000
    """Minimum number of rows that are written as a block. Fewer rows are written one by one, like the samples of a
    device."""
    theta_digits: int = 7
    """Number of decimals of an angle, rad. 1e-7 rad is a thousandth of a count at 65536 counts per turn. A reader
    computes the angles from the counts."""
    stale_s: float = 600.0
    """Age after which an unfinished file of a killed process is removed, s. A running import writes several times per
    second."""


SETTINGS = WriterSettings()


class RunWriter:
    """Append-only writer of one run file; a context manager for use from a single thread.

    The file has its final name from the start, unless `part` is given. If the `with` block is left without `finish` or
    by an exception, the file is closed as an incomplete run. Call any method (or `flush`) at least every 50 ms, so that
    no sample waits in memory for longer than 250 ms.

    Args:
        path: file to create; its folder is created if missing
        metadata: origin of the run
        now: function that returns a monotonic time, s, for the age of a chunk
        part: path that is written instead of `path`; the caller renames this file and writes its hash

    Raises:
        RunError: the file already exists or cannot be written. Any method raises this error if a write fails during the
            recording; the data written before are kept and can be recovered.
    """

    def __init__(
        self,
        path: Path | str,
        metadata: RunMetadata,
        now: Callable[[], float] = time.monotonic,
        part: Path | None = None,
    ) -> None:
        self.path = Path(path)
        self._part = part
        self.metadata = metadata
        self.samples_written = 0
        self._now = now
        self._last_tick = -1
        self._kept: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._first_host_ns: int | None = None
        self._open = True
        self._failure: RunError | None = None
        self._file = _create(part or self.path)
        self._files: list[BufferedWriter | ChunkIndices] = [self._file]
        self._mcap = Writer(self._file, LIMITS.chunk_bytes, CompressionType.ZSTD, enable_data_crcs=True)
        with self.disk():
            self._files.append(keep_on_disk(self._mcap, self.path.parent))
            self._channels = self._write_preamble()
            self._sync()

    def samples(self, ticks: ArrayLike, counts: ArrayLike, torques: ArrayLike | None = None) -> None:
        """Append samples from a device.

        Args:
            ticks: (n,) unwrapped sample numbers since the stream started, strictly increasing over all calls
            counts: (n, 3) unwrapped position counters
            torques: (kinds, n, 2) known torques of joint 1 and 2, N m, of a device with drives; measured torques first

        Raises:
            ValueError: the shapes are wrong, the ticks do not increase, or the time of the run comes from a table.
        """
        self._check_time_source("ticks")
        tick, count = np.asarray(ticks, dtype=np.int64), np.asarray(counts, dtype=np.int64)
        theta = np.round(self.metadata.rig.mounted_theta(count.reshape(-1, JOINTS)), SETTINGS.theta_digits)
        self._append(Samples(tick, np.round(tick / self.metadata.rate_hz, 9), theta, count, _by_kind(torques)))

    def table(
        self, t: ArrayLike, theta: ArrayLike, counts: ArrayLike | None = None, torques: ArrayLike | None = None
    ) -> None:
        """Append rows of an imported table, which has its own times.

        The tick of a row is the row number.

        Args:
            t: (n,) time since the first row of the table, s, not negative
            theta: (n, 3) absolute angles, rad
            counts: (n, 3) position counts, if the table contains them
            torques: (kinds, n, 2) known torques of joint 1 and 2, N m, if the joints were driven; order as in `samples`

        Raises:
            ValueError: the shapes are wrong, a value is not finite, or the time of the run comes from ticks.
        """
        self._check_time_source("table")
        rows = np.asarray(t, dtype=np.float64)
        tick = self._last_tick + 1 + np.arange(len(rows))
        count = None if counts is None else np.asarray(counts, dtype=np.int64)
        angles = np.asarray(theta, dtype=np.float64)
        angles = angles if count is None else np.round(angles, SETTINGS.theta_digits)
        self._append(Samples(tick, rows, angles, count, _by_kind(torques)))

    def raw(self, host_time_ns: int, payload: bytes) -> None:
        """Append the bytes that were received from the link."""
        self._add(RAW, self._since_start(host_time_ns), payload, host_time_ns)
        self._flush_when_due()

    def event(self, host_time_ns: int, kind: str, tick: int | None = None, detail: str = "") -> None:
        """Append an event of the device.

        The kind of a release is `layout.RELEASED`, and its tick is required. If one kind has too many events, further
        events are not stored. The notes of the run contain their number.
        """
        if kind != RELEASED and self._is_flood(f"events {kind}"):
            return
        message: dict[str, Any] = {"kind": kind, "detail": detail}
        log_time = self._since_start(host_time_ns)
        if tick is not None:
            message["tick"] = int(tick)
            log_time = round(tick * NANOSECONDS / self.metadata.rate_hz)
        self._add_json(EVENTS, log_time, message, host_time_ns)

    def status(self, host_time_ns: int, status: Mapping[str, Any]) -> None:
        """Append state and counters of the device, with the keys of the `/status` schema.

        If there are too many of these messages, further ones are only counted, as for events.
        """
        if self._is_flood("states"):
            return
        self._add_json(STATUS, self._since_start(host_time_ns), status, host_time_ns)

    def clock(self, host_time_ns: int, fit: Mapping[str, float]) -> None:
        """Append a fit of device time to host time, with values by name."""
        self._add_json(CLOCK, self._since_start(host_time_ns), fit, host_time_ns)

    def copy(self, messages: Iterable[Stored]) -> set[str]:
        """Append the messages of a run file that has the same metadata.

        Returns:
            Channels of other programs, whose messages are omitted.
        """
        omitted = set[str]()
        with self.disk():
            for topic, log_time, publish_time, payload in messages:
                if topic in self._channels:
                    self._mcap.add_message(self._channels[topic], log_time, payload, publish_time)
                    self.samples_written += topic == SAMPLES
                else:
                    omitted.add(topic)
        self._flush_when_due()
        return omitted

    def flush(self) -> None:
        """Pass all appended messages to the operating system."""
        self._kept.clear()
        with self.disk():
            self._mcap.flush()
            self._flushed = self._now()
            if self._flushed - self._synced >= SETTINGS.sync_s:
                self._sync()

    def finish(self, summary: RunSummary) -> None:
        """Complete the file, and write `<file>.sha256`."""
        self._close(self._with_dropped(summary).to_record(self.samples_written))

    def abort(self, reason: str, summary: RunSummary | None = None) -> None:
        """Close the file as an incomplete run with a reason; recorded data remain readable."""
        summary = self._with_dropped(summary or RunSummary())
        self._close(summary.to_record(self.samples_written, reason or "no reason given"))

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not self._open:
            return
        if error is None:
            self.abort("closed before the recording was finished")
            return
        with suppress(RunError):  # the pending exception is more informative than a second disk error
            self.abort(f"{type(error).__name__}: {error}")

    def _is_flood(self, kind: str) -> bool:
        """Count a message, and return whether it must be discarded.

        It must be discarded if its kind exceeds the maximum number of messages until the next flush.
        """
        self._kept[kind] += 1
        if self._kept[kind] <= SETTINGS.messages_a_chunk:
            return False
        self._dropped[kind] += 1
        self._flush_when_due()
        return True

    def _with_dropped(self, summary: RunSummary) -> RunSummary:
        notes = [f"{kind}: {n:,} more than the maximum number, discarded" for kind, n in self._dropped.items()]
        return replace(summary, notes=(*summary.notes, *notes))

    def _write_preamble(self) -> dict[str, int]:
        rig_text = rig_toml(self.metadata.rig)
        self._mcap.start(library=f"dpr-lab {self.metadata.versions['dpr_lab']}")
        self._mcap.add_metadata(PROVENANCE, sealed(self.metadata.to_record(rig_text)))
        self._mcap.add_metadata(UNITS, UNIT_TABLE)
        self._mcap.add_attachment(0, 0, RIG_ATTACHMENT, "application/toml", rig_text.encode())
        channels = {RAW: self._mcap.register_channel(RAW, "application/octet-stream", 0)}
        for topic, schema in SCHEMAS.items():
            name = f"dpr_lab.{topic.removeprefix('/')}"
            schema_id = self._mcap.register_schema(name, "jsonschema", json.dumps(schema).encode())
            channels[topic] = self._mcap.register_channel(topic, "json", schema_id)
        return channels

    def _check_time_source(self, source: str) -> None:
        if self.metadata.time_source != source:
            raise ValueError(f"this run's time_source is {self.metadata.time_source!r}, not {source!r}")

    def _append(self, samples: Samples) -> None:
        tick, t, theta, torques = samples.ticks, samples.t, samples.theta, samples.torques
        n = len(tick)
        if len(torques) and (torques.shape not in ((1, n, 2), (2, n, 2)) or not np.isfinite(torques).all()):
            raise ValueError(f"{n} ticks need the same number of rows of 2 finite torques, not {torques.shape}")
        if tick.shape != (n,) or any(x.shape != (n, JOINTS) for x in (theta, samples.counts) if x is not None):
            raise ValueError(f"{n} ticks need the same number of rows of {JOINTS}, not {theta.shape}")
        if not n:
            return
        if tick[0] <= self._last_tick or np.any(np.diff(tick) <= 0):
            raise ValueError(f"ticks must increase: {tick[0]} to {tick[-1]} after {self._last_tick}")
        if not (np.isfinite(theta).all() and np.isfinite(t).all() and t.min() >= 0):
            raise ValueError("times must be finite and not negative, angles finite")
        for start in range(0, n, SETTINGS.block_rows):
            with self.disk():
                self._add_rows(samples.rows(slice(start, start + SETTINGS.block_rows)))
            if start:
                self.flush()
        self._last_tick = int(tick[-1])
        self.samples_written += n
        self._flush_when_due()

    def _add_rows(self, samples: Samples) -> None:
        """Append samples: many samples as one block if a fixed width suffices for them, others one by one."""
        channel, log_ns = self._channels[SAMPLES], np.round(samples.t * NANOSECONDS).astype(np.int64)
        texts = sample_texts(samples) if len(log_ns) >= SETTINGS.many_rows else None
        if texts is not None and (np.diff(log_ns) >= 0).all():
            write_rows(self._mcap, channel, log_ns, message_records(channel, log_ns, texts))
            return
        for time_ns, message in zip(log_ns.tolist(), sample_messages(samples), strict=True):
            self._mcap.add_message(channel, time_ns, message, time_ns)

    def _add_json(self, topic: str, log_time: int, message: Mapping[str, Any], host_time_ns: int) -> None:
        self._add(topic, log_time, json.dumps(plain(message), allow_nan=False).encode(), host_time_ns)
        self._flush_when_due()

    def _add(self, topic: str, log_time: int, payload: bytes, publish_time: int) -> None:
        with self.disk():
            self._mcap.add_message(self._channels[topic], log_time, payload, publish_time)

    def _since_start(self, host_time_ns: int) -> int:
        if self._first_host_ns is None:
            self._first_host_ns = host_time_ns
        return max(0, host_time_ns - self._first_host_ns)

    def _flush_when_due(self) -> None:
        if self._now() - self._flushed >= SETTINGS.flush_s:
            self.flush()

    def _sync(self) -> None:
        self._file.flush()
        os.fsync(self._file.fileno())
        self._flushed = self._synced = self._now()

    def _close(self, end: dict[str, str]) -> None:
        with self.disk():
            self._mcap.flush()
            self._mcap.add_metadata(END, sealed(end))
            self._mcap.finish()
            self._sync()
            for file in self._files:
                file.close()
            self._open = False
            if self._part is None:
                write_sidecar(self.path)

    @contextmanager
    def disk(self) -> Iterator[None]:
        """Provide a context for writes of this recording, to this or to another file.

        After an error, the run file is closed without its end.

        Raises:
            RunError: a write failed, now or earlier. The message names the run file and the command that recovers it.
        """
        if self._failure is not None:
            raise self._failure
        if not self._open:
            raise ValueError(f"{self.path} is closed: a finished run cannot be changed")
        try:
            yield
        except OSError as error:
            self._close_unfinished()
            self._failure = RunError(
                f"{self.path}: cannot be written: {error.strerror}; {self.samples_written} samples were"
                f" received, the file is kept: free some disk space, then run"
                f" `dpr-lab run recover {in_command(self.path)} --out NEW_FILE`"
            )
            raise self._failure from error
        except BaseException:
            # Ctrl-C in the middle of a chunk: continuing could write the chunk twice, whereas ending the file only
            # loses it.
            self._close_unfinished()
            raise

    def _close_unfinished(self) -> None:
        self._open = False
        for file in self._files:
            with suppress(OSError):
                file.close()


def _create(path: Path) -> BufferedWriter:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{path.parent}: this folder cannot be created: {error.strerror}") from error
    try:
        return path.open("xb")
    except FileExistsError as error:
        raise exists_already(path) from error
    except OSError as error:
        raise RunError(f"{path}: cannot be created: {error.strerror}") from error


def exists_already(path: Path) -> RunError:
    """Create the error for a file name that is already in use."""
    return RunError(f"{path}: exists already; a run is never overwritten, choose another name")


def _by_kind(torques: ArrayLike | None) -> Array:
    return np.zeros((0, 0, 2)) if torques is None else np.asarray(torques, dtype=np.float64)

"""Inspect run files: show metadata, verify integrity, and recover damaged files."""

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dpr_lab.errors import RunError, printable
from dpr_lab.rig import Rig
from dpr_lab.storage.layout import INTERRUPTED, SAMPLES, TORQUE_KEYS
from dpr_lab.storage.metadata import RunSummary
from dpr_lab.storage.reader import arm_mode, inner_mode, lost_by_gaps, refuse_other_encoders, release_row, run_of
from dpr_lab.storage.row_text import Samples
from dpr_lab.storage.scan import Scan, no_such_file, scan, stored_messages
from dpr_lab.storage.sidecar import read_note, read_sidecar, sidecar_of
from dpr_lab.storage.whole_run import whole_run

NOT_COPIED = "channels of other programs, not copied: "
"""Start of the note on channels that `recover` omitted."""


@dataclass(frozen=True, slots=True)
class RunInfo:
    """Metadata of a run file, for a table or JSON."""

    file: str
    sha256: str
    size_bytes: int
    complete: bool
    damage: str
    """Reason why reading stopped; empty if the file is complete."""
    stopped: str
    """Reason why the recording ended early; empty if it did not end early."""
    samples: int
    duration_s: float
    """Time from the release to the last sample, s; from the first sample if there is no release."""
    rate_hz: float
    gaps: int
    """Number of intervals of the time axis in which at least one sample is missing."""
    longest_gap_s: float
    lost: Mapping[str, int]
    release_tick: int | None
    pose: str | None
    pose_rad: tuple[float, ...] | None
    pose_measured_rad: tuple[float, ...] | None
    gate: str
    gate_figures: Mapping[str, float]
    clock: Mapping[str, float]
    mounted: str
    elbow: str
    arm: str
    """Mode of the arm in this run: clamped, free, prescribed or driven."""
    inner: str
    """Mode of joint 1 in this run: free or prescribed."""
    input: str
    """Kind and quantity of the input of a driven arm, such as `measured voltage`; empty for other modes of the arm."""
    rig: str
    rig_sha256: str
    source: str
    url: str
    firmware: str
    uid: str
    protocol: str
    schema_hash: str
    versions: Mapping[str, str]
    created_utc: str
    """Creation time of the file. For an imported table this is the time of the import, not of the recording."""
    recorded_utc: str
    """Time of the recording as ISO 8601 date, or date and time; empty if the import does not state it."""
    note: str
    notes: tuple[str, ...]
    extra: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Verification:
    """Result of the integrity check of a run file; `faults` contains all reasons."""

    ok: bool
    faults: list[str]
    interrupted: str = ""
    """Reason why the recording ended early; empty if it is complete."""


def unchanged(interrupted: str) -> str:
    """Return the text for an unchanged file.

    `interrupted` is the reason why the recording ended early; it is empty for a complete recording.
    """
    return f"unchanged; {interrupted}" if interrupted else "complete and unchanged"


def info(path: Path | str) -> RunInfo:
    """Describe a run file.

    Damaged files and files without a release are accepted.

    Raises:
        RunError: the file is not a run, or is damaged before its first sample.
    """
    stored = scan(Path(path))
    samples, meta = stored.samples(), stored.metadata
    summary = _summary(stored, samples)
    steps = np.diff(samples.t)
    gaps = steps[steps > 1.5 / meta.rate_hz]
    return RunInfo(
        file=str(stored.path),
        sha256=stored.sha256,
        size_bytes=stored.size_bytes,
        complete=stored.complete,
        damage=stored.damage,
        stopped=stored.interrupted,
        samples=len(samples.ticks),
        duration_s=_duration(stored, samples),
        rate_hz=meta.rate_hz,
        gaps=len(gaps),
        longest_gap_s=float(gaps.max(initial=0.0)),
        lost=summary.lost,
        release_tick=summary.release_tick,
        pose=meta.pose,
        pose_rad=tuple(meta.rig.poses[meta.pose].theta.tolist()) if meta.pose is not None else None,
        pose_measured_rad=summary.pose_measured,
        gate=summary.gate,
        gate_figures=summary.gate_figures,
        clock=summary.clock,
        mounted=meta.rig.rods.mounted,
        elbow=meta.rig.rods.elbow,
        arm=arm_mode(stored),
        inner=inner_mode(stored),
        input=_input(stored),
        rig=meta.rig.name,
        rig_sha256=stored.rig_sha256,
        source=meta.source,
        url=meta.url,
        firmware=meta.firmware,
        uid=meta.uid,
        protocol=meta.protocol,
        schema_hash=meta.schema_hash,
        versions=meta.versions,
        created_utc=meta.created_utc,
        recorded_utc=meta.recorded_utc,
        note=read_note(stored.path, meta.note),
        notes=summary.notes,
        extra=meta.extra,
    )


def _input(stored: Scan) -> str:
    """Return the kind and quantity of the input of a driven arm; the text is empty for any other arm."""
    motor = stored.metadata.rig.motor
    if arm_mode(stored) != "driven" or motor is None:
        return ""
    extra = stored.metadata.extra
    return f"{extra.get('torque_kind', extra.get('input_kind', ''))} {motor.input}".strip()


def holds_both_torques(path: Path) -> bool:
    """Check whether a run contains both measured and commanded torques.

    Only the first sample is checked. The result is False if the file is unreadable.
    """
    try:
        with closing(stored_messages(path)) as messages:
            first = next((message.data for message in messages if message.topic == SAMPLES), b"")
    except RunError:
        return False
    return f'"{TORQUE_KEYS[1]}"'.encode() in first


def verify(path: Path | str) -> Verification:
    """Verify hash and CRCs of a run file, and number and order of its samples.

    Raises:
        RunError: there is no such file.
    """
    path = Path(path)
    if not path.exists():
        raise no_such_file(path)
    try:
        stored = scan(path)
        faults = _faults(stored)
    except RunError as error:
        return Verification(ok=False, faults=[str(error).removeprefix(f"{path}: ")])
    return Verification(ok=not faults, faults=faults, interrupted=stored.interrupted)


def recover(path: Path | str, out: Path | str, rig: Rig | None = None) -> int:
    """Write the valid part of a damaged run to a new, undamaged run file.

    The new file states where and why the recording was interrupted, and which channels of other programs it lacks. The
    damaged file is not changed.

    Args:
        path: the damaged file
        out: the file to write, which must not exist
        rig: corrected description of the rig; None keeps the rig of the run

    Returns:
        Number of recovered samples.

    Raises:
        RunError: no sample is readable, `out` cannot be written, or the rig does not describe the recording.
    """
    stored = scan(Path(path))
    samples = stored.samples()
    recovered = len(samples.ticks)
    if not recovered:
        raise RunError(f"{path}: contains no readable sample, so nothing can be recovered: record again")
    origin = {"recovered_from": stored.path.name, "recovered_from_sha256": stored.sha256}
    summary = _summary(stored, samples)
    if interruption := _interruption(stored, samples):
        origin[INTERRUPTED] = interruption
    notes = (*summary.notes, f"recovered from {stored.path.name}, {recovered} samples kept")
    metadata = replace(stored.metadata, extra={**stored.metadata.extra, **origin})
    if rig is not None:
        refuse_other_encoders(stored, rig)
        if metadata.pose not in (None, *rig.poses):
            raise RunError(f"{path}: was released from the pose {metadata.pose}, which the rig file does not contain")
        _refuse_fixed(stored, samples, rig)
        metadata = replace(metadata, rig=rig)
        run_of(replace(stored, metadata=metadata))  # the new run must be readable
        notes += ("the description of the rig was corrected after the recording",)
    with whole_run(out, metadata) as writer:
        if omitted := writer.copy(stored_messages(stored.path)):
            notes += (_not_copied(omitted),)
        writer.finish(replace(summary, notes=notes))
    return recovered


def _not_copied(channels: set[str], listed: int = 5, longest: int = 60) -> str:
    """State which channels of other programs were not copied.

    At most `listed` channels are named, each with at most `longest` characters.
    """
    names = [printable(repr(channel[:longest])) for channel in sorted(channels)[:listed]]
    more = f" and {len(channels) - listed} more" if len(channels) > listed else ""
    return f"{NOT_COPIED}{', '.join(names)}{more}"


def _refuse_fixed(stored: Scan, samples: Samples, rig: Rig) -> None:
    """Check that a corrected rig differs only in values that have an effect on the run.

    A table contains angles instead of counts, and a run may state the modes of arm and inner rod itself.

    Raises:
        RunError: the rig has another zero or mode, which would have no effect.
    """
    old, extra = stored.metadata.rig, stored.metadata.extra
    fixed = {
        "zero_counts": samples.counts is None and rig.encoders.zero_counts != old.encoders.zero_counts,
        "arm.mode": "arm" in extra and rig.arm.mode not in (old.arm.mode, arm_mode(stored)),
        "joints.inner": "inner" in extra and rig.joints.inner not in (old.joints.inner, inner_mode(stored)),
    }
    if any(fixed.values()):
        again = "import the table" if stored.metadata.source == "import" else "record"
        raise RunError(
            f"{stored.path}: another {' or '.join(key for key in fixed if fixed[key])} in the rig file has no effect on"
            f" a copy of this run: {again} again with this rig file"
        )


def _interruption(stored: Scan, samples: Samples) -> str:
    """State where and why a recording ended early; empty for a complete file."""
    if earlier := stored.metadata.extra.get(INTERRUPTED):
        return earlier
    if stored.stopped or stored.summary is None:
        reason = stored.stopped or f"the file is {stored.damage or 'without an end record'}"
    elif stored.samples_announced != len(samples.ticks):
        reason = f"only {len(samples.ticks)} of {stored.samples_announced} recorded samples are readable"
    else:
        return ""
    untimed = stored.release_tick is None and stored.metadata.time_source == "ticks"
    origin = "the first sample, before the release" if untimed else "the release"
    return f"interrupted {_duration(stored, samples):.3f} s after {origin}: {reason}"


def _summary(stored: Scan, samples: Samples) -> RunSummary:
    summary = stored.summary or RunSummary(lost=lost_by_gaps(stored, samples), clock=stored.newest_clock)
    return replace(summary, release_tick=stored.release_tick)


def _duration(stored: Scan, samples: Samples) -> float:
    if not len(samples.t):
        return 0.0
    release = stored.release_tick
    if stored.metadata.time_source == "table":
        start = samples.t[release_row(release, samples.ticks)]
    else:
        start = samples.t[0] if release is None else release / stored.metadata.rate_hz
    return float(samples.t[-1] - start)


def _faults(stored: Scan) -> list[str]:
    faults = _hash_faults(stored)
    if stored.damage:
        faults.append(f"the file is {stored.damage}")
    if stored.stopped:
        faults.append(f"the recording was not completed: {stored.stopped}")
    elif stored.summary is None:
        faults.append("the recording was not completed: the file has no end record")
    samples = len(stored.samples().ticks)
    announced = {"end record": stored.samples_announced, "MCAP statistics": stored.samples_counted}
    faults += [
        f"{samples} samples, but the {name} states {n}" for name, n in announced.items() if n not in (None, samples)
    ]
    return faults


def _hash_faults(stored: Scan) -> list[str]:
    written, sidecar = read_sidecar(stored.path), sidecar_of(stored.path).name
    if written is None:
        return [f"there is no {sidecar} in its folder"]
    if written != stored.sha256:
        return [
            f"its SHA-256 {stored.sha256} differs from the hash in {sidecar}: the file was changed after it was"
            " finished"
        ]
    return []

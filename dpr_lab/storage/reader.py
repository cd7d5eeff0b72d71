"""Read a complete or damaged run file as a `Run`."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import prescribed_arm, prescribed_inner
from dpr_lab.estimation.held_rods import free_part_of
from dpr_lab.estimation.usable_runs import refuse_other_rig
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import ArmMode, InnerMode
from dpr_lab.run import FilmNoise, Run, as_mounted
from dpr_lab.storage.metadata import RunMetadata, numbers
from dpr_lab.storage.row_text import Samples
from dpr_lab.storage.samples import STRANGE, json_object
from dpr_lab.storage.scan import Scan, scan
from dpr_lab.storage.sidecar import read_sidecar

# Encoder zeros and noise may differ between runs of the same rig, so they are not compared.
_SAME_ENCODERS = ("counts_per_rev", "joint2", "direction")
_RECORDED = ("added_mass.", "rods.", "arm.mode", "joints.inner", "encoders.zero_counts")
"""Keys of a rig file that describe one recording. They are always taken from the run."""
Mode = TypeVar("Mode", bound=str)


def load_run(path: Path | str, rig: Rig | None = None, verify: bool = True) -> Run:
    """Read a run.

    The time is t = (tick - release tick) / rate; for an imported table, it is the time column. The angles are computed
    from the counts with the encoders of the rig stored in the file. A rod may have been raised in either direction.
    Therefore full turns are removed from theta1 and theta2, so that each rod lies within pi of the requested pose at
    the release.

    If the file was cut or damaged, the samples before the damage are returned. The run then has `complete` False and a
    note.

    Args:
        path: the run file
        rig: the rig to which the run should belong: its name and encoders must be those of the run. Other values may
            have been corrected since the recording; notes of the run list the differences.
        verify: whether to compare the file with the hash that was written when the file was finished

    Raises:
        RunError: the file is not a run, is not readable, has no release, was changed after the recording, or belongs to
            another rig.
    """
    stored = scan(Path(path))
    if verify:
        _check_hash(stored)
    if rig is None:
        return run_of(stored)
    refuse_other_encoders(stored, rig)
    run = run_of(stored)
    return replace(run, notes=(*run.notes, *_corrections(stored, rig)))


def run_of(stored: Scan) -> Run:
    """Convert the content of a run file or of a table to a run.

    `load_run` lists the errors.
    """
    samples, path = stored.samples(), str(stored.path)
    if not len(samples.ticks):
        raise RunError(f"{path}: contains no samples{_because(stored)}")
    t = _time(stored, samples)
    recorded_rig = stored.metadata.rig
    theta = samples.theta if samples.counts is None else recorded_rig.theta(samples.counts)
    theta = theta - full_turns(recorded_rig, stored.metadata.pose, t, theta)
    summary = stored.summary
    torques, commanded = _torques(samples)
    mode = arm_mode(stored)
    arm_input = commanded_input = None
    if mode == "driven":
        if torques is None:
            raise RunError(
                f"{path}: its arm is driven, but the run contains no input of the arm: start the motor's program and"
                " record again, or import the table with its input"
            )
        arm_input, commanded_input = torques[:, 0], None if commanded is None else commanded[:, 0]
        torques = commanded = None
    driven, extra = torques is not None or arm_input is not None, stored.metadata.extra
    run = Run(
        name=stored.path.stem,
        t=t,
        theta=as_mounted(np.ascontiguousarray(theta), recorded_rig.rods.mounting, path),
        mounting=recorded_rig.rods.mounting,
        counts=samples.counts,
        torques=torques,
        commanded=commanded,
        torque_kind=extra.get("torque_kind", extra.get("input_kind", "")) if driven else "",
        input_delay_s=_delay(stored),
        arm=prescribed_arm(t, theta[:, 0], recorded_rig, path) if mode == "prescribed" else None,
        arm_mode=mode,
        inner=prescribed_inner(t, theta[:, 1], path) if inner_mode(stored) == "prescribed" else None,
        arm_input=arm_input,
        commanded_input=commanded_input,
        pose=stored.metadata.pose,
        rig_name=recorded_rig.name,
        rig_sha256=stored.rig_sha256,
        rate_hz=stored.metadata.rate_hz,
        added_mass=recorded_rig.added_mass,
        complete=stored.complete,
        clock=clock_of(stored),
        lost=dict(summary.lost) if summary is not None else lost_by_gaps(stored, samples),
        file=stored.path,
        sha256=stored.sha256,
        recorded_utc=stored.metadata.recorded_utc,
        notes=(*(summary.notes if summary is not None else ()), *_what_happened(stored), *_degraded(stored)),
        **of_a_table(stored.metadata),
    )
    return released(run) if run.keep_rest is False and t[0] == 0 else run


TABLES = "options", "columns", "film_noise"
"""Keys in `RunMetadata.extra` of an import whose values are JSON objects."""


def of_a_table(metadata: RunMetadata) -> dict[str, Any]:
    """Return the fields of a `Run` that only imported tables have, such as `keep_rest` and `film_noise`."""
    if metadata.time_source != "table":
        return {}
    options, columns, film = (stored_object(metadata.extra.get(key, "")) for key in TABLES)
    return {
        "keep_rest": options.get("keep_rest") is True,
        "continuous": options.get("intersample") == "continuous",
        "arm_read": not columns or "theta0" in columns,
        "film_noise": _film_noise(film),
        "at_edges": metadata.extra.get("at_edges") == "true",
    }


def _film_noise(stored: dict[str, Any]) -> FilmNoise | None:
    try:
        std, correlation = tuple(float(value) for value in stored["std"]), float(stored["correlation"])
    except (KeyError, TypeError, ValueError):
        return None
    valid = 1 <= len(std) <= 2 and all(0.0 < value < np.inf for value in std) and 0.0 <= correlation < 1.0
    return FilmNoise(std, correlation) if valid else None


def stored_object(text: str) -> dict[str, Any]:
    """Parse a JSON object in the metadata; return an empty object for an invalid text."""
    try:
        return json_object(text.encode())
    except STRANGE:
        return {}


def released(run: Run) -> Run:
    """Return the free swing of an imported run, without the parts in which the rods are held.

    If this part cannot be determined, the whole run is returned. `dpr_lab.estimation.held_rods.refuse_held` raises the
    error with the reason.
    """
    try:
        part = free_part_of(run)
    except RunError:
        return run
    if (part.start, part.stop) == (0, len(run.t)):
        return run
    release, last = float(run.t[part.start]), float(run.t[part.stop - 1])
    cut = run.between(float(run.t[part.rest]), np.nextafter(last, np.inf))
    arm = None if run.arm is None else replace(run.arm, t=run.arm.t - release)
    inner = None if run.inner is None else replace(run.inner, t=run.inner.t - release)
    note = f"the rods are held until {release:.4g} s" if part.start else ""
    note += f"{' and ' if note else ''}{'after' if note else 'the rods are held after'} {last:.4g} s" * (
        part.stop < len(run.t)
    )
    return replace(cut, t=cut.t - release, arm=arm, inner=inner, notes=(*run.notes, f"{note}: excluded from the swing"))


def _torques(samples: Samples) -> tuple[Array | None, Array | None]:
    """Return torques (n, 2) and commanded torques (n, 2) of the samples, N m.

    The torques are None if there are no drives. The commanded torques are None unless both kinds are known.
    """
    if not any(torques.any() for torques in samples.torques):
        return None, None
    first, *second = samples.torques
    return first, second[0] if second else None


def arm_mode(stored: Scan) -> ArmMode:
    """Return the mode of the arm in a run, or in its rig if the run states none.

    If the rig has a driven arm and the run states no mode, the arm counts as prescribed. A device may send only the
    angle of the arm.

    Raises:
        RunError: the mode is unknown.
    """
    of_rig = stored.metadata.rig.arm.mode
    return _mode(stored, "arm", "prescribed" if of_rig == "driven" else of_rig, get_args(ArmMode), "arm")


def inner_mode(stored: Scan) -> InnerMode:
    """Return the mode of the inner rod in a run, or in its rig if the run states none.

    Raises:
        RunError: the mode is unknown.
    """
    return _mode(stored, "inner", stored.metadata.rig.joints.inner, get_args(InnerMode), "inner rod")


def _mode(stored: Scan, key: str, default: Mode, modes: tuple[Mode, ...], what: str) -> Mode:
    stated = stored.metadata.extra.get(key, default)
    for mode in modes:
        if mode == stated:
            return mode
    raise RunError(
        f"{stored.path}: its {what} is {stated!r}, which this version of dpr-lab does not know: update dpr-lab"
    )


def _delay(stored: Scan) -> float:
    """Read the stored delay between logging and action of a torque, s.

    The stored value is checked, because it is text.
    """
    try:
        delay = float(stored.metadata.extra.get("input_delay_s", 0.0))
    except ValueError:
        delay = np.nan
    if not np.isfinite(delay):
        raise RunError(f"{stored.path}: its input_delay_s is not a number: import the table again")
    return delay


def clock_of(stored: Scan) -> dict[str, float]:
    """Return the last clock fit of a run; empty if there is none.

    The fit in the end record is preferred to those during the recording.
    """
    clock = stored.summary.clock if stored.summary is not None and stored.summary.clock else stored.newest_clock
    return numbers(clock)


def stored_rig(path: Path | str) -> Rig:
    """Return the rig that is stored in a run file.

    Raises:
        RunError: the file is not a run.
    """
    return scan(Path(path)).metadata.rig


def lost_by_gaps(stored: Scan, samples: Samples) -> dict[str, int]:
    """Return the number of lost samples by cause, from the ticks alone, for a file without an end record."""
    return {"tick_gap": samples.missing} if stored.metadata.time_source == "ticks" else {}


def _time(stored: Scan, samples: Samples) -> Array:
    if stored.metadata.time_source == "table":
        return samples.t - samples.t[release_row(stored.release_tick, samples.ticks)]
    release = stored.release_tick
    if release is None:
        raise RunError(
            f"{stored.path}: has no release: the latch was not opened during the recording{_because(stored)}"
        )
    if release > samples.ticks[-1]:
        raise RunError(f"{stored.path}: ends at tick {samples.ticks[-1]}, before the release at tick {release}")
    return (samples.ticks - release) / stored.metadata.rate_hz


def release_row(release: int | None, ticks: Integers) -> int:
    """Return the row of an imported table at which the rods were released.

    The result is the first row if the file contains no release, or a tick that is not in the table.
    """
    row = 0 if release is None else int(np.searchsorted(ticks, release))
    return row if row < len(ticks) and ticks[row] == release else 0


def full_turns(rig: Rig, pose: str | None, t: Array, theta: Array) -> Array:
    """Return the full turns (3,), rad, to subtract from the angles of arm, inner and outer rod.

    After subtraction, each rod lies within pi of the pose at t = 0. The result is zero if the run has no pose. Full
    turns between recordings are then kept, because they may indicate a wrong number of counts per turn.
    """
    turns = np.zeros(3)
    if pose is not None:
        difference = theta[np.argmin(np.abs(t))] - rig.poses[pose].theta
        turns[1:] = 2 * np.pi * np.round(difference[1:] / (2 * np.pi))
    return turns


def _check_hash(stored: Scan) -> None:
    written = read_sidecar(stored.path)
    if written is not None and written != stored.sha256:
        raise RunError(
            f"{stored.path}: has changed since it was finished (its SHA-256 differs from the hash in the .sha256"
            " file): restore it from a copy, or recover its valid part with `dpr-lab run recover`"
        )


def refuse_other_encoders(stored: Scan, rig: Rig) -> None:
    """Check that name and encoders of a rig are those of the rig in a run.

    Raises:
        RunError: the run belongs to another rig, or its counts have another meaning.
    """
    recorded_rig = stored.metadata.rig
    refuse_other_rig(stored.path, recorded_rig.name, rig.name)
    pairs = [
        (f"encoders.{key}", getattr(recorded_rig.encoders, key), getattr(rig.encoders, key)) for key in _SAME_ENCODERS
    ]
    differing = [
        f"{key} is {stored} in the run, {given} in the rig file" for key, stored, given in pairs if stored != given
    ]
    if differing:
        imported = stored.metadata.source == "import"
        instead = "import the table again with this rig file" if imported else "record again with this rig file"
        raise RunError(
            f"{stored.path}: is a run of another rig: {'; '.join(differing)}; give the rig file that was used for the"
            f" {'import' if imported else 'recording'}, {instead}, or leave this run out"
        )


def _corrections(stored: Scan, given: Rig) -> list[str]:
    """Return notes on values that differ between the rig in a run and a rig file that was corrected later.

    Poses and the link describe future recordings and are not compared.
    """
    old, new = _flat(stored.metadata.rig.model_dump()), _flat(given.model_dump())
    modes = {"arm.mode": arm_mode(stored), "joints.inner": inner_mode(stored)}
    old |= {key: mode for key, mode in modes.items() if new[key] != old[key]}
    differing = {
        key: f"{key} = {new.get(key, 'none')} (in the run: {old.get(key, 'none')})"
        for key in {**old, **new}
        if new.get(key) != old.get(key) and not key.startswith(("link.", "poses."))
    }
    ignored = [text for key, text in differing.items() if key.startswith(_RECORDED)]
    used = [text for key, text in differing.items() if not key.startswith(_RECORDED)]
    notes = [f"uses the corrected description of the rig: {', '.join(used)}"] if used else []
    if ignored:
        notes.append(
            f"ignored in the rig file, taken from the recording: {', '.join(ignored)}; if the recording states a wrong"
            " value, write a corrected copy by `dpr-lab run recover --rig`"
        )
    return notes


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the values of nested tables by their keys in the rig file, without missing values."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        elif value is not None:
            flat[f"{prefix}{key}"] = value
    return flat


def _what_happened(stored: Scan) -> list[str]:
    early = f"stopped early: {stored.stopped}" if stored.stopped else stored.interrupted
    reasons = [f"recording {early}"] if early else []
    return reasons + ([f"file {stored.damage}"] if stored.damage else [])


def _degraded(stored: Scan) -> list[str]:
    """Return a note if the quality gate marked the recording as degraded."""
    gate = stored.summary.gate if stored.summary is not None else ""
    return [f"the quality gate marked this recording as {gate}"] if gate.startswith("degraded") else []


def _because(stored: Scan) -> str:
    reasons = _what_happened(stored)
    return f" ({'; '.join(reasons)})" if reasons else ""

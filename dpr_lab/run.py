"""Run: one recorded release, or one imported table."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.errors import RunError
from dpr_lab.rig_tables import AddedMass, ArmMode, Mounting
from dpr_lab.setup import ArmMotion, Setup, Torques, inner_torques
from dpr_lab.shown import Shown

LOSS_CAUSES = ("device_overrun", "crc", "framing", "contradicted", "contradicted_position", "tick_gap")
"""Causes of missing or wrong samples. `device_overrun`: the device was too slow. `crc`, `framing`: the sample was
damaged on the link. `contradicted`: two values arrived for one tick. `contradicted_position`: a message with the
complete count of a joint contradicted the samples; none is missing, but some angles before it are wrong. `tick_gap`:
the sample never arrived. Devices with drives also have the cause `torque`: the torques of the sample never arrived."""

LOSS_WORDS = {
    "device_overrun": "device too slow",
    "crc": "damaged",
    "framing": "cut short",
    "contradicted": "contradictory",
    "contradicted_position": "wrong counts",
    "tick_gap": "never arrived",
    "torque": "without torques",
}
"""Name of each cause for readers; at most 16 characters, so that it fits on the screen."""


@dataclass(frozen=True, slots=True)
class FilmNoise:
    """Noise of video angles, estimated from the scatter of the rod lengths in the picture."""

    std: tuple[float, ...]
    """Standard deviation of the absolute angle of each tracked rod, rad."""
    correlation: float
    """Autocorrelation of the errors of neighbouring frames."""


@dataclass(frozen=True, slots=True, repr=False)
class Run(Shown):
    """One recorded release.

    Time is device time, t = (tick - release tick) / rate, or the time of an imported table. The release is at t = 0. At
    samples with t < 0 the rods are at rest. Missing samples are absent from `t`; nothing is resampled.
    """

    name: str
    """Short name for tables and figures: by default, the name of the file without its extension."""
    t: Array
    """(n,) device time since the release, s, strictly increasing."""
    theta: Array
    """(n, 3) measured absolute angles of arm, inner and outer rod, rad; 0 = upright, pi = hanging."""
    counts: Integers | None
    """(n, 3) unwrapped position counts; None for an imported table of angles."""
    pose: str | None
    """Name of the requested pose; None if no pose was requested."""
    rig_name: str
    """Name of the rig."""
    rig_sha256: str
    """SHA-256 of the rig file; empty for a rig created in memory."""
    rate_hz: float
    """Nominal sample rate, Hz; `t` contains the actual times of the samples."""
    added_mass: AddedMass | None = None
    """Known mass that was attached; None if no mass was attached."""
    mounting: Mounting = "both"
    """Mounted rods; for a single rod theta2 equals theta1."""
    torques: Array | None = None
    """(n, 2) known torques of joints 1 and 2, N m, each held until the next sample; None for a free swing."""
    torque_kind: str = ""
    """Kind of `torques` or `arm_input`: `measured` or `commanded`; empty if unknown."""
    commanded: Array | None = None
    """(n, 2) commanded torques, N m, if they are known in addition to the measured ones in `torques`; otherwise
    None."""
    input_delay_s: float = 0.0
    """Known delay from the logged to the acting torque, s."""
    continuous: bool = False
    """Whether known torques and inputs are samples of a continuous signal; otherwise each value is held until the next
    sample."""
    arm: ArmMotion | None = None
    """Motion of the arm if it is prescribed; None if it was clamped, free or driven."""
    arm_mode: ArmMode = "clamped"
    """Mode of the arm."""
    inner: ArmMotion | None = None
    """Motion of the inner rod if joint 1 is prescribed; None for a free inner rod."""
    arm_input: Array | None = None
    """(n,) input of a driven arm in the unit of `[motor]` in the rig file, each value held until the next sample; None
    without a drive."""
    commanded_input: Array | None = None
    """(n,) commanded input of the arm, if it is known in addition to the measured one in `arm_input`; otherwise
    None."""
    complete: bool = True
    """Whether the recording was completed; False if it was interrupted or stopped, even if its file was recovered."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Number of samples lost, by cause (`LOSS_CAUSES`)."""
    clock: Mapping[str, float] = field(default_factory=dict)
    """Rate of the device's clock relative to the host's clock, parts per million: from PING and PONG (`rate_ppm`,
    `rate_ppm_std`, ...) and from the arrival times of its samples (`arrival_ppm`, `arrival_margin_ppm`). Empty if
    neither is known."""
    file: Path | None = None
    """Run file or table from which the run was read; None for a run created in memory."""
    sha256: str = ""
    """SHA-256 of `file`, or of the readings of a table that was imported in memory; empty otherwise."""
    recorded_utc: str = ""
    """Time of recording, ISO 8601 date, or date and time; empty if unknown."""
    keep_rest: bool | None = None
    """For an imported table: whether all rows count as a swing, even if the rods seem to be held at first. None for a
    recording by a device, which reports the release.
    """
    arm_read: bool | None = None
    """For an imported table: whether it contains the angle of the arm. None for a recording by a device."""
    film_noise: FilmNoise | None = None
    """Noise of the angles, for a table of points in a video; otherwise None."""
    at_edges: bool = False
    """Whether the table has one row per encoder edge, so that each angle is exactly at the edge between two counts."""
    notes: tuple[str, ...] = ()
    """Notes of the reader or importer for the operator, for example on interruptions or on removed rows."""

    def _heading(self) -> str:
        pose = f", pose {self.pose}" if self.pose else ""
        incomplete = "" if self.complete else ", not complete"
        length = f"{len(self.t)} samples at {self.rate_hz:g} Hz, {self.duration:.3g} s of swing"
        return f"Run {self.name} of rig {self.rig_name}{pose}: {length}{incomplete}"

    @property
    def elbow(self) -> float:
        """Angle theta2 - theta1 of a clamped elbow, rad; otherwise zero."""
        clamped = self.mounting == "clamped" and len(self.t)
        return float(np.median(self.theta[:, 2] - self.theta[:, 1])) if clamped else 0.0

    def driven_by(self, kind: str | None) -> Run:
        """Return a copy that contains only measured, or only commanded, torques or inputs.

        Args:
            kind: `measured` or `commanded`; None: the run is returned unchanged

        Raises:
            RunError: the run has no torques or inputs of that kind.
        """
        if kind is None or (self.torques is None and self.arm_input is None):
            return self
        alone = {"torque_kind": kind, "commanded": None, "commanded_input": None}
        if kind == "commanded" and self.commanded is not None:
            return replace(self, torques=self.commanded, **alone)
        if kind == "commanded" and self.commanded_input is not None:
            return replace(self, arm_input=self.commanded_input, **alone)
        if kind != self.torque_kind:
            known = self.torque_kind or "unspecified"
            which = (
                f"torques, only {known} torques" if self.arm_input is None else f"arm input, only a {known} arm input"
            )
            raise RunError(f"{self.file or self.name}: contains no {kind} {which}: remove the option --torque")
        return replace(self, **alone)

    @property
    def both_kinds(self) -> bool:
        """Whether both measured and commanded torques, or inputs of the arm, are known."""
        return self.commanded is not None or self.commanded_input is not None

    @property
    def setup(self) -> Setup:
        """Mounting and known inputs of the run."""
        drives = None
        if self.torques is not None:
            drives = self.between_rows(Torques(self.t + self.input_delay_s, self.torques, self.torque_kind))
        if self.inner is not None:
            drives = inner_torques(self.inner)
        return Setup(self.mounting, self.added_mass, round(self.elbow, 1), drives, self.arm, self.inner)

    def between_rows(self, torques: Torques) -> Torques:
        """Interpolate torques between rows if they are samples of a continuous signal; otherwise change nothing."""
        return torques.as_samples() if self.continuous and len(torques.t) > 1 else torques

    @property
    def rest(self) -> Array:
        """Angles (m, 3) before the release, rad; m = 0 if none were recorded."""
        return self.theta[self.t < 0]

    @property
    def swing(self) -> Run:
        """The part of the run from the release on."""
        return self.only(self.t >= 0)

    @property
    def duration(self) -> float:
        """Time from release to the last sample, s."""
        return float(self.t[-1]) if len(self.t) else 0.0

    def between(self, start: float, stop: float) -> Run:
        """Return the part with start <= t < stop, s; the times are not shifted."""
        return self.only((self.t >= start) & (self.t < stop))

    @property
    def readings_sha256(self) -> str:
        """Hash of all data that a fit uses, equal for repeated imports of a table."""
        unread = ("name", "file", "sha256", "recorded_utc", "keep_rest", "arm_read", "notes")
        digest = hashlib.sha256()
        if self.arm_mode not in ("free", "driven"):
            unread += ("arm_mode", "arm_input")
        if self.commanded_input is None:
            unread += ("commanded_input",)
        if self.inner is None:
            unread += ("inner",)
        if not self.continuous:
            unread += ("continuous",)
        if not self.at_edges:
            unread += ("at_edges",)
        for member in fields(self):
            if member.name not in unread:
                digest.update(f"{member.name}=".encode())
                for part in _flat(getattr(self, member.name)):
                    digest.update(_bytes(part))
        return digest.hexdigest()

    @property
    def angles_sha256(self) -> str:
        """Hash of times and angles; two runs of the same recording have the same hash."""
        return hashlib.sha256(_bytes(self.t) + _bytes(self.theta)).hexdigest()

    def only(self, keep: Flags) -> Run:
        """Return a copy with only the samples of the mask `keep` (n,)."""
        names = ("t", "theta", "counts", "torques", "commanded", "arm_input", "commanded_input")
        return replace(self, **{name: rows[keep] for name in names if (rows := getattr(self, name)) is not None})


def as_runs(runs: Run | Iterable[Run]) -> tuple[Run, ...]:
    """Return one or several runs as a tuple.

    Raises:
        RunError: a file name is given instead of a run.
    """
    as_given: tuple[Any, ...] = (runs,) if isinstance(runs, Run | str | Path) else tuple(runs)
    for run in as_given:
        if isinstance(run, str | Path):
            raise RunError(f"{run}: is the name of a file, not a run: read the file with load_run")
    return as_given


def with_distinct_names(runs: Iterable[Run]) -> tuple[Run, ...]:
    """Make the names of runs unique by appended numbers.

    Results are listed by the name of the run.
    """
    named: dict[str, Run] = {}
    for run in runs:
        numbered = (f"{run.name} ({i})" for i in count(2))
        name = next(name for name in chain([run.name], numbered) if name not in named)
        named[name] = run if name == run.name else replace(run, name=name)
    return tuple(named.values())


def moves(runs: Iterable[Run]) -> bool:
    """Return whether the arm was free or driven in any of the runs."""
    return any(run.arm_mode in ("free", "driven") for run in runs)


def truncation(names: Iterable[str]) -> list[str]:
    """Return a warning with the names of truncated recordings; the list is empty if there are none."""
    truncated = ", ".join(dict.fromkeys(names))
    warning = "truncated recordings, used up to their interruption (`dpr-lab run verify` states its cause)"
    return [f"{warning}: {truncated}"] if truncated else []


def torque_kinds(runs: Iterable[Run]) -> tuple[str, ...]:
    """Return the kinds of known torques in these runs."""
    return tuple(sorted({run.torque_kind for run in runs if run.torques is not None} - {""}))


def _flat(value: Any) -> Iterator[Any]:
    """Yield the numbers, texts and arrays within nested dataclasses, tuples and mappings."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {member.name: getattr(value, member.name) for member in fields(value)}
    if isinstance(value, Mapping):
        value = tuple(sorted(value.items()))
    if isinstance(value, tuple):
        for part in value:
            yield from _flat(part)
    else:
        yield value


def _bytes(part: Any) -> bytes:
    if isinstance(part, np.ndarray):
        return f"{part.dtype.str}{part.shape}".encode() + part.tobytes()
    return f"{part!r};".encode()


@dataclass(frozen=True, slots=True)
class MountingSettings:
    """Thresholds for readings that contradict the specified mounting."""

    still: float = 0.1
    """Maximum range of joint 2 with a clamp, of an encoder without a rod, and of a clamped arm, rad. Backlash, the drag
    of a bearing and a mount that yields cause smaller ranges."""
    tail: float = 0.01
    """Fraction of the readings at each end of the range that is ignored, because single readings may be outliers."""


MOUNTED = MountingSettings()


def as_mounted(theta: Array, mounting: Mounting, name: str) -> Array:
    """Return the (n, 3) angles of a run for a given mounting, rad.

    A single rod has theta2 = theta1.

    Raises:
        RunError: joint 2 turns although no rod is mounted on it, or although the elbow is specified as clamped.
    """
    turned = elbow_turn(theta, mounting)
    if turned > MOUNTED.still:
        mounting_words = (
            "the elbow is specified as clamped" if mounting == "clamped" else f"only the {mounting} rod is mounted"
        )
        raise RunError(
            f"{name}: joint 2 turns by {turned:.2f} rad although {mounting_words}. If both rods swing, correct the"
            " mounted rods (--rods, --elbow, or [rods] in the rig file); if one rod swings, name its column theta1"
        )
    return theta[:, [0, 1, 1]] if mounting in ("inner", "outer") else theta


def elbow_turn(theta: Array, mounting: Mounting) -> float:
    """Return the range of joint 2, rad, if joint 2 should not turn; otherwise 0.

    `theta` contains the (n, 3) angles of arm and rods.
    """
    if mounting == "both" or not len(theta):
        return 0.0
    joint2, outer = _turn(theta[:, 2] - theta[:, 1]), _turn(theta[:, 2])
    # the reading of an absolute encoder without a rod is constant
    return joint2 if mounting == "clamped" else min(joint2, outer)


def turned_arm(theta: Array) -> str:
    """Return a message if an arm that is described as clamped turns; otherwise an empty text.

    `theta` contains the (n, 3) angles of arm and rods.
    """
    turn = _turn(theta[:, 0]) if len(theta) else 0.0
    if not turn > MOUNTED.still:
        return ""
    return (
        f"its arm is described as clamped, but encoder 0 turns by {turn:.2g} rad. Clamp the arm and record again, or"
        " state its mode: capture or import with --arm"
    )


def _turn(angles: Array) -> float:
    """Return the range of angles without a few wrong readings."""
    return float(np.diff(np.quantile(angles, [MOUNTED.tail, 1 - MOUNTED.tail]))[0])


def clock_rates(clock: Mapping[str, float], sigmas: float = 5.0) -> dict[str, tuple[float, float]]:
    """Return the clock rate error and its uncertainty, ppm, by each available method.

    The uncertainty of the method `pong` is `sigmas` standard deviations, that of `arrival` is a bound.
    """
    rates = {"pong": ("rate_ppm", "rate_ppm_std", sigmas), "arrival": ("arrival_ppm", "arrival_margin_ppm", 1.0)}
    return {
        name: (clock[rate], factor * clock[margin])
        for name, (rate, margin, factor) in rates.items()
        if rate in clock and margin in clock
    }


def clock_error(clock: Mapping[str, float]) -> tuple[float, str]:
    """Return a lower bound of the absolute clock rate error, ppm, and its description.

    The bound is the estimated error minus its uncertainty, at least zero. It is computed by both methods of
    `clock_rates`, and the larger value is used.
    """
    wrong = [(max(0.0, abs(rate) - margin), rate, margin) for rate, margin in clock_rates(clock).values()]
    least, rate, margin = max(wrong, default=(0.0, 0.0, 0.0))
    return least, _clock_words(rate, margin)


def _clock_words(rate_ppm: float, margin_ppm: float) -> str:
    """Format a clock rate error, for example `5.0 % fast (4.6 to 5.4)`."""
    size, margin, unit, digits = abs(rate_ppm), margin_ppm, "ppm", 0
    if size >= 1000:
        size, margin, unit = size / 1e4, margin / 1e4, "%"
        digits = int(np.clip(-np.floor(np.log10(max(margin, 1e-9))), 1, 3))
    return (
        f"{size:.{digits}f} {unit} {'fast' if rate_ppm > 0 else 'slow'}"
        f" ({size - margin:.{digits}f} to {size + margin:.{digits}f})"
    )

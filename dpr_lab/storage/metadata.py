"""Metadata of a run: its origin (`RunMetadata`) and its end (`RunSummary`)."""

import hashlib
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any, Literal

import numpy as np

from dpr_lab.configs import parse_config
from dpr_lab.errors import ConfigError, RunError, printable
from dpr_lab.rig import JOINTS, Rig
from dpr_lab.storage.layout import FORMAT, LIMITS

TimeSource = Literal["ticks", "table"]


def _utc_now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _versions() -> dict[str, str]:
    return {"dpr_lab": version("dpr-lab"), "numpy": np.__version__, "python": platform.python_version()}


@dataclass(frozen=True, slots=True)
class RunMetadata:
    """Origin of a run: all metadata that are known before the first sample."""

    rig: Rig
    """The rig. The file contains it completely, as a TOML attachment, so that no other file is needed to read the
    run."""
    pose: str | None
    """Name of the requested pose, one of the poses of the rig; None if no pose was requested."""
    rate_hz: float
    """Nominal sample rate, Hz."""
    source: str = "device"
    """`device` for a recording of a device, `import` for a table of another program."""
    time_source: TimeSource = "ticks"
    """Source of sample times: counted ticks, or the time column of a table."""
    url: str = ""
    """Link to the device, or name of the imported file."""
    firmware: str = ""
    uid: str = ""
    protocol: str = ""
    schema_hash: str = ""
    note: str = ""
    """Note of the operator."""
    extra: Mapping[str, str] = field(default_factory=dict)
    """Further metadata, for example the options of an import."""
    created_utc: str = field(default_factory=_utc_now)
    versions: Mapping[str, str] = field(default_factory=_versions)

    def __post_init__(self) -> None:
        if self.pose is not None and self.pose not in self.rig.poses:
            raise ValueError(f"the rig has no pose {self.pose!r}; its poses: {', '.join(self.rig.poses) or 'none'}")
        if not 0 < self.rate_hz < np.inf:
            raise ValueError(f"rate_hz must be positive, not {self.rate_hz}")

    @property
    def recorded_utc(self) -> str:
        """Time of the recording, an ISO 8601 date with or without time; empty if unknown."""
        return self.created_utc if self.source == "device" else self.extra.get("recorded_at", "")

    def to_record(self, rig_text: str) -> dict[str, str]:
        """Create the provenance record.

        The record contains only the hash of `rig_text`, which is attached separately.
        """
        pose = self.rig.poses[self.pose].theta.tolist() if self.pose is not None else None
        return {
            "format": FORMAT,
            "rig": self.rig.name,
            "rig_sha256": hashlib.sha256(rig_text.encode()).hexdigest(),
            "pose": self.pose or "",
            "pose_theta_rad": json.dumps(pose),
            "rate_hz": repr(float(self.rate_hz)),
            "extra": json.dumps(dict(self.extra)),
            "versions": json.dumps(dict(self.versions)),
            "time_source": self.time_source,
            **{name: getattr(self, name) for name in _PLAIN},
        }

    @staticmethod
    def from_record(record: Mapping[str, str], rig_toml: bytes) -> "RunMetadata":
        """Create the metadata from a record of `to_record` and from the attached rig.

        Raises:
            RunError: the record has another layout, or the rig does not match the record.
        """
        if record["format"] != FORMAT:
            raise RunError(
                f"written in the format {record['format']!r}, but this version reads {FORMAT!r}: update dpr-lab"
            )
        if hashlib.sha256(rig_toml).hexdigest() != record["rig_sha256"]:
            raise RunError("the rig stored with the run is damaged, so the counts cannot be interpreted")
        try:
            rig = parse_config(rig_toml.decode(), "the rig stored with the run", Rig)
        except ConfigError as error:
            raise RunError(f"{error}; this version of dpr-lab cannot read this rig") from error
        return RunMetadata(
            rig=rig,
            pose=record["pose"] or None,
            rate_hz=float(record["rate_hz"]),
            time_source="table" if record["time_source"] == "table" else "ticks",
            extra=_words(json.loads(record["extra"])),
            versions=_words(json.loads(record["versions"])),
            **{name: printable(record[name]) for name in _PLAIN},
        )


_PLAIN = ("source", "url", "firmware", "uid", "protocol", "schema_hash", "note", "created_utc")


@dataclass(frozen=True, slots=True)
class RunSummary:
    """End of a run: all metadata that are known after the last sample."""

    release_tick: int | None = None
    """Tick at which the latch opened; None if it never opened."""
    lost: Mapping[str, int] = field(default_factory=dict)
    """Number of lost samples by cause (`dpr_lab.run.LOSS_CAUSES`)."""
    clock: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the fit of device time to host time, by name."""
    gate: str = ""
    """Verdict of the quality gate, as a sentence."""
    gate_figures: Mapping[str, float] = field(default_factory=dict)
    """Measured values of the quality checks, by name with unit."""
    pose_measured: tuple[float, float, float] | None = None
    """Absolute angles measured just before the release, rad; None if not measured."""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.pose_measured is not None and len(self.pose_measured) != JOINTS:
            raise ValueError(f"pose_measured needs {JOINTS} angles, not {len(self.pose_measured)}")

    def to_record(self, samples: int, stopped: str = "") -> dict[str, str]:
        """Create the end record of a file.

        Args:
            samples: number of samples in the file
            stopped: reason for an early end; empty for a regular end
        """
        return {
            "complete": json.dumps(not stopped),
            "stopped": stopped,
            "samples": str(samples),
            **{name: json.dumps(plain(getattr(self, name))) for name in _JSON},
        }

    @staticmethod
    def from_record(record: Mapping[str, str]) -> "RunSummary":
        """Create the summary from a record of `to_record`.

        Raises:
            ValueError, KeyError, TypeError: the content of the record is not valid.
        """
        values = {name: json.loads(record[name]) for name in _JSON}
        measured, tick = values["pose_measured"], values["release_tick"]
        if not (tick is None or (isinstance(tick, int) and 0 <= tick < LIMITS.ticks)):
            raise ValueError(f"release_tick = {str(tick)[:20]} is not a valid tick")
        return RunSummary(
            release_tick=tick,
            lost={str(cause): int(n) for cause, n in values["lost"].items()},
            clock=numbers(values["clock"]),
            gate=printable(str(values["gate"])),
            gate_figures=numbers(values["gate_figures"]),
            pose_measured=(float(measured[0]), float(measured[1]), float(measured[2]))
            if measured is not None
            else None,
            notes=tuple(printable(str(note)) for note in values["notes"]),
        )


_JSON = ("release_tick", "lost", "clock", "gate", "gate_figures", "pose_measured", "notes")


def _words(values: Mapping[str, Any]) -> dict[str, str]:
    return {printable(str(name)): printable(str(value)) for name, value in values.items()}


def numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Select the entries with finite numbers from a mapping read from a file."""
    known = {name: value for name, value in values.items() if isinstance(value, int | float)}
    return {str(name): value for name, value in known.items() if np.isfinite(value)}


def plain(value: Any) -> Any:
    """Convert a value to JSON types.

    NumPy scalars become numbers, and non-finite numbers become null.
    """
    if isinstance(value, Mapping):
        return {str(key): plain(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [plain(element) for element in value]
    number = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(number, float) and not np.isfinite(number) else number


def rig_toml(rig: Rig) -> str:
    """Convert a rig to TOML.

    The result is the text of the rig file if the file still exists unchanged; otherwise it is generated from the
    values of the rig.
    """
    if rig.path is not None and rig.path.is_file():
        content = rig.path.read_bytes()
        if hashlib.sha256(content).hexdigest() == rig.sha256:
            return content.decode()
    return "\n".join(_toml_lines(rig.model_dump(mode="json", exclude_none=True))) + "\n"


def _toml_lines(table: Mapping[str, Any], path: tuple[str, ...] = ()) -> list[str]:
    scalars = [f"{_quoted(k)} = {_quoted(v)}" for k, v in table.items() if not isinstance(v, dict)]
    lines = ["", f"[{'.'.join(map(_quoted, path))}]", *scalars] if path and scalars else scalars
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _toml_lines(value, (*path, key))
    return lines


def _quoted(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)

"""Metadata of a run file as table rows: names of quantities with their units."""

import re
from collections.abc import Mapping
from typing import Any

from dpr_lab.report.digits import NONE
from dpr_lab.run import LOSS_WORDS
from dpr_lab.storage.reader import TABLES, stored_object

QUANTITIES = {
    "file": "file",
    "sha256": "SHA-256",
    "size_bytes": "size (bytes)",
    "complete": "complete",
    "damage": "damage",
    "stopped": "reason for early termination",
    "samples": "samples",
    "duration_s": "duration from the release (s)",
    "rate_hz": "sample rate (Hz)",
    "gaps": "interruptions",
    "longest_gap_s": "longest interruption (s)",
    "lost": "lost samples by cause",
    "release_tick": "device tick at the release",
    "pose": "pose",
    "pose_rad": "angles of the pose: arm, rods (rad)",
    "pose_measured_rad": "measured angles before the release: arm, rods (rad)",
    "gate": "quality checks",
    "gate_figures": "measured by the quality checks",
    "clock": "clock of the device",
    "mounted": "mounted rods",
    "elbow": "joint 2",
    "arm": "arm",
    "inner": "inner rod",
    "input": "input of the arm",
    "rig": "rig",
    "rig_sha256": "SHA-256 of the rig file",
    "source": "source",
    "url": "link",
    "firmware": "firmware",
    "uid": "device identifier",
    "protocol": "protocol",
    "schema_hash": "hash of the message formats",
    "versions": "versions",
    "created_utc": "file created (UTC)",
    "recorded_utc": "recorded (UTC)",
    "note": "note",
    "notes": "remarks",
    "extra": "further information",
}
"""Name in the table for each field of `dpr_lab.storage.inspect.RunInfo`."""

PARTS = LOSS_WORDS | {
    "rest_speed": "speed at rest",
    "rest_spread": "scatter at rest",
    "pose": "distance from the pose",
    "release_speed": "speed at the release",
    "lost": "share of lost samples",
    "gap": "longest interruption",
    "complete": "finished file",
    "jitter": "jitter of the samples",
    "clock": "clock rate error",
    "clock_fit": "uncertainty of the clock rate",
    "latch": "share of messages after the release that report a closed latch",
    "jumps": "fastest motion relative to the fastest possible",
    "moved": "smallest motion of an encoder",
    "hanging_before": "distance from the hanging position before the run",
    "hanging_after": "distance from the hanging position after the run",
    "rate_ppm": "rate error from PING (ppm)",
    "rate_ppm_std": "standard deviation of the rate error from PING (ppm)",
    "rtt_min": "shortest round trip (s)",
    "n": "PING exchanges",
    "offset": "host time of tick 0 (s)",
    "offset_unix": "Unix time of tick 0 (s)",
    "offset_std": "standard deviation of the times of tick 0 (s)",
    "period": "period of a tick (s)",
    "dpr_lab": "dpr-lab",
    "arrival_ppm": "rate error from the arrival of samples (ppm)",
    "arrival_margin_ppm": "bound on the error of this estimate (ppm)",
    "file_sha256": "SHA-256 of the table",
    "t_offset_s": "time of the release in the table (s)",
    "columns": "columns of the table:",
    "torque_kind": "kind of the torques",
    "input_delay_s": "delay of the torques (s)",
    "film_noise": "noise of the tracker:",
    "at_edges": "angles of the count edges",
    "options": "import with",
}
"""Description of each loss, quality check and clock value in the table. In other names, underscores become spaces."""

_ROUND_OFF = 1e-12
"""Largest magnitude that is printed as zero, because a value of this size is only rounding error."""

_WITH_UNIT = re.compile(r"(\w+) \((.+)\)")
"""Pattern of a quality check with its unit in a run file. A share has the unit 1."""


def info_rows(info: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the quantity and value of each entry of a run's metadata."""
    return [(QUANTITIES[name], _imported(value) if name == "extra" else _text(value)) for name, value in info.items()]


def _imported(extra: Mapping[str, str]) -> str:
    """Describe the known facts of an import, including the options that were given."""
    known: dict[str, object] = {
        name: stored_object(text) if name in TABLES else text for name, text in extra.items() if text
    }
    if isinstance(options := known.get("options"), Mapping):
        remaining = {
            name: value for name, value in options.items() if name not in ("arm", "inner")
        }  # rows of their own
        used = {name: value for name, value in remaining.items() if value not in (None, "", {}, [], False)}
        known["options"] = [f"--{name.replace('_', '-')} {_option(value)}".rstrip() for name, value in used.items()]
    return _text({name: value for name, value in known.items() if value})


def _option(value: object) -> str:
    """Return the value of an option as it is typed."""
    if isinstance(value, Mapping):
        return ",".join(f"{name}={entry}" for name, entry in value.items())
    return "" if value is True else _text(value)


def _text(value: object) -> str:
    match value:
        case Mapping():
            return ", ".join(f"{_part(str(name))} {_text(entry)}" for name, entry in value.items()) or NONE
        case list() | tuple():
            return ", ".join(map(_text, value)) or NONE
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.3f}" if abs(value) >= 1e6 else f"{value if abs(value) > _ROUND_OFF else 0.0:.6g}"
    return NONE if value is None or value == "" else str(value)


def _part(name: str) -> str:
    with_unit = _WITH_UNIT.fullmatch(name)
    if with_unit is None:
        return PARTS.get(name, name.replace("_", " "))
    words, unit = _part(with_unit[1]), with_unit[2]
    return words if unit == "1" else f"{words} ({unit})"

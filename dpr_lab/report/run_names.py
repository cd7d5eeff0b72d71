"""Name runs in tables and figures by pose and local time of the recording."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import AnyComparison


def local_time(utc: str, *, seconds: bool = False) -> str:
    """Convert a UTC time to local time, for example `2026-11-21 11:15 CET`.

    The time has the format of ISO 8601 or of the name of a run file. Other text is returned unchanged.

    Args:
        utc: the UTC time
        seconds: state the seconds, unless they are zero
    """
    if len(utc) <= len("2026-11-21"):
        return utc
    try:
        time = datetime.fromisoformat(utc.replace("Z", "+00:00"))
        time = time if time.tzinfo is not None else time.replace(tzinfo=UTC)
        clock = "%H:%M:%S" if seconds and time.second else "%H:%M"
        return f"{time.astimezone():%Y-%m-%d {clock} %Z}"
    except (ValueError, OverflowError, OSError):  # not a time, or outside the range of this computer's clock
        return utc


def recorded(run: Path, *, seconds: bool = False) -> str:
    """Return the recording time from a name `<utc>_<pose>_<uid8>`, or an empty text for any other name."""
    parts = run.stem.split("_")
    time = local_time(parts[0], seconds=seconds)
    return time if len(parts) > 2 and time != parts[0] else ""


def run_pose(run: Path) -> str:
    """Return the pose from a name `<utc>_<pose>_<uid8>`; any other name is unchanged."""
    return "_".join(run.stem.split("_")[1:-1]) if recorded(run) else run.stem


def run_name(run: Path) -> str:
    """Return pose and time from a name `<utc>_<pose>_<uid8>`, like `run_label`."""
    return run_label(run.stem)


def run_label(stem: str) -> str:
    """Return pose and time from a name `<utc>_<pose>_<uid8>` without extension; any other name is unchanged.

    The label states the seconds, and the number of a name such as `<utc>_<pose>_<uid8>-2`, so that it is unique.
    """
    file = Path(f"{stem}.mcap")
    if not recorded(file):
        return stem
    number = re.search(r"_[0-9a-f]{8}-(\d+)$", stem)
    time = local_time(stem.split("_")[0], seconds=True)
    return f"{run_pose(file)} ({time}{f', number {number[1]}' if number else ''})"


def compared_name(comparison: "AnyComparison") -> str:
    """Return the name of a compared run, preceded by its pose unless the name contains the pose as a word."""
    name = run_label(comparison.run)
    pose = getattr(comparison, "pose", None)
    named = not pose or re.search(rf"(?<![^\W_]){re.escape(pose)}(?![^\W_])", name)
    return name if named else f"{pose} {name}"

"""How a table is to be read, and when it was recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from typing import Literal

import numpy as np

from dpr_lab.rig_tables import ArmMode
from dpr_lab.storage.tables.columns import AXES
from dpr_lab.storage.tables.plausible import PLAUSIBLE

Angles = Literal["absolute", "relative"]
Zero = Literal["upright", "hanging"]
Unit = Literal["rad", "deg", "counts"]
TimeUnit = Literal["s", "ms", "us"]
TorqueChoice = Literal["measured", "commanded", "none"]


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """How a table is to be read."""

    angles: Angles = "absolute"
    """Whether theta2 is the outer rod's own angle to the vertical, or its angle to the inner rod."""
    zero: Zero = "upright"
    """Where the rods point at angle 0."""
    unit: Unit | None = "rad"
    """`counts` are read by the rig's encoders; `angles` and `zero` then come from the rig as well. None: what the
    columns' names say, rad where they say nothing."""
    time_unit: TimeUnit | None = "s"
    """None: what the column's name says, s where it says nothing."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column name (or number, without a header) of t, theta0, theta1, theta2 and of the input of a driven arm, where
    the guess by name fails."""
    take: tuple[str, ...] = ()
    """Part of the file: topic of a bag, arrays or groups of a .mat, .npz or .h5, or the points pivot, elbow, tip."""
    rate_hz: float | None = None
    """Rows a second of a table without time; a column of times is then not used."""
    wrap: float | None = None
    """At how much the logger wraps, in the table's unit: 360, 4096, ...; without it whole turns are noticed."""
    time_wrap: float | None = None
    """At how much the column of times wraps, in its unit: 4294967296 for a 32-bit counter."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """By axis, what a value of the table is multiplied by."""
    offset: Mapping[str, float] = field(default_factory=dict)
    """By axis, what is then added, in the table's unit."""
    start_s: float = 0.0
    """Rows earlier than this after the table's first row are left out."""
    duration_s: float | None = None
    """Length of the part to keep; None for all."""
    keep_rest: bool = False
    """Whether all rows are taken as they are, even where the rods seem to be held."""
    pose: str | None = None
    """Pose of the rig that was released from, where it is known."""
    recorded_at: str = ""
    """When the table was recorded: ISO 8601 date, or date and time; without a zone it is the computer's. Empty: as the
    table's own time stamps say, or not known."""
    note: str = ""
    """Note of the operator; `drift --by label` groups runs by it."""
    torque: TorqueChoice | None = None
    """The only kind of torques to keep, or that torques which do not say it are of; `none`: none that it holds. None:
    all there are, of two kinds both."""
    input_delay_s: float = 0.0
    """How much later than they were logged they act, where that is known."""
    arm: ArmMode | None = None
    """What the arm did; None: as the rig file says."""

    def __post_init__(self) -> None:
        unknown = (set(self.columns) - {"t", "input"} | set(self.scale) | set(self.offset)) - set(AXES)
        if unknown:
            raise ValueError(f"columns can be given for t, {', '.join(AXES)}, not for {', '.join(sorted(unknown))}")
        positive = [self.rate_hz, self.wrap, self.time_wrap]
        if not all(value is None or 0 < value < np.inf for value in positive) or 0.0 in self.scale.values():
            raise ValueError("rate_hz, wrap and time_wrap must be positive and finite, scale must not be 0")
        if not np.isfinite([*self.scale.values(), *self.offset.values()]).all():
            raise ValueError("scale and offset must be finite")
        if not abs(self.input_delay_s) <= PLAUSIBLE.input_delay_s:
            raise ValueError(f"input_delay_s must be within {PLAUSIBLE.input_delay_s:g} s, not {self.input_delay_s:g}")
        if self.recorded_at:
            parse_recorded_at(self.recorded_at)
        if not self.start_s >= 0 or (self.duration_s is not None and not self.duration_s > 0):
            raise ValueError("start_s must not be negative, duration_s must be positive")


def parse_recorded_at(text: str) -> str:
    """A date as it is, a date and time in UTC; a time without a zone is the computer's local time.

    Raises:
        ValueError: it is neither, or lies in the future.
    """
    text = text.strip()
    try:
        if len(text) <= len("2026-03-01"):
            day = date.fromisoformat(text)
            instant = datetime(day.year, day.month, day.day).astimezone()
        else:
            day, instant = None, datetime.fromisoformat(text).astimezone(UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise ValueError(
            f"recorded_at must be a date or a date and time, as 2026-03-01 or 2026-03-01T14:30, not {text[:50]!r}"
        ) from error
    if instant > datetime.now(UTC):
        raise ValueError(f"recorded_at {text} lies in the future")
    return day.isoformat() if day is not None else instant.isoformat(timespec="seconds")


def recorded_by_stamps(first_s: float) -> str:
    """The date and time in UTC of a table whose first time is seconds since 1970; empty where it cannot be that."""
    if not PLAUSIBLE.stamps_s[0] <= first_s <= PLAUSIBLE.stamps_s[1]:
        return ""
    return datetime.fromtimestamp(first_s, UTC).isoformat(timespec="seconds")

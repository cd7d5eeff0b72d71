"""Options of a table import, and parsing of the time of the recording."""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, dataclass, field, fields
from datetime import UTC, date, datetime
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

AXES = ("theta0", "theta1", "theta2")


@dataclass(frozen=True, slots=True)
class Typed:
    """Help text and limits of an option, for the command line and the screen."""

    help: str
    lowest: float = -math.inf
    highest: float = math.inf
    positive: bool = False
    """Whether the value must be positive and finite."""

    def check(self, name: str, value: object) -> None:
        """Raise a ValueError if a number is outside its limits."""
        if not isinstance(value, int | float) or isinstance(value, bool):
            return
        if self.positive and not 0 < value < math.inf:
            raise ValueError(f"{name} must be above 0 and finite, not {value:g}")
        if not self.lowest <= value <= self.highest:
            limits = f"at least {self.lowest:g}" if self.highest == math.inf else f"{self.lowest:g} to {self.highest:g}"
            raise ValueError(f"{name} must be {limits}, not {value:g}")


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Interpretation of a table.

    The options of `import table` and of the screen are the fields of this class.
    """

    pose: Annotated[str | None, Typed("Pose of the rig file from which the swing started.")] = None
    """Name of the pose of the rig from which the swing started; None if unknown."""
    angles: Annotated[
        Literal["absolute", "relative"],
        Typed("Reference of theta2: the vertical (absolute), or the inner rod (relative)."),
    ] = "absolute"
    """Reference of theta2: angle of the outer rod to the vertical (absolute) or to the inner rod (relative)."""
    zero: Annotated[Literal["upright", "hanging"], Typed("Pose in which the angles are zero.")] = "upright"
    """Direction of the rods at angle 0."""
    unit: Annotated[
        Literal["rad", "deg", "counts"] | None,
        Typed("Unit of the angles; by default read from the column names."),
    ] = None
    """Unit of the angles. `counts` are converted by the encoders of the rig, which then determine `angles` and
    `zero`. None: as in the column names, otherwise rad.
    """
    time_unit: Annotated[
        Literal["s", "ms", "us"] | None,
        Typed("Unit of the time; by default read from the column name."),
    ] = None
    """Unit of the time; None: as in the column name, otherwise s."""
    columns: Annotated[
        Mapping[str, str],
        Typed("Names or numbers of the columns, e.g. t=time,theta1=q1,theta2=q2; recognised by default."),
    ] = field(default_factory=dict)
    """Column name of each quantity, or column number, from 1, if no column has this name. The quantities are t,
    theta0, theta1, theta2, the torques tau1 and tau2, and the input of a driven arm. Only names that are not recognised
    are needed."""
    take: Annotated[
        tuple[str, ...], Typed("Part of the file: topic of a bag, arrays or groups, or the points PIVOT,ELBOW,TIP.")
    ] = ()
    """Part of the file: topic of a bag, arrays or groups of a .mat, .npz or .h5, or the points pivot, elbow, tip."""
    rate_hz: Annotated[
        float | None, Typed("Rows or frames per second, Hz, for a table without times.", positive=True)
    ] = None
    """Sample rate of a table without times, Hz. If it is given, a column of times is ignored, and a column of frame or
    row numbers shows which rows are missing."""
    wrap: Annotated[
        float | None,
        Typed("Period at which the angles wrap, in the unit of the angles, e.g. 360 or 4096.", positive=True),
    ] = None
    """Period at which the logger wraps the angles, in their unit: 360, 4096, ...; None: detected."""
    time_wrap: Annotated[
        float | None,
        Typed(
            "Period at which the times wrap, in the unit of the times: 4294967296 for a 32-bit counter.", positive=True
        ),
    ] = None
    """Period at which the times wrap, in the unit of the times: 4294967296 for a 32-bit counter."""
    scale: Annotated[
        Mapping[str, float],
        Typed(
            "Factors for the angles: -1, or theta1=-1,theta2=0.5; for the torques: tau2=-1; for the input: input=-1."
        ),
    ] = field(default_factory=dict)
    """Factors that multiply the values of the table, by axis, torque (`tau1`, `tau2`), or `input` of a driven arm."""
    offset: Annotated[
        Mapping[str, float],
        Typed("Value to add to the angles after scaling, in the unit of the angles: 90, or theta1=90."),
    ] = field(default_factory=dict)
    """Values that are added after the multiplication by `scale`, by axis, in the unit of the table."""
    torque: Annotated[
        Literal["measured", "commanded", "none"] | None,
        Typed("Torques to use if the table contains both kinds; none: treat the recording as a free swing."),
    ] = None
    """Kind of torques to use. Columns that do not state their kind are assumed to be of this kind. `none`: no torques.
    None: all torques of the table."""
    input_delay_s: Annotated[
        float,
        Typed(
            "Delay between the logged and the acting torques, s, if known.",
            lowest=-1.0,
            highest=1.0,
        ),
    ] = 0.0
    """Delay from the logged to the acting torques, s; positive if they act later than logged."""
    intersample: Annotated[
        Literal["held", "continuous"],
        Typed("Torques and input between rows: zero-order hold until the next row, or samples of a continuous signal."),
    ] = "held"
    """Torques and input of a driven arm between rows: zero-order hold until the next row, or samples of a continuous
    signal."""
    arm: Annotated[
        Literal["clamped", "free", "prescribed", "driven"] | None,
        Typed(
            "Mode of the arm: clamped, free, prescribed by its encoder, or driven. Default: the mode in the rig file."
        ),
    ] = None
    """Mode of the arm; None: as in the rig file."""
    inner: Annotated[
        Literal["free", "prescribed"] | None,
        Typed("Mode of the inner rod: free, or prescribed by its encoder. Default: the mode in the rig file."),
    ] = None
    """Mode of the inner rod, `free` or `prescribed`; None: the mode of the rig file."""
    keep_rest: Annotated[bool, Typed("Keep all rows, including rows in which the rods seem to be held.")] = False
    """Whether all rows are used, including rows in which the rods seem to be held."""
    recorded_at: Annotated[
        str,
        Typed(
            "Time of the recording, e.g. 2026-03-01 or 2026-03-01T14:30; local time without a zone. Default: from the"
            " time stamps, or from one date in the title lines or the file name."
        ),
    ] = ""
    """Time of the recording: ISO 8601 date, or date and time; local time without a zone. Empty: from the time stamps
    of the table, or from one date in its title lines or in the file name; otherwise unknown.
    """
    note: Annotated[str, Typed("Note to store with the run. `drift --by label` groups runs by their notes.")] = ""
    """Note of the operator; `drift --by label` groups runs by it."""
    start_s: Annotated[float, Typed("Duration to cut from the beginning, s.", lowest=0)] = 0.0
    """Duration to omit from the beginning of the table, s."""
    duration_s: Annotated[float | None, Typed("Duration to keep, s.", positive=True)] = None
    """Duration to keep, s; None: all."""

    def __post_init__(self) -> None:
        driving = ("tau1", "tau2", "input")
        allowed = {"columns": ("t", *AXES, *driving), "scale": (*AXES, *driving), "offset": AXES}
        for option, names in allowed.items():
            if unknown := sorted(set(getattr(self, option)) - set(names)):
                raise ValueError(f"{option} can be given for {', '.join(names)}, not for {', '.join(unknown)}")
        if not all(map(math.isfinite, [*self.scale.values(), *self.offset.values()])):
            raise ValueError("scale and offset must be finite")
        if 0.0 in self.scale.values():
            raise ValueError("scale must not be 0")
        if self.recorded_at:
            parse_recorded_at(self.recorded_at)
        for option in typed_options():
            value = getattr(self, option.name)
            option.typed.check(option.name, value)
            if get_origin(option.kind) is Literal and value not in (None, *(choices := get_args(option.kind))):
                raise ValueError(f"{option.name} must be {' or '.join(choices)}, not {value!r}")


@dataclass(frozen=True, slots=True)
class TypedOption:
    """Description of one option of `import table`; it is derived from a field of `ImportOptions`."""

    name: str
    """Name of the field of `ImportOptions`."""
    kind: Any
    """Type of the value, without None."""
    default: Any
    """Default value; None for a mapping or a tuple."""
    typed: Typed

    @property
    def reads_text(self) -> bool:
        """Whether the option is a mapping or a tuple, so that `read` must convert its text."""
        return get_origin(self.kind) in (Mapping, tuple)

    def read(self, text: str) -> Any:
        """Convert the text of an option.

        The text contains names, `name=column` pairs, or one number for both rods or for each axis.

        Raises:
            ValueError: the text does not have this form.
        """
        parts = [part.strip() for part in text.split(",") if part.strip()]
        if get_origin(self.kind) is tuple:
            return tuple(parts)
        numeric = get_args(self.kind)[1] is float
        if numeric and "=" not in text:
            parts = [f"{axis}={text}" for axis in AXES[1:]]
        pairs = [[side.strip() for side in part.split("=", 1)] for part in parts]
        try:
            if any(len(pair) != 2 or not all(pair) for pair in pairs):
                raise ValueError
            named = {axis: float(value) if numeric else value for axis, value in pairs}
        except ValueError as error:
            example = (
                "a number or theta1=-1,theta2=0.5"
                if numeric
                else (
                    "name=column pairs, t=time,theta1=q1 (a column whose name has a comma is given by its number, t=2)"
                )
            )
            raise ValueError(f"{self.name} must be {example}, not {text[:50]!r}") from error
        if len(named) < len(pairs):
            raise ValueError(f"{self.name} states a value twice: {text[:50]!r}; state each once")
        return named


@cache
def typed_options() -> tuple[TypedOption, ...]:
    """Return the options of `import table`, one for each field of `ImportOptions`."""
    return tuple(_typed_options())


def _typed_options() -> Iterator[TypedOption]:
    hints = get_type_hints(ImportOptions, include_extras=True)
    for option in fields(ImportOptions):
        kind, typed = get_args(hints[option.name])
        if get_origin(kind) in (Union, UnionType):
            kind = next(part for part in get_args(kind) if part is not type(None))
        default = None if option.default in (MISSING, ()) else option.default
        yield TypedOption(option.name, kind, default, typed)


def parse_recorded_at(text: str) -> str:
    """Convert a date and time to UTC; a date alone is returned unchanged.

    A time without a zone is local time.

    Raises:
        ValueError: the text is neither a date nor a date and time, or is in the future.
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
            f"recorded_at must be a date or a date and time, such as 2026-03-01T14:30, not {text[:50]!r}"
        ) from error
    if instant > datetime.now(UTC):
        raise ValueError(f"recorded_at {text} is in the future")
    return day.isoformat() if day is not None else instant.isoformat(timespec="seconds")


_DATE = re.compile(
    r"(?<!\d)(?P<day>\d{4}-\d\d-\d\d)(?!\d)"
    r"(?:[ T](?P<time>\d\d:\d\d(?::\d\d(?:\.\d+)?)?)(?P<zone>Z| ?[+-]\d\d:?\d\d(?!\d))?)?"
)


def date_in(text: str) -> str:
    """Return the date in a text, such as `2026-03-01 swing`, with its time in UTC if the text contains one.

    If the time is invalid, or the text contains several times of the day, the result is the day. The result is empty if
    the text contains no date, several dates, or a date in the future.
    """
    dates = list(_DATE.finditer(text))
    days = {match["day"] for match in dates}
    times = {f"{match['day']}T{match['time']}{(match['zone'] or '').strip()}" for match in dates if match["time"]}
    if len(days) != 1:
        return ""
    for candidate in (*times, *days) if len(times) == 1 else days:
        with suppress(ValueError):
            return parse_recorded_at(candidate)
    return ""

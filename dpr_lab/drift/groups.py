"""Which runs belong together."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise

from dpr_lab.errors import RunError


@dataclass(frozen=True, slots=True)
class Occasion:
    """When and under which label a run was recorded."""

    name: str
    """Name of the run."""
    at: datetime | None
    """When it was recorded; None where an imported table does not say it."""
    label: str
    """The operator's note, or the folder of the file where there is none."""


@dataclass(frozen=True, slots=True)
class GroupSettings:
    """What begins a new group."""

    pause: timedelta = timedelta(hours=1)
    """Between two runs of different sessions, at least: a rig that is left cools down."""


GROUPS = GroupSettings()


@dataclass(frozen=True, slots=True)
class Grouped:
    """Runs in the order of time, and the group of each."""

    order: tuple[int, ...]
    """Places of the runs as they were given, in the order of time where all dates are known."""
    group: tuple[int, ...]
    """Of each run in that order."""
    names: tuple[str, ...]
    """Of the groups, in the order of their first runs."""


def grouped(runs: Sequence[Occasion], by: str) -> Grouped:
    """Runs by time and group.

    Args:
        runs: as they were given
        by: a name of `KEYS`

    Raises:
        RunError: fewer than two groups, or groups by date of runs whose date is not known.
    """
    undated = [run.name for run in runs if run.at is None]
    if undated and by != "label":
        names = ", ".join(undated[:3]) + (f" and {len(undated) - 3} more" if len(undated) > 3 else "")
        raise RunError(
            f"groups by {by} need to know when each run was recorded; {len(undated)} of {len(runs)} do not say it:"
            f" {names}. Import their tables again with --recorded-at 2026-03-01T14:30, or group by note or folder:"
            " --by label"
        )
    # Runs without a date keep their place among the others.
    order = list(range(len(runs))) if undated else sorted(range(len(runs)), key=lambda i: (_instant(runs[i]), i))
    keys = KEYS[by]([runs[i] for i in order])
    names = tuple(dict.fromkeys(keys))
    if len(names) < 2:
        raise RunError(
            f"all {len(runs)} runs are of one {by} ({', '.join(names)}): give runs of two or more, or group them"
            f" otherwise with --by {'|'.join(KEYS)}"
        )
    return Grouped(tuple(order), tuple(names.index(key) for key in keys), names)


def _instant(run: Occasion) -> datetime:
    assert run.at is not None
    return run.at.astimezone()


def _days(runs: Sequence[Occasion]) -> list[str]:
    return [f"{_instant(run):%Y-%m-%d}" for run in runs]


def _sessions(runs: Sequence[Occasion]) -> list[str]:
    names = [f"{_instant(runs[0]):%Y-%m-%d %H:%M}"] if runs else []
    for before, run in pairwise(runs):
        later = _instant(run) - _instant(before) > GROUPS.pause
        names.append(f"{_instant(run):%Y-%m-%d %H:%M}" if later else names[-1])
    return names


def _labels(runs: Sequence[Occasion]) -> list[str]:
    return [run.label for run in runs]


KEYS: Mapping[str, Callable[[Sequence[Occasion]], list[str]]] = {"day": _days, "session": _sessions, "label": _labels}
"""How runs may be grouped -> the name of each run's group, runs in the order of time."""

"""Group runs by day, session or label."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise

from dpr_lab.errors import RunError


@dataclass(frozen=True, slots=True)
class Occasion:
    """Name, time and label of a recorded run."""

    name: str
    """Name of the run."""
    at: datetime | None
    """Time of the recording; None for an imported table without a date."""
    label: str
    """The operator's note, or the folder of the file if there is none."""


@dataclass(frozen=True, slots=True)
class GroupSettings:
    """Settings of the grouping."""

    pause: timedelta = timedelta(hours=1)
    """Minimum pause between two sessions, during which the rig cools down."""


GROUPS = GroupSettings()


@dataclass(frozen=True, slots=True)
class Grouped:
    """Chronological order of the runs, and the group of each run."""

    order: tuple[int, ...]
    """Indices of the given runs in chronological order; in the given order if a date is missing."""
    group: tuple[int, ...]
    """Index of the group of each run, in the order of `order`."""
    names: tuple[str, ...]
    """Names of the groups, in the order of their first runs."""


def grouped(runs: Sequence[Occasion], by: str) -> Grouped:
    """Sort runs by time, and divide them into groups.

    Args:
        runs: the runs in any order
        by: a name of `KEYS`

    Raises:
        RunError: there are fewer than two groups, or runs without a date are grouped by date.
    """
    undated = [run.name for run in runs if run.at is None]
    if undated and by != "label":
        names = ", ".join(undated[:3]) + (f" and {len(undated) - 3} more" if len(undated) > 3 else "")
        raise RunError(
            f"cannot group by {by}: {len(undated)} of {len(runs)} runs have no recording time: {names}. Import their"
            " tables again with --recorded-at 2026-03-01T14:30, or group by note or folder: --by label"
        )
    # Runs without a date keep their position in the list.
    order = list(range(len(runs))) if undated else sorted(range(len(runs)), key=lambda i: (_instant(runs[i]), i))
    keys = KEYS[by]([runs[i] for i in order])
    names = tuple(dict.fromkeys(keys))
    if len(names) < 2:
        subject = f"all {len(runs)} runs are" if len(runs) > 1 else "the run is"
        raise RunError(
            f"{subject} of one {by} ({', '.join(names)}). Give runs of at least two groups, or choose another grouping"
            f" with --by {'|'.join(KEYS)}"
        )
    return Grouped(tuple(order), tuple(names.index(key) for key in keys), names)


def _instant(run: Occasion) -> datetime:
    assert run.at is not None
    return run.at.astimezone()


def _days(runs: Sequence[Occasion]) -> list[str]:
    return [f"{_instant(run):%Y-%m-%d}" for run in runs]


def _sessions(runs: Sequence[Occasion]) -> list[str]:
    names = [f"{_instant(runs[0]):%Y-%m-%d %H:%M}"] if runs else []
    for previous, run in pairwise(runs):
        is_new = _instant(run) - _instant(previous) > GROUPS.pause
        names.append(f"{_instant(run):%Y-%m-%d %H:%M}" if is_new else names[-1])
    return names


KEYS: Mapping[str, Callable[[Sequence[Occasion]], list[str]]] = {
    "day": _days,
    "session": _sessions,
    "label": lambda runs: [run.label for run in runs],
}
"""Groupings by name: functions that return the group name of each run, for runs in chronological order."""

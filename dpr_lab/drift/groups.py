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
    at: datetime
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
    """Places of the runs as they were given."""
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
        RunError: fewer than two groups.
    """
    order = sorted(range(len(runs)), key=lambda i: (runs[i].at, i))
    keys = KEYS[by]([runs[i] for i in order])
    names = tuple(dict.fromkeys(keys))
    if len(names) < 2:
        raise RunError(
            f"all {len(runs)} runs are of one {by} ({', '.join(names)}): give runs of two or more, or group them"
            f" otherwise with --by {'|'.join(KEYS)}"
        )
    return Grouped(tuple(order), tuple(names.index(key) for key in keys), names)


def _days(runs: Sequence[Occasion]) -> list[str]:
    return [f"{run.at.astimezone():%Y-%m-%d}" for run in runs]


def _sessions(runs: Sequence[Occasion]) -> list[str]:
    names = [f"{runs[0].at.astimezone():%Y-%m-%d %H:%M}"] if runs else []
    for before, run in pairwise(runs):
        names.append(f"{run.at.astimezone():%Y-%m-%d %H:%M}" if run.at - before.at > GROUPS.pause else names[-1])
    return names


def _labels(runs: Sequence[Occasion]) -> list[str]:
    return [run.label for run in runs]


KEYS: Mapping[str, Callable[[Sequence[Occasion]], list[str]]] = {"day": _days, "session": _sessions, "label": _labels}
"""How runs may be grouped -> the name of each run's group, runs in the order of time."""

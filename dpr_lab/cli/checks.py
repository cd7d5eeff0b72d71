"""What is wrong with the arguments of a command, said before the work begins."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dpr_lab.errors import ConfigError

if TYPE_CHECKING:
    from dpr_lab.rig import Rig


def positive(value: float | None) -> float | None:
    """A callback of an option: a number above zero, and finite; or none given.

    Raises:
        BadParameter: it is not.
    """
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f"must be above 0 and finite, not {value:g}")
    return value


def refuse_file(out: Path) -> None:
    """Make sure that results can go into a folder, before the work for them begins.

    Raises:
        ConfigError: a file stands there.
    """
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file: name a folder for --out")


def refuse_unknown_poses(rig: "Rig", names: "Sequence[str]") -> None:
    """Make sure that the rig has every pose named, before the first is recorded.

    Raises:
        ConfigError: it lacks one.
    """
    unknown = [name for name in names if name not in rig.poses]
    if unknown:
        where, there = rig.path or rig.name, ", ".join(rig.poses) or "none"
        raise ConfigError(f"{where}: has no pose {' and no pose '.join(map(repr, unknown))} (there are: {there})")

"""Check a request before its work begins."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from dpr_lab.errors import ConfigError, unknown_name

if TYPE_CHECKING:
    from dpr_lab.rig import Rig


def refuse_file(out: Path) -> None:
    """Make sure that results can go into a folder, before the work for them begins.

    Raises:
        ConfigError: a file stands there, or nothing can be written there.
    """
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file: name a folder for --out")
    _refuse_unwritable(out)


def refuse_folder(out: Path) -> None:
    """Make sure that a result can be written to a file, before the work for it begins.

    Raises:
        ConfigError: a folder stands there, or nothing can be written there.
    """
    if out.is_dir():
        raise ConfigError(f"{out}: is a folder: name a file for --out")
    _refuse_unwritable(out.parent)


def _refuse_unwritable(folder: Path, least_bytes: int = 1 << 16) -> None:
    """Try to write where the folder is, or where it would be made."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with TemporaryFile(dir=there) as probe:
            probe.write(bytes(least_bytes))
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written: {error.strerror}: choose another place with --out") from error


def with_rods(rig: "Rig", mounted: str | None, elbow: str | None) -> "Rig":
    """The rig with these rods on it.

    Raises:
        ConfigError: an elbow clamped that is not there, or rods that cannot be modelled on an arm that moves.
    """
    try:
        return rig.with_rods(mounted, elbow)
    except ValueError as error:
        if rig.arm.mode in ("free", "driven"):
            raise ConfigError(
                f"--rods, --elbow: the arm of {rig.name} is {rig.arm.mode}, which is modelled with both rods or with"
                " the inner rod alone, and with the elbow free"
            ) from error
        raise ConfigError("one rod alone has no elbow: leave out --rods or --elbow") from error


def refuse_no_poses(rig: "Rig") -> None:
    """Make sure that there is a pose to release from.

    Raises:
        ConfigError: the rig has none.
    """
    if not rig.poses:
        raise ConfigError(
            f"{rig.path or rig.name}: has no poses, so there is nothing to release from: add a table [poses.NAME] with"
            " theta1 and theta2 (docs/rig-file.md)"
        )


def refuse_unknown_poses(rig: "Rig", names: Sequence[str]) -> None:
    """Make sure that the rig has every pose named, before the first is recorded.

    Raises:
        ConfigError: it lacks one.
    """
    unknown = [name for name in names if name not in rig.poses]
    if unknown:
        raise ConfigError(unknown_name(f"{rig.path or rig.name}: has no pose {unknown[0]!r}", unknown[0], rig.poses))

"""Checks of a request before its job starts."""

from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from dpr_lab.errors import ConfigError

if TYPE_CHECKING:
    from dpr_lab.rig import Rig


def check_folder_writable(out: Path) -> None:
    """Check that results can be written to a folder, before a job starts.

    Raises:
        ConfigError: a file with this name exists, or nothing can be written.
    """
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file: name a folder for --out")
    _try_to_write(out, out)


def refuse_own_folder(out: Path, original: Path) -> None:
    """Check that a changed copy does not overwrite its original.

    Raises:
        ConfigError: the folder is that of the original, or nothing can be written to it.
    """
    check_folder_writable(out)
    if (out / original.name).resolve() == original.resolve():
        raise ConfigError(f"{out}: is the folder of {original.name}, which is not overwritten: choose another folder")


def check_file_writable(out: Path) -> None:
    """Check that a result can be written to a file, before the job starts.

    Raises:
        ConfigError: a folder with this name exists, or nothing can be written.
    """
    if out.is_dir():
        raise ConfigError(f"{out}: is a folder: name a file for --out")
    _try_to_write(out, out.parent)


def _try_to_write(out: Path, folder: Path, least_bytes: int = 1 << 16) -> None:
    """Write a temporary file to a folder, or to its nearest existing parent.

    Raises:
        ConfigError: the file cannot be written; the message names `out`.
    """
    existing = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    try:
        with TemporaryFile(dir=existing) as probe:
            probe.write(bytes(least_bytes))
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written: {error.strerror}: choose another folder with --out") from error


def with_rods(rig: "Rig", mounted: str | None, elbow: str | None) -> "Rig":
    """Return a copy of the rig with changed mounted rods or elbow mode.

    Raises:
        ConfigError: there is no joint 2 to clamp, or the rods are not supported with a moving arm.
    """
    try:
        return rig.with_rods(mounted, elbow)
    except ValueError as error:
        if rig.arm.mode in ("free", "driven"):
            raise ConfigError(
                f"--rods, --elbow: the arm of {rig.name} is {rig.arm.mode}, which is supported with both rods or with"
                " the inner rod alone, and with the elbow free"
            ) from error
        raise ConfigError("a single rod has no elbow: remove --rods or --elbow") from error


def with_modes(rig: "Rig", arm: str | None, inner: str | None) -> "Rig":
    """Return the rig with other modes of joints 0 and 1 for one session.

    Raises:
        ConfigError: this rig does not support these modes; the message states what is missing.
    """
    from pydantic import ValidationError

    from dpr_lab.rig import Rig

    if arm is None and inner is None:
        return rig
    table = rig.model_dump(exclude_none=True)
    table["arm"] = table["arm"] | ({"mode": arm} if arm else {})
    table["joints"] = table["joints"] | ({"inner": inner} if inner else {})
    try:
        return Rig.model_validate(table)
    except ValueError as error:
        reason = str(error.errors()[0]["msg"]) if isinstance(error, ValidationError) else str(error)
        options = " ".join(f"--{name} {mode}" for name, mode in (("arm", arm), ("inner", inner)) if mode)
        raise ConfigError(f"{options}: {reason.removeprefix('Value error, ')}") from error


def refuse_no_poses(rig: "Rig") -> None:
    """Check that the rig has at least one pose.

    Raises:
        ConfigError: the rig has no pose.
    """
    if not rig.poses:
        raise ConfigError(
            f"{rig.path or rig.name}: has no poses for a release: add a table [poses.NAME] with"
            " theta1 and theta2 (docs/rig-file.md)"
        )

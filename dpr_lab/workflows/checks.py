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


def with_options(
    rig: "Rig",
    *,
    rods: str | None = None,
    elbow: str | None = None,
    arm: str | None = None,
    inner: str | None = None,
) -> "Rig":
    """Return the rig with other mounted rods or joint modes; None keeps the value of the rig file.

    Raises:
        ConfigError: this rig does not support these rods and modes; the message names the options and the reason.
    """
    from pydantic import ValidationError

    from dpr_lab.rig import Rig

    keys = {("rods", "mounted"): rods, ("rods", "elbow"): elbow, ("arm", "mode"): arm, ("joints", "inner"): inner}
    described = rig.model_dump(exclude_unset=True)
    for (table, key), value in keys.items():
        if value is not None and getattr(getattr(rig, table), key) != value:
            described[table] = described.get(table, {}) | {key: value}
    if described == rig.model_dump(exclude_unset=True):
        return rig
    try:
        return Rig.model_validate(described)
    except ValidationError as error:
        named = zip(("rods", "elbow", "arm", "inner"), keys.values(), strict=True)
        given = " ".join(f"--{name} {value}" for name, value in named if value is not None)
        raise ConfigError(f"{given}: {str(error.errors()[0]['msg']).removeprefix('Value error, ')}") from error


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

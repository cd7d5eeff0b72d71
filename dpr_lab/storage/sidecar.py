"""The hash beside a run, `<file>.sha256`, in the format that `sha256sum -c` checks anywhere."""

from pathlib import Path

from dpr_lab.configs import sha256_of


def sidecar_of(path: Path) -> Path:
    """Where a run's hash lies."""
    return path.with_name(path.name + ".sha256")


def write_sidecar(path: Path) -> None:
    """Hash a finished run and write the hash beside it."""
    sidecar_of(path).write_text(f"{sha256_of(path)}  {path.name}\n", encoding="utf-8", newline="\n")


def read_sidecar(path: Path) -> str | None:
    """The hash written when the run was finished, lower-case hex; None when there is no sidecar."""
    try:
        words = sidecar_of(path).read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        return None
    return words[0].lower() if words else ""

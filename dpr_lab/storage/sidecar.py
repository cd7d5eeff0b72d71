"""Files that belong to a run: hash and note. The run itself never changes.

`<file>.sha256` is its hash, in the format that `sha256sum -c` checks anywhere, `<file>.note` an operator's later note.
"""

from pathlib import Path

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError, printable
from dpr_lab.whole_file import regular, write_text

LONGEST_NOTE = 10_000
"""Characters that are read of a note."""


def sidecar_of(path: Path) -> Path:
    """Path of the file with the hash of a run."""
    return path.with_name(path.name + ".sha256")


def write_sidecar(path: Path, content: Path | None = None) -> None:
    """Hash a finished run and write the hash to its own file; `content` is its path before it is renamed."""
    sidecar_of(path).write_text(f"{sha256_of(content or path)}  {path.name}\n", encoding="utf-8", newline="\n")


def read_sidecar(path: Path) -> str | None:
    """The hash written when the run was finished, lower-case hex; None when there is no sidecar."""
    try:
        words = regular(sidecar_of(path), RunError).read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        return None
    return words[0].lower() if words else ""


def note_of(path: Path) -> Path:
    """Path of the file with the later note on a run."""
    return path.with_name(path.name + ".note")


def write_note(path: Path, note: str) -> None:
    """Keep a note of a run that replaces the one it was recorded with.

    Raises:
        RunError: it cannot be written.
    """
    write_text(note_of(path), note, RunError)


def read_note(path: Path, recorded: str) -> str:
    """The note of a run; where there is none, the one that it was recorded with."""
    try:
        return printable(regular(note_of(path), RunError).read_text(encoding="utf-8", errors="replace")[:LONGEST_NOTE])
    except OSError:
        return recorded

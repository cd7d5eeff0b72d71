"""Write and read the hash file and the note file of a run.

`<file>.sha256` contains the hash of the run, in the format of `sha256sum -c`. `<file>.note` contains a note that the
operator wrote after the recording. The run file itself never changes.
"""

from pathlib import Path

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError, printable
from dpr_lab.whole_file import regular, write_text

SIDECAR_SUFFIX = ".sha256"
"""Suffix that is appended to the name of a run for its hash file."""

LONGEST_NOTE = 10_000
"""Maximum number of characters of a note."""


def sidecar_of(path: Path) -> Path:
    """Return the path of the file that contains the hash of a run."""
    return path.with_name(path.name + SIDECAR_SUFFIX)


def write_sidecar(path: Path) -> None:
    """Hash a finished run and write its hash file."""
    sidecar_of(path).write_text(f"{sha256_of(path)}  {path.name}\n", encoding="utf-8", newline="\n")


def read_sidecar(path: Path) -> str | None:
    """Read the hash that was written when a run was finished, in lower-case hexadecimal.

    The result is None if the hash file is missing or empty. The file is empty if the computer lost power while the hash
    was written.
    """
    try:
        words = regular(sidecar_of(path), RunError).read_text(encoding="utf-8", errors="replace").split()
    except OSError:
        return None
    return words[0].lower() if words else None


def note_of(path: Path) -> Path:
    """Return the path of the file that contains a note written after the recording."""
    return path.with_name(path.name + ".note")


def write_note(path: Path, note: str) -> None:
    """Write a note on a run.

    All displays show this note instead of the note of the recording.

    Raises:
        RunError: the note cannot be written.
    """
    write_text(note_of(path), note, RunError)


def read_note(path: Path, recorded: str) -> str:
    """Read the note on a run.

    The note file is preferred to the note of the recording.
    """
    try:
        return printable(regular(note_of(path), RunError).read_text(encoding="utf-8", errors="replace")[:LONGEST_NOTE])
    except OSError:
        return recorded

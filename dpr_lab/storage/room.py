"""Whether a folder takes a recording, asked before anything moves."""

import shutil
from pathlib import Path
from tempfile import TemporaryFile

from dpr_lab.errors import RunError

BYTES_A_SAMPLE = 128
"""Of the run file and of the spool beside it, with a reserve."""


def check_room(folder: Path, samples: float) -> None:
    """Make a folder if need be and see that a recording of so many samples fits into it.

    Raises:
        RunError: it cannot be made or written, or has too little room; with the arithmetic.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{folder}: this folder cannot be made: {error.strerror}") from error
    try:
        with TemporaryFile(dir=folder):
            free, needed = shutil.disk_usage(folder).free, samples * BYTES_A_SAMPLE
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}: choose another folder with --out") from error
    if free < needed:
        raise RunError(
            f"{folder}: {free / 1e6:.0f} MB are free and {samples:,.0f} samples take up to {needed / 1e6:.0f} MB:"
            " make room, record for a shorter time, or choose another folder with --out"
        )

"""Whether a folder takes a recording, asked before anything moves."""

import shutil
from pathlib import Path
from tempfile import TemporaryFile

from dpr_lab.errors import RunError


def check_room(folder: Path, samples: float, bytes_a_sample: int = 128) -> None:
    """Make a folder if need be and see that a recording of so many samples fits into it.

    Args:
        folder: of the run file, and of the spool
        samples: how many are to be recorded
        bytes_a_sample: what one takes in both, with a reserve

    Raises:
        RunError: it cannot be made or written, or has too little room; with the arithmetic.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{folder}: this folder cannot be made: {error.strerror}") from error
    try:
        with TemporaryFile(dir=folder):
            free, needed = shutil.disk_usage(folder).free, samples * bytes_a_sample
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}: choose another folder with --out") from error
    if free < needed:
        raise RunError(
            f"{folder}: {free / 1e6:.0f} MB are free and {samples:,.0f} samples take up to {needed / 1e6:.0f} MB:"
            " make room, record for a shorter time, or choose another folder with --out"
        )

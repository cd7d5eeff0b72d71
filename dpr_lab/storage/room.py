"""Check that enough disk space is free for a recording, before the rig moves."""

import shutil
from pathlib import Path
from tempfile import TemporaryFile

from dpr_lab.errors import RunError


def check_room(folder: Path, samples: float, bytes_a_sample: int = 128) -> None:
    """Check that a recording of a given number of samples fits on the disk.

    The folder is created if needed.

    Args:
        folder: folder of the run file and of the spool
        samples: number of samples to record
        bytes_a_sample: size of a sample in both files, with a reserve

    Raises:
        RunError: the folder cannot be created or written, or has too little space; the message contains the
            calculation.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{folder}: this folder cannot be created: {error.strerror}") from error
    try:
        with TemporaryFile(dir=folder):
            free, needed = shutil.disk_usage(folder).free, samples * bytes_a_sample
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}: choose another folder with --out") from error
    if free < needed:
        raise RunError(
            f"{folder}: {free / 1e6:.0f} MB are free and {samples:,.0f} samples take up to"
            f" {needed / 1e6:.0f} MB: free some space, record for a shorter time, or choose another folder with --out"
        )

"""Temporary file for the samples of a recording, which limits the memory, and check of the free disk space."""

import shutil
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np

from dpr_lab.arrays import Integers
from dpr_lab.errors import RunError
from dpr_lab.rig import JOINTS

_ROW = np.dtype((np.int64, (1 + JOINTS,)))


class Spool:
    """Ticks and counts in order of arrival, in an unnamed temporary file.

    The file is deleted when it is closed.

    Args:
        folder: folder of the temporary file, which takes 32 bytes per sample

    Raises:
        OSError: the file cannot be created. `extend` raises this error if the disk is full.
    """

    def __init__(self, folder: Path) -> None:
        self._used = 0
        self.first_tick = self.last_tick = -1
        """Ticks of the first and the newest sample; -1 if there are no samples."""
        self._file = TemporaryFile(dir=folder, buffering=0)

    def close(self) -> None:
        """Delete the file."""
        self._file.close()

    def __len__(self) -> int:
        return self._used

    @property
    def missing(self) -> int:
        """Number of ticks between the first and the last sample that have no sample."""
        return self.last_tick - self.first_tick + 1 - self._used if self._used else 0

    def extend(self, ticks: Integers, counts: Integers) -> None:
        """Append newer samples: ticks (n,) and position counts (n, 3)."""
        rows = np.column_stack([ticks, counts]).astype(np.int64, copy=False).tobytes()
        self._file.seek(self._used * _ROW.itemsize)
        if self._file.write(rows) != len(rows):
            raise OSError(28, "No space left on device")
        if not self._used:
            self.first_tick = int(ticks[0])
        self.last_tick = int(ticks[-1])
        self._used += len(ticks)

    def newest(self, count: int) -> tuple[Integers, Integers]:
        """Return the ticks (n,) and counts (n, 3) of the last `count` samples.

        If there are fewer samples, all samples are returned.
        """
        return self._read(max(0, self._used - count), self._used)

    def oldest(self, count: int) -> tuple[Integers, Integers]:
        """Return the ticks (n,) and counts (n, 3) of the first `count` samples.

        If there are fewer samples, all samples are returned.
        """
        return self._read(0, min(count, self._used))

    def _read(self, start: int, stop: int) -> tuple[Integers, Integers]:
        self._file.seek(start * _ROW.itemsize)
        rows = np.frombuffer(self._file.read((stop - start) * _ROW.itemsize), dtype=np.int64).reshape(-1, 1 + JOINTS)
        return rows[:, 0], rows[:, 1:]


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
        with TemporaryFile(dir=folder):
            free, needed = shutil.disk_usage(folder).free, samples * bytes_a_sample
    except OSError as error:
        raise RunError(f"{folder}: cannot be written: {error.strerror}: choose another folder with --out") from error
    if free < needed:
        raise RunError(
            f"{folder}: {free / 1e6:.0f} MB are free and {samples:,.0f} samples take up to"
            f" {needed / 1e6:.0f} MB: free some space, record for a shorter time, or choose another folder with --out"
        )

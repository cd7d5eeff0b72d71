"""Run files on a disk that becomes full.

The process has no limit of file sizes: such a limit would also truncate compiled modules and kernels that it writes.
"""

import errno
import os
import sys
from dataclasses import dataclass
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Any

import pytest

from dpr_lab.storage import writer


@dataclass
class FullDisk:
    """Disk that stores at most `room` bytes of a run file."""

    room: int = sys.maxsize

    def create(self, path: Path) -> BufferedWriter:
        """Replacement for `writer._create`."""
        return BufferedWriter(_File(path, self))


class _File(FileIO):
    def __init__(self, path: Path, disk: FullDisk) -> None:
        super().__init__(path, "x")
        self._disk = disk

    def write(self, data: Any) -> int:
        free = self._disk.room - self.tell()
        if free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(memoryview(data)[:free])


def full_disk(monkeypatch: pytest.MonkeyPatch, room: int = sys.maxsize) -> FullDisk:
    """From now on, write all run files to a disk with `room` bytes for each; a test may change it later."""
    disk = FullDisk(room)
    monkeypatch.setattr(writer, "_create", disk.create)
    return disk

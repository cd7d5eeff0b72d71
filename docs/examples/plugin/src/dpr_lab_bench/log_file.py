"""File format: `BENCH1`, a number of columns, their names of 8 bytes each, then rows of float32, little endian."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.readers import Reader
from dpr_lab.storage.readers.arrays import refuse_large, table_of
from dpr_lab.storage.tables.table import Table

RECORD = "bench log"
HEAD = 8


def read_bench(path: Path, take: Sequence[str]) -> Table:
    """Read the columns of a log.

    Raises:
        RunError: the file is damaged, or has more numbers than a recording.
    """
    refuse_large(path, path.stat().st_size // 4)
    data = path.read_bytes()
    count = data[6] if len(data) > 6 else 0
    names = [data[7 + HEAD * i : 7 + HEAD * (i + 1)].rstrip(b"\0 ").decode("ascii", "replace") for i in range(count)]
    rows = data[7 + HEAD * count :]
    if not count or len(rows) % (4 * count):
        raise RunError(f"{path}: is damaged or incomplete: copy it again from the logger")
    columns = np.frombuffer(rows, dtype="<f4").reshape(-1, count).T
    return table_of(path, RECORD, dict(zip(names, columns, strict=True)), take)


READER = Reader(RECORD, (b"BENCH1",), read_bench)

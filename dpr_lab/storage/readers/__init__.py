"""Read data files of many formats as tables; each format has an entry in `READERS`.

arrays        named arrays as columns of a table; limits of their size
merged        rows of a log that contain only other quantities
points        points that were tracked in a video (Tracker, DeepLabCut), as angles
matlab        .mat up to version 7: arrays, structs
hdf5          HDF5, .mat of version 7.3
npz           NumPy's .npz and .npy
parquet       Apache Parquet
joint_states  sensor_msgs/JointState in MCAP files and ROS 2 bags
records       JSON: records of a logger, or lists of numbers
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from dpr_lab.errors import RunError
from dpr_lab.plugins.rows import plugin_rows
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.storage.readers.hdf5 import read_hdf5
from dpr_lab.storage.readers.joint_states import read_bag, read_mcap, read_sqlite
from dpr_lab.storage.readers.matlab import read_matlab
from dpr_lab.storage.readers.npz import read_numpy
from dpr_lab.storage.readers.parquet import read_parquet
from dpr_lab.storage.readers.points import read_text
from dpr_lab.storage.readers.records import SUFFIXES, read_records
from dpr_lab.storage.tables.table import Table
from dpr_lab.whole_file import regular


@dataclass(frozen=True, slots=True)
class Reader:
    """A file format: its first bytes, and the function that reads it."""

    kind: str
    begins: tuple[bytes, ...]
    """Possible first bytes of a file of this format."""
    read: Callable[[Path, Sequence[str]], Table]
    """Function that reads a file and returns a table. Its second argument names the requested parts
    (`ImportOptions.take`)."""


def _refuse_spreadsheet(path: Path, take: Sequence[str]) -> Table:
    raise RunError(f"{path}: is a spreadsheet or another packed document: save its table as CSV (UTF-8) first")


_OWN = (
    Reader("MATLAB file", (b"MATLAB 5.0",), read_matlab),
    Reader("MATLAB file of version 7.3", (b"MATLAB 7.3",), read_hdf5),
    Reader("HDF5 file", (b"\x89HDF\r\n\x1a\n",), read_hdf5),
    Reader("Parquet file", (b"PAR1",), read_parquet),
    Reader("MCAP file", (b"\x89MCAP0\r\n",), read_mcap),
    Reader("ROS 2 bag", (b"SQLite format 3\0",), read_sqlite),
    Reader("NumPy file", (b"\x93NUMPY", b"PK\x03\x04"), read_numpy),
    Reader("spreadsheet", (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",), _refuse_spreadsheet),
)

READERS: tuple[Reader, ...] = (*_OWN, *plugin_rows("readers", Reader, ()).values())
"""Formats in the order in which they are tried. Any other file is read as text, or as text compressed by gzip."""


def read_any(path: Path, take: Sequence[str] = (), on_progress: OnImport = unwatched, *, points: bool = True) -> Table:
    """Read a table of any format.

    Args:
        path: a file, or the folder of a ROS 2 bag
        take: names of the requested parts if a file contains more than one recording (`ImportOptions.take`)
        on_progress: function that is called after each block of a text
        points: whether columns of x and y in a text table are treated as points and converted to angles

    Raises:
        RunError: the file cannot be read, or contains no columns of numbers.
        DprError: a required library is not installed; the message names the library.
    """
    if regular(path, RunError).is_dir():
        return read_bag(path, take)
    try:
        with path.open("rb") as file:
            begin = file.read(16)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}; check its path and permissions") from error
    # MATLAB files of version 4 and JSON have no signature.
    suffix = path.suffix.lower()
    text = partial(read_text, on_progress=on_progress, points=points)
    unmarked = read_matlab if suffix == ".mat" else read_records if suffix in SUFFIXES else text
    return next((reader.read for reader in READERS if begin.startswith(reader.begins)), unmarked)(path, take)

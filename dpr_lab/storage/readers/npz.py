"""Read .npz and .npy files of NumPy; files with pickled objects are refused."""

import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.readers.arrays import library_of, refuse_large, refuse_swollen, table_of
from dpr_lab.storage.tables.table import Table

KIND = "NumPy file"


def read_numpy(path: Path, take: Sequence[str]) -> Table:
    """Read every numeric array of a .npz file, or the array of a .npy file.

    Raises:
        RunError: the file is damaged or is another archive, or it contains pickled objects or more numbers than a
            recording can have.
    """
    with library_of(path, KIND, zipfile.BadZipFile, zlib.error), _plain_arrays(path):
        if not zipfile.is_zipfile(path):
            refuse_large(path, path.stat().st_size // 8)
            with path.open("rb") as file:
                return table_of(path, KIND, {"array": np.load(file, allow_pickle=False)}, take)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if not all(member.filename.endswith(".npy") for member in members):
                raise RunError(
                    f"{path}: is a compressed document, but not .npz: save the table of a spreadsheet as CSV (UTF-8)"
                )
            refuse_swollen(path, sum(member.file_size for member in members))
        with path.open("rb") as file, np.load(file, allow_pickle=False) as held:
            return table_of(path, KIND, {name: held[name] for name in held.files}, take)


@contextmanager
def _plain_arrays(path: Path) -> Iterator[None]:
    """Provide a context that converts the error of NumPy for pickled objects to a message for the operator."""
    try:
        yield
    except ValueError as error:
        if "allow_pickle" not in str(error):
            raise
        reason = "contains pickled objects, which could contain code: save plain arrays of numbers"
        raise RunError(f"{path}: {reason}") from error

"""HDF5, and MATLAB files of version 7.3, which are HDF5."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.storage.export import extra
from dpr_lab.storage.readers.arrays import BROKEN, broken, refuse_large, table_of
from dpr_lab.storage.readers.matlab import object_sentence
from dpr_lab.storage.tables.table import Table

KIND = "HDF5 file"


def read_hdf5(path: Path, take: Sequence[str]) -> Table:
    """Read every numeric data set of an HDF5 file that lies in the file itself.

    Raises:
        RunError: damaged, data that lie in other files, an object of MATLAB's, or more numbers than a recording has.
        DprError: h5py is not installed.
    """
    with extra("hdf5"):
        import h5py
    arrays: dict[str, NDArray] = {}
    total = 0

    def visit(name: str, item: Any) -> None:
        nonlocal total
        if "MATLAB_object_decode" in item.attrs:
            raise object_sentence(path, _text(item.attrs.get("MATLAB_class", "unknown")))
        if name.startswith("#") or not isinstance(item, h5py.Dataset) or item.dtype.kind not in "biuf":
            return
        if item.external or item.is_virtual:
            raise RunError(f"{path}: the numbers of {name!r} lie in another file: copy them into this one")
        total += item.size or 0
        refuse_large(path, total)
        arrays[name] = np.asarray(item[()])

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)  # follows no link out of the file
    except BROKEN as error:
        raise broken(path, KIND, error) from error
    return table_of(path, KIND, arrays, take)


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes | np.bytes_) else str(value)

"""Read HDF5 files, including MATLAB files of version 7.3."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.storage.export import extra
from dpr_lab.storage.readers.arrays import library_of, refuse_swollen, table_of
from dpr_lab.storage.readers.matlab import object_error
from dpr_lab.storage.tables.table import Table

KIND = "HDF5 file"


@dataclass(frozen=True, slots=True)
class TreeLimits:
    """Limits on the number and depth of the groups and data sets of a file.

    The file of a recording contains a few dozen.
    """

    depth: int = 32
    """Maximum nesting depth of groups."""
    objects: int = 2000


LIMITS = TreeLimits()


def read_hdf5(path: Path, take: Sequence[str]) -> Table:
    """Read every numeric data set of an HDF5 file.

    Data sets that are stored in other files are refused.

    Raises:
        RunError: the file is damaged, its data are in other files, or it contains a MATLAB object, too many groups, or
            more numbers than a recording can have.
        DprError: h5py is not installed.
    """
    with extra("hdf5"):
        import h5py
    arrays: dict[str, NDArray] = {}
    total = 0
    with library_of(path, KIND), h5py.File(path, "r") as file:
        for name, held in _objects(path, file):
            if "MATLAB_object_decode" in held.attrs:
                raise object_error(path, _text(held.attrs.get("MATLAB_class", "unknown")))
            if not isinstance(held, h5py.Dataset) or held.dtype.kind not in "biuf":
                continue
            if held.external or held.is_virtual:
                raise RunError(f"{path}: the values of {name!r} are in another file: copy them into this file")
            total += held.size or 0
            refuse_swollen(path, 8 * total)
            arrays[name] = np.asarray(held[()])
    return table_of(path, KIND, arrays, take)


def _objects(path: Path, file: Any) -> list[tuple[str, Any]]:
    """List each group and data set of a file once, together with its name.

    Links to other files are not followed. Internal groups of MATLAB, whose names begin with `#`, are omitted with their
    content.

    Raises:
        RunError: the file contains too many objects, or groups in too many levels.
    """
    objects: list[tuple[str, Any]] = []

    def add(name: str, held: Any) -> None:
        if len(objects) > LIMITS.objects or name.count("/") > LIMITS.depth:
            raise RunError(
                f"{path}: contains groups in more than {LIMITS.depth} levels or more than {LIMITS.objects:,} data"
                " sets, which is too much for a recording: copy the columns of one recording into a new file"
            )
        if not any(part.startswith("#") for part in name.split("/")):
            objects.append((name, held))

    file.visititems(add)
    return objects


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes | np.bytes_) else str(value)

"""Read MATLAB files up to version 7: arrays and structs of arrays.

MATLAB objects contain code and are refused.
"""

import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.storage.readers.arrays import library_of, refuse_large, refuse_swollen, table_of
from dpr_lab.storage.tables import table as text_table
from dpr_lab.storage.tables.content import most_unpacked
from dpr_lab.storage.tables.table import Table

KIND = "MATLAB file"
HEADER, TAG, COMPRESSED = 128, 8, 15
"""Sizes of the file header and of the tag of an element, bytes, and type of a compressed element (MAT-File Format,
2024)."""


def object_error(path: Path, class_name: str) -> RunError:
    """Create the error for a file that contains a MATLAB object."""
    commands = "s.time = ts.Time; s.data = ts.Data; save('swing.mat', '-struct', 's')"
    return RunError(
        f"{path}: contains an object of the MATLAB class {class_name}, which only MATLAB can read: save it"
        f" as a struct: {commands}"
    )


def read_matlab(path: Path, take: Sequence[str]) -> Table:
    """Read every numeric array in a .mat file, including those in structs.

    Raises:
        RunError: the file cannot be read, contains an object, or contains more numbers than a recording can have.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    held: dict[str, Any] = {}
    with library_of(path, KIND, MatReadError, struct.error, zlib.error):
        content = path.read_bytes() if path.stat().st_size <= _most_bytes() else b""
        if not content:
            refuse_large(path, path.stat().st_size // 8)
            raise RunError(f"{path}: is empty; check the path, or write the table again")
        for part in _parts(path, content) if content.startswith(b"MATLAB 5.0") else (content,):
            held |= loadmat(BytesIO(part), simplify_cells=False, chars_as_strings=False)
    return table_of(path, KIND, dict(_arrays(path, "", held)), take)


def _most_bytes() -> int:
    return 8 * text_table.LIMITS.values


def _parts(path: Path, content: bytes) -> Iterator[bytes]:
    """Split a MATLAB file into one uncompressed file for each element.

    Declared sizes are not trusted. Memory contains only one element at a time and the numbers that are already read.
    """
    order = "<" if content[126:HEADER] == b"IM" else ">"
    total, position = HEADER, HEADER
    most = min(_most_bytes(), most_unpacked(path, text_table.LIMITS))
    if len(content) < position + TAG:
        yield content
    while position + TAG <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, position)
        end = position + TAG + size
        element = content[position:end]
        if kind == COMPRESSED:
            element = zlib.decompressobj().decompress(content[position + TAG : end], most + 1 - total)
        total += len(element)
        if total > most:
            refuse_large(path, total // 8 + 1)
            refuse_swollen(path, total)
        yield content[:HEADER] + element
        position = end


def _arrays(path: Path, within: str, held: Mapping[str, Any]) -> Iterator[tuple[str, NDArray]]:
    """Yield the names and values of all arrays in a struct and in nested structs."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    for key, value in held.items():
        if key.startswith("__") or not isinstance(value, np.ndarray):
            continue
        name = f"{within}{key}"
        if isinstance(value, MatlabOpaque):
            raise object_error(path, _class_of(value))
        if isinstance(value, MatlabObject):
            raise object_error(path, str(value.classname))
        if value.dtype.names and value.size == 1 and not isinstance(value, MatlabFunction):
            fields = value.reshape(-1)[0]
            yield from _arrays(path, f"{name}/", {field: fields[field] for field in value.dtype.names})
        else:
            yield name, value


def _class_of(opaque: Any) -> str:
    """Return the MATLAB class of an object, the last text in its header.

    Before scipy 1.18, the texts of the header are bytes.
    """
    header = opaque.reshape(-1)[0]
    texts = [part for part in header if isinstance(part, bytes | str)]
    names = [part.decode("latin-1") if isinstance(part, bytes) else part for part in texts]
    return names[-1] if names else "unknown"

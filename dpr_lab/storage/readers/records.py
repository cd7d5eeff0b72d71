"""Read JSON files: records in a list or line by line, or lists of numbers.

Loggers write each sample as a separate object, `{"t": 0.01, "theta1": 3.1}`, in a list or on its own line. Often the
file also contains values that describe the recording. The longest list of objects is read as the table. If there is no
such list, each list of numbers is a column. Numbers in nested objects and lists become columns. The name of such a
column is the path of the number, for example `imu/gyro[1]`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.storage.readers.arrays import library_of, refuse_large, table_of
from dpr_lab.storage.tables.table import Table

KIND = "JSON file"
SUFFIXES = (".json", ".jsonl", ".ndjson")


def read_records(path: Path, take: Sequence[str]) -> Table:
    """Read the records or the lists of numbers of a JSON file.

    Raises:
        RunError: the file is not JSON, contains no numbers in lists or records, or contains more numbers than a
            recording can have.
    """
    refuse_large(path, path.stat().st_size // 8)
    with library_of(path, KIND):
        document = _document(path.read_text(encoding="utf-8-sig"))
    lists = dict(_lists("", document))
    records = {name: rows for name, rows in lists.items() if any(isinstance(row, dict) for row in rows)}
    if not records:
        return table_of(path, KIND, {name or "array": _array(rows) for name, rows in lists.items()}, take)
    name = max(records, key=lambda key: len(records[key]))
    rows = [dict(_values("", row)) for row in records[name] if isinstance(row, dict)]
    keys = dict.fromkeys(key for row in rows for key in row)
    columns = {key: np.array([row.get(key, np.nan) for row in rows]) for key in keys}
    if not columns:
        raise RunError(f"{path}: the records of {name or 'its list'} contain no numbers")
    return table_of(path, KIND, columns, take)


def _document(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        return [json.loads(line) for line in text.splitlines() if line.strip()]


def _lists(name: str, value: Any) -> Iterator[tuple[str, list[Any]]]:
    """Yield name and content of each list in a document.

    Lists within lists are not yielded separately.
    """
    if isinstance(value, list):
        yield name, value
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _lists(f"{name}/{key}" if name else str(key), inner)


def _values(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield name and value of each number in a record.

    A missing value (null) becomes NaN. Truth values are omitted.
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _values(f"{name}/{key}" if name else str(key), inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value, 1):
            yield from _values(f"{name}[{place}]", inner)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield name, float(value)


def _array(rows: list[Any]) -> NDArray[Any]:
    """Convert a list to an array of numbers; missing values become NaN.

    For other content, the result is an array of text.
    """
    try:
        return np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        return np.array([""])

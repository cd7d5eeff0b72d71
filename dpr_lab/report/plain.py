"""Format results as JSON, and write them as files.

All numbers of a result should be finite. A number that is not finite is written as null, with a warning.
"""

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dpr_lab.whole_file import write_text


class NotFinite(RuntimeWarning):
    """Warning that a result contains a number that is not finite."""


def as_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]], indent: int | None = 1) -> str:
    """Format an object or a list of objects as JSON.

    The text has one line if `indent` is None. A warning `NotFinite` names the key of each number that is not finite.
    """
    return json.dumps(_finite(result, "result"), indent=indent, default=str, allow_nan=False)


def write_json(result: Mapping[str, Any], path: Path) -> None:
    """Write a JSON object atomically.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    write_text(path, as_json(result) + "\n")


def _finite(value: Any, key: str) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        warnings.warn(f"{key} is {value}, not a finite number: null is written instead", NotFinite, stacklevel=2)
        return None
    if isinstance(value, Mapping):
        return {str(name): _finite(part, f"{key}.{name}") for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part, f"{key}[{i}]") for i, part in enumerate(value)]
    return value

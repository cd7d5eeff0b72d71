"""Results as text: JSON on stdout or in a file, and HTML.

No result holds a number that is not finite. One that does is a bug: it is warned of, and null is written in its place.
"""

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from dpr_lab.errors import printable


class NotFinite(RuntimeWarning):
    """A result holds a number that is not finite."""


def escaped(text: str) -> str:
    """Text as it stands in HTML, in an element or an attribute."""
    return escape(printable(text))


def as_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> str:
    """One JSON object or a list of them, indented.

    Warns `NotFinite` of a number that is not finite, with its key.
    """
    return json.dumps(_finite(result, "result"), indent=1, default=str, allow_nan=False)


def _finite(value: Any, key: str) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        warnings.warn(f"{key} is {value}, no finite number: null is written in its place", NotFinite, stacklevel=2)
        return None
    if isinstance(value, Mapping):
        return {str(name): _finite(part, f"{key}.{name}") for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part, f"{key}[{i}]") for i, part in enumerate(value)]
    return value

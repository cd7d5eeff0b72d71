"""Results as text: JSON on stdout or in a file, where numbers that are not finite become null; and in HTML."""

import json
import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from dpr_lab.errors import printable


def escaped(text: str) -> str:
    """Text as it stands in HTML, in an element or an attribute."""
    return escape(printable(text))


def as_json(result: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> str:
    """One JSON object or a list of them, indented."""
    return json.dumps(_finite(result), indent=1, default=str)


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value

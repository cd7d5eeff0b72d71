"""Convert tables to TOML text, because the standard library can only read TOML."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any]) -> str:
    """Convert nested tables to TOML text; numbers keep all digits.

    The values are text, numbers, truth values and lists of these.
    """
    return "\n".join(_lines(table, ())) + "\n"


def _lines(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    if path:
        yield f"\n[{'.'.join(path)}]"
    inner = {name: value for name, value in table.items() if isinstance(value, Mapping)}
    for name, value in table.items():
        if name not in inner:
            yield f"{_key(name)} = {_value(value)}"
    for name, value in inner.items():
        yield from _lines(value, (*path, _key(name)))


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _value(name)


def _value(value: Any) -> str:
    """Return the value in TOML.

    The JSON notation of these types is also TOML, except for one control character that JSON does not escape.
    """
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")

"""Conversion of dataclasses to and from the byte layout defined by a DBC.

A message whose signals all consist of whole bytes is converted by `struct` with a format derived from the DBC. The
conversion of a sample takes less than a microsecond. A message with single bits or pages is converted by cantools.
"""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from operator import attrgetter
from typing import Any, cast, get_type_hints

from cantools.database.can import Message as Layout
from cantools.database.can import Signal

_STRUCT_CODES = {8: "b", 16: "h", 32: "i"}

Pack = Callable[..., bytes]
Unpack = Callable[[bytes], Sequence[int]]
Convert = Callable[[int], int]


@dataclass(frozen=True, slots=True)
class Codec:
    """Conversion of one kind of message to bytes and back.

    For a value out of range, `pack` raises `struct.error`, `ValueError` or `EncodeError` of cantools, and `unpack`
    raises `ValueError`.
    """

    number: int
    length: int
    pack: Callable[[Any], bytes]
    unpack: Callable[[bytes], Any]


def plain_codec(kind: type[Any], layout: Layout) -> Codec:
    """Create the codec of a dataclass whose fields are the signals of the message, in the same order."""
    names = [field.name for field in fields(kind)]
    assert names == [signal.name for signal in layout.signals], f"{kind.__name__} and the DBC differ"
    to_bytes, from_bytes = _struct_pair(layout) if _whole_bytes(layout) else _cantools_pair(layout)
    values = _getter(names)
    hints = get_type_hints(kind)
    converters = [_converter(hints[signal.name], signal) for signal in layout.signals]
    if not any(converters):
        return Codec(
            layout.frame_id,
            layout.length,
            pack=lambda message: to_bytes(*values(message)),
            unpack=lambda data: kind(*from_bytes(data)),
        )
    checks = [convert or int for convert in converters]
    return Codec(
        layout.frame_id,
        layout.length,
        pack=lambda message: to_bytes(*_apply(checks, values(message))),
        unpack=lambda data: kind(*_apply(checks, from_bytes(data))),
    )


def paged_codec(kind: type[Any], layout: Layout) -> Codec:
    """Create the codec of a dataclass with a page number, and with the signals of this page by name."""
    pages = range(1 + int(layout.get_signal_by_name("page").maximum or 0))

    def unpack(data: bytes) -> Any:
        page = data[0]
        if page not in pages:  # a message of a newer minor version; only its existence is known
            return kind(page, {})
        raw = cast(dict[str, int], layout.decode_simple(data, decode_choices=False))
        return kind(page, {name: value for name, value in raw.items() if name != "page"})

    return Codec(
        layout.frame_id,
        layout.length,
        pack=lambda message: bytes(layout.encode({"page": message.page, **message.fields})),
        unpack=unpack,
    )


def _apply(checks: list[Convert], values: Sequence[int]) -> list[int]:
    return [check(value) for check, value in zip(checks, values, strict=True)]


def _getter(names: list[str]) -> Callable[[Any], tuple[int, ...]]:
    if len(names) > 1:
        return attrgetter(*names)
    return lambda message: tuple(getattr(message, name) for name in names)


def _converter(hint: type, signal: Signal) -> Convert | None:
    """Create a function that converts a raw value to a field and refuses invalid values; None if all are valid."""
    if hint is bool or issubclass(hint, IntEnum):
        return hint
    lowest, highest = cast(int, signal.minimum), cast(int, signal.maximum)
    if highest - lowest == (1 << signal.length) - 1:
        return None

    def in_range(value: int) -> int:
        if not lowest <= value <= highest:
            raise ValueError(f"{signal.name} = {value} is not in {lowest} .. {highest}")
        return value

    return in_range


def _whole_bytes(layout: Layout) -> bool:
    return all(signal.start % 8 == 0 and signal.length in _STRUCT_CODES for signal in layout.signals)


def _struct_pair(layout: Layout) -> tuple[Pack, Unpack]:
    form, position = "<", 0
    for signal in layout.signals:
        code = _STRUCT_CODES[signal.length]
        form += "x" * (signal.start // 8 - position) + (code if signal.is_signed else code.upper())
        position = (signal.start + signal.length) // 8
    compiled = struct.Struct(form + "x" * (layout.length - position))
    return compiled.pack, compiled.unpack


def _cantools_pair(layout: Layout) -> tuple[Pack, Unpack]:
    names = [signal.name for signal in layout.signals]

    def pack(*values: int) -> bytes:
        return bytes(layout.encode(dict(zip(names, values, strict=True))))

    def unpack(data: bytes) -> list[int]:
        raw = cast(dict[str, int], layout.decode_simple(data, decode_choices=False))
        return [raw[name] for name in names]

    return pack, unpack

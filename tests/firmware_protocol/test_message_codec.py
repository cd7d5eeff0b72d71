from enum import IntEnum
from pathlib import Path
from typing import get_type_hints

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

import firmware_protocol
from firmware_protocol.errors import LocalProtocolError, RemoteProtocolError
from firmware_protocol.messages import (
    MESSAGES,
    NUMBERS,
    Ack,
    Event,
    EventKind,
    Frame,
    Info,
    Message,
    Position,
    Release,
    Sample,
    Stop,
    decode,
    encode,
    frame_id,
)

DBC = cantools.database.load_file(Path(firmware_protocol.__file__).with_name("dpr.dbc"))


def values(signal) -> st.SearchStrategy[int]:
    if signal.choices and signal.name != "command":
        return st.sampled_from(sorted(int(value) for value in signal.choices))
    return st.integers(int(signal.minimum), int(signal.maximum))


@st.composite
def messages(draw: st.DrawFn) -> tuple[str, dict[str, int], Message]:
    """Name of a message, its signals as integers, and the message as a dataclass."""
    name = draw(st.sampled_from(sorted(MESSAGES)))
    kind, layout = MESSAGES[name], DBC.get_message_by_name(name)
    if kind is Info:
        pages = layout.signal_tree[0]["page"]
        page = draw(st.sampled_from(sorted(pages)))
        result = {signal: draw(values(layout.get_signal_by_name(signal))) for signal in pages[page]}
        return name, {"page": page, **result}, Info(page, result)
    raw = {signal.name: draw(values(signal)) for signal in layout.signals}
    hints = get_type_hints(kind)
    typed = {
        field: hints[field](value) if hints[field] is bool or issubclass(hints[field], IntEnum) else value
        for field, value in raw.items()
    }
    return name, raw, kind(**typed)


@given(messages(), st.integers(0, 31))
def test_encoding_is_what_cantools_makes_of_the_dbc(drawn: tuple[str, dict[str, int], Message], node: int):
    name, raw, message = drawn
    layout = DBC.get_message_by_name(name)
    frame = encode(message, node)
    assert frame == Frame(frame_id(node, layout.frame_id), layout.encode(raw) if raw else b"")
    assert (frame.node, frame.number) == (node, layout.frame_id)


@given(messages())
def test_decoding_gives_back_values_and_types(drawn: tuple[str, dict[str, int], Message]):
    message = drawn[2]
    back = decode(encode(message))
    assert back == message
    if not isinstance(message, Info):
        for field, hint in get_type_hints(type(message)).items():
            assert type(getattr(back, field)) is hint


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_any_frame_decodes_or_is_refused_and_what_decodes_is_what_cantools_reads(identifier: int, data: bytes):
    frame = Frame(identifier, data)
    try:
        message = decode(frame)
    except RemoteProtocolError:
        return
    name = next(name for name, kind in MESSAGES.items() if kind is type(message))
    layout = DBC.get_message_by_name(name)
    assert identifier & 63 == layout.frame_id
    if isinstance(message, Info):
        raw = {"page": message.page, **message.fields}
        assert message.page > 7 or raw == layout.decode(data, decode_choices=False)
    elif layout.signals:
        raw = {signal.name: getattr(message, signal.name) for signal in layout.signals}
        assert raw == layout.decode(data, decode_choices=False)


@pytest.mark.parametrize(
    "message",
    [
        Sample(65536, 0, 0, 0),
        Sample(0, -1, 0, 0),
        Position(3, 0, 0),
        Position(0, 0, 1 << 31),
        Event(9, 0, 0),
        Release(1, key=0xD0B0),
        Stop(256),
        Info(7, {"rate_max_hz": 0, "rate_default_hz": 1}),
        Info(3, {"uid_low": 1}),
        Info(8, {}),
    ],
    ids=str,
)
def test_a_value_out_of_range_is_our_fault(message: Message):
    with pytest.raises(LocalProtocolError):
        encode(message)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (Frame(frame_id(1, 63), b""), "63 is not in dpr.dbc"),
        (Frame(frame_id(1, NUMBERS[Sample]), bytes(7)), "SAMPLE has 7 bytes, not 8"),
        (Frame(frame_id(1, NUMBERS[Event]), bytes(8)), "0 is not a valid EventKind"),
        (Frame(frame_id(1, NUMBERS[Position]), b"\3" + bytes(7)), "joint = 3"),
        (Frame(frame_id(1, NUMBERS[Release]), bytes(3)), "key = 0"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_invalid_frame_is_refused_with_a_reason(frame: Frame, reason: str):
    with pytest.raises(RemoteProtocolError, match=reason):
        decode(frame)


def test_a_page_of_a_newer_minor_version_is_known_to_exist_and_no_more():
    assert decode(Frame(frame_id(1, NUMBERS[Info]), b"\x2a1234567")) == Info(42, {})


def test_spare_bytes_are_zero_and_not_read():
    frame = encode(Event(EventKind.RELEASED, 0, 5))
    assert frame.data[6:] == b"\0\0"
    assert decode(Frame(frame.id, frame.data[:6] + b"\xaa\xbb")) == Event(EventKind.RELEASED, 0, 5)


def test_frame_id_refuses_what_does_not_fit():
    assert frame_id(31, 63) == 0x7FF
    for node, number in ((32, 0), (-1, 0), (0, 64), (0, -1)):
        with pytest.raises(ValueError, match="must be below"):
            frame_id(node, number)


def test_the_node_does_not_change_the_message():
    assert decode(encode(Ack(33, 4), 17)) == decode(encode(Ack(33, 4), 0)) == Ack(33, 4)

"""Frames and messages of the C core equal golden frames, and those of the Python implementation for any bytes."""

import ctypes
import json
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import firmware_protocol
from firmware_protocol.definition import DATABASE
from firmware_protocol.device_role import DeviceSession
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import ArmQuantity, Frame, Hello, TorqueKind, encode
from sim_device.firmware.c_firmware import CFraming, Firmware

VECTORS = json.loads(Path(firmware_protocol.__file__).with_name("vectors.json").read_text(encoding="utf-8"))

frames = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))
noise = st.one_of(frames.map(encode_frame), st.binary(max_size=40), st.lists(st.integers(0, 3), max_size=20).map(bytes))


pytestmark = pytest.mark.usefixtures("library")


@pytest.fixture(scope="module")
def framing(library: ctypes.PyDLL):
    return lambda: CFraming(library)


def struct_of(name: str) -> type[ctypes.Structure]:
    """The generated C structure of a message."""
    signals = DATABASE.get_message_by_name(name).signals

    class Generated(ctypes.Structure):
        _fields_ = tuple((s.name, _integer(s.length, s.is_signed)) for s in signals) or (("dummy", ctypes.c_uint8),)

    return Generated


def _integer(bits: int, signed: bool) -> type:
    size = next(size for size in (8, 16, 32) if bits <= size)
    return getattr(ctypes, f"c_{'int' if signed else 'uint'}{size}")


@pytest.mark.parametrize("row", VECTORS["frames"], ids=lambda row: row.get("serial", row["message"]))
def test_golden_frame(row, library, framing):
    data, name = bytes.fromhex(row["data"]), row["message"].lower()
    message, packed = struct_of(row["message"])(**row["fields"]), ctypes.create_string_buffer(8)
    assert library[f"dpr_{name}_pack"](packed, ctypes.byref(message), ctypes.c_size_t(8)) == len(data)
    assert packed.raw[: len(data)] == data
    assert framing().encode(Frame(row["id"], data)).hex() == row["serial"]
    assert framing().decode(bytes.fromhex(row["serial"])) == ([Frame(row["id"], data)], b"")
    unpacked = struct_of(row["message"])()
    assert library[f"dpr_{name}_unpack"](ctypes.byref(unpacked), data, ctypes.c_size_t(len(data))) == 0
    assert {field: getattr(unpacked, field) for field in row["fields"]} == row["fields"]


@pytest.mark.parametrize("row", VECTORS["rejected"], ids=lambda row: row["why"])
def test_golden_rejection(row, framing):
    decoder = framing()
    assert decoder.decode(bytes.fromhex(row["serial"])) == ([], b"")
    assert decoder.errors == {"crc": 0, "framing": 0, row["cause"]: 1}


def test_crc_check_value(library):
    library.dpr_crc16.restype = ctypes.c_uint16
    assert library.dpr_crc16(b"123456789", ctypes.c_size_t(9)) == 0x29B1


@pytest.mark.slow
@given(frames)
def test_any_frame_is_framed_as_python_does(framing, frame):
    assert framing().encode(frame) == encode_frame(frame)


@pytest.mark.slow
@given(st.lists(noise, max_size=12), st.lists(st.integers(0, 400), max_size=6))
def test_any_bytes_in_any_pieces_give_what_python_finds(framing, pieces, cuts):
    line = b"".join(pieces)
    edges = [0, *sorted(cut % (len(line) + 1) for cut in cuts), len(line)]
    ours, theirs = framing(), FrameDecoder()
    for start, end in pairwise(edges):
        assert ours.decode(line[start:end])[0] == theirs.feed(line[start:end])
        assert ours.errors == {"crc": theirs.crc_errors, "framing": theirs.framing_errors}


@pytest.mark.parametrize(("torques", "inputs"), [tuple(TorqueKind), tuple(reversed(TorqueKind))])
def test_the_greeting_has_the_identity_as_python_sends_it(library, torques: TorqueKind, inputs: TorqueKind):
    """Each joint and each part of the version has a value of its own, so that no two can be exchanged."""
    info = DeviceInfo(
        "1.22.3",
        "0123456789abcdef",
        (16384, 4096, 1 << 20),
        rate_max_hz=4000,
        rate_default_hz=100,
        simulated_time=True,
        torque_kinds=(torques,),
        torque_unit_uNm=50,
        input_kinds=(inputs,),
        input_unit=7,
        input_quantity=ArmQuantity.VOLTAGE,
    )
    hello = encode(Hello(1))
    frames = Firmware(info, library=library).receive(hello, 0, 0.0)
    assert frames == list(DeviceSession(info).receive(hello, 0.0).frames)

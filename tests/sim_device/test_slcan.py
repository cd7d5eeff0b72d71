"""The CAN adapter in ASCII."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.messages import Frame
from sim_device.links.slcan import LONGEST_LINE, SlcanCodec

frames = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))


def on_bus(bitrate: int = 1_000_000) -> SlcanCodec:
    codec = SlcanCodec(bitrate)
    codec.decode(b"S8\rO\r")
    return codec


def test_a_channel_that_is_closed_carries_nothing():
    codec = SlcanCodec(1_000_000)
    assert codec.encode(Frame(0x41, b"\1")) == b""
    assert codec.decode(b"t0411AA\r") == ([], b"\a")
    assert codec.decode(b"S8\rO\r") == ([], b"\r\r")
    assert codec.encode(Frame(0x41, b"\1\xab")) == b"t041201ab\r"
    assert codec.decode(b"C\rt0411AA\r") == ([], b"\r\a")


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"V", b"V1013\r"),
        (b"N", b"NS1M0\r"),
        (b"F", b"F00\r"),
        (b"", b"\r"),
        (b"S6", b"\a"),
        (b"O", b"\a"),
        (b"Q", b"\a"),
        (b"t0412AA", b"\a"),
        (b"t0xx0", b"\a"),
        (b"tFFF0", b"\a"),
        (b"t-010", b"\a"),
        (b"t", b"\a"),
        (b"t0419112233445566778899", b"\a"),
        (b"t0412zz", b"\a"),
        (b"\xff\xfe", b"\a"),
        (b"t0411\xe9\xe9", b"\a"),
        (b"T000000410", b"Z\r"),
        (b"r0410", b"z\r"),
        (b"R000000410", b"Z\r"),
    ],
)
def test_commands_are_answered(line, answer):
    assert on_bus().decode(line + b"\r") == ([], answer)


@given(st.lists(frames, max_size=8), st.data())
def test_frames_pass_however_the_bytes_are_cut(sent, data):
    text = b"".join(on_bus().encode(frame) for frame in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(text)), max_size=5)))
    codec, received, answers = on_bus(), [], b""
    for start, stop in zip([0, *cuts], [*cuts, len(text)], strict=True):
        result, answer = codec.decode(text[start:stop])
        received += result
        answers += answer
    assert received == sent
    assert answers == b"z\r" * len(sent)


@given(st.binary(max_size=300))
def test_noise_is_survived(noise):
    codec = on_bus()
    codec.decode(noise + b"\r")
    codec.decode(b"C\rS8\rO\r")
    assert codec.decode(b"t0411AA\r") == ([Frame(0x41, b"\xaa")], b"z\r")


def test_an_endless_line_does_not_grow():
    codec = on_bus()
    for _ in range(50):
        codec.decode(b"A" * LONGEST_LINE)
    assert codec.decode(b"\rt0410\r")[0] == [Frame(0x41, b"")]


def test_at_another_bit_rate_nothing_is_received_or_sent():
    codec = on_bus(500_000)
    assert codec.encode(Frame(0x41, b"")) == b""
    assert codec.decode(b"t0410\r") == ([], b"z\r")

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.errors import LocalProtocolError, RemoteProtocolError
from firmware_protocol.framing import MAX_ENCODED, FrameDecoder, cobs_decode, cobs_encode, crc16, encode_frame
from firmware_protocol.messages import Frame

frames = st.builds(Frame, st.integers(0, 0x7FF), st.binary(max_size=8))


def crc_by_bits(data: bytes) -> int:
    """CRC-16/IBM-3740 bit by bit: shift in a bit, and subtract the polynomial if a bit is shifted out."""
    crc = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            out = (crc >> 15) ^ (byte >> bit & 1)
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if out else 0)
    return crc


def cobs_by_definition(data: bytes) -> bytes:
    """COBS byte by byte: each group has at most 254 bytes and starts with the distance to the next zero."""
    out, group = bytearray(), bytearray()
    for byte in data + b"\0":
        if byte:
            group.append(byte)
        if not byte or len(group) == 254:
            out += bytes([len(group) + 1]) + group
            group.clear()
    return bytes(out)


def split(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


def test_crc_check_value():
    assert crc16(b"123456789") == 0x29B1


@given(st.binary(max_size=20))
def test_crc_is_the_bitwise_one(data: bytes):
    assert crc16(data) == crc_by_bits(data)


@given(st.lists(st.one_of(st.just(b"\0"), st.binary(max_size=5), st.just(b"x" * 254)), max_size=6).map(b"".join))
def test_cobs_is_the_bytewise_one_and_comes_back(data: bytes):
    encoded = cobs_encode(data)
    assert encoded == cobs_by_definition(data)
    assert 0 not in encoded
    assert cobs_decode(encoded) == data


@pytest.mark.parametrize("packet", [b"", b"\x01\x00", b"\x03\x11", b"\xff\x11"])
def test_broken_cobs_is_refused(packet: bytes):
    with pytest.raises(RemoteProtocolError):
        cobs_decode(packet)


def test_eight_bytes_of_data_make_fourteen():
    assert len(encode_frame(Frame(0x42, bytes(8)))) == len(encode_frame(Frame(0x42, b"\xff" * 8))) == 14


@pytest.mark.parametrize("frame", [Frame(0x800, b""), Frame(-1, b""), Frame(1, bytes(9))], ids=str)
def test_no_frame_no_bytes(frame: Frame):
    with pytest.raises(LocalProtocolError):
        encode_frame(frame)


@given(st.lists(st.one_of(frames.map(encode_frame), st.binary(max_size=40)), max_size=8), st.lists(st.integers(0, 500)))
def test_chunking_never_matters(pieces: list[bytes], cuts: list[int]):
    line = b"".join(pieces) + b"\0"
    whole, cut = FrameDecoder(), FrameDecoder()
    expected = whole.feed(line)
    assert [frame for chunk in split(line, cuts) for frame in cut.feed(chunk)] == expected
    assert (cut.crc_errors, cut.framing_errors) == (whole.crc_errors, whole.framing_errors)


@given(st.lists(frames, min_size=1, max_size=10), st.lists(st.integers(0, 500)))
def test_clean_frames_all_arrive_and_nothing_is_counted(sent: list[Frame], cuts: list[int]):
    decoder = FrameDecoder()
    line = b"".join(map(encode_frame, sent))
    assert [frame for chunk in split(line, cuts) for frame in decoder.feed(chunk)] == sent
    assert (decoder.crc_errors, decoder.framing_errors) == (0, 0)


@given(st.lists(frames, min_size=1, max_size=6), st.lists(frames, min_size=1, max_size=6), st.binary(max_size=60))
def test_noise_between_frames_costs_at_most_the_next_one(before: list[Frame], after: list[Frame], noise: bytes):
    decoder = FrameDecoder()
    received = decoder.feed(b"".join(map(encode_frame, before)) + noise + b"".join(map(encode_frame, after)))
    assert received[: len(before)] == before
    assert received[-(len(after) - 1) :] == after[1:] or len(after) == 1


@given(
    st.lists(frames, min_size=3, max_size=8),
    st.integers(0, 10_000),
    st.integers(0, 255),
)
def test_a_damaged_byte_costs_at_most_the_frames_it_touches(sent: list[Frame], at: int, value: int):
    line = bytearray(b"".join(map(encode_frame, sent)))
    at %= len(line)
    was, line[at] = line[at], value
    received = FrameDecoder().feed(bytes(line))
    lost = [n for n, frame in enumerate(sent) if frame not in received]
    touched = bytes(line[:at]).count(0)
    assert set(lost) <= ({touched} if was else {touched, touched + 1})


@given(frames)
def test_every_single_flipped_bit_is_rejected(frame: Frame):
    packet = encode_frame(frame)[:-1]
    for bit in range(8 * len(packet)):
        damaged = bytearray(packet)
        damaged[bit // 8] ^= 1 << bit % 8
        decoder = FrameDecoder()
        received = decoder.feed(bytes(damaged) + b"\0")
        assert received == []
        assert decoder.crc_errors + decoder.framing_errors >= 1


def test_a_line_without_zeros_takes_no_memory_and_counts_once():
    decoder = FrameDecoder()
    for _ in range(1000):
        assert decoder.feed(b"U" * 1000) == []
    assert decoder.framing_errors == 1
    assert len(decoder._rest) <= MAX_ENCODED
    good = Frame(0x41, b"12345678")
    assert decoder.feed(b"U\0" + encode_frame(good)) == [good]
    assert decoder.framing_errors == 1


def test_zeros_between_frames_are_ignored():
    decoder = FrameDecoder()
    good = Frame(0x41, b"")
    assert decoder.feed(b"\0\0\0" + encode_frame(good) + b"\0\0") == [good]
    assert (decoder.crc_errors, decoder.framing_errors) == (0, 0)

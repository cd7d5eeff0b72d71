import os
import pty
import select
import tty
from collections.abc import Iterator
from itertools import chain, count, repeat
from types import SimpleNamespace
from typing import Any

import can
import pytest

from dpr_lab.errors import DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports import can_bus, open_transport
from dpr_lab.transports.slcan import SlcanDecoder
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.messages import Frame

SAMPLE = Frame(66, bytes(range(8)))


@pytest.fixture
def peer() -> Iterator[can.BusABC]:
    bus = can.Bus(interface="virtual", channel="transport-test", ignore_config=True)
    yield bus
    bus.shutdown()


@pytest.fixture
def adapter() -> Iterator[tuple[int, str]]:
    """Adapter end of an SLCAN line, and path of the host end."""
    device, host = pty.openpty()
    tty.setraw(host)
    yield device, os.ttyname(host)
    for descriptor in (device, host):
        try:
            os.close(descriptor)
        except OSError:
            pass


def test_virtual_bus_carries_frames_both_ways(peer: can.BusABC) -> None:
    link = open_transport("can://virtual/transport-test")
    for _ in range(1000):
        peer.send(can.Message(arbitration_id=SAMPLE.id, data=SAMPLE.data, is_extended_id=False))
    frames: list[Frame] = []
    raw = b""
    while len(frames) < 1000:
        received = link.receive(1.0)
        frames += received.frames
        raw += received.raw
    assert frames == [SAMPLE] * 1000
    assert FrameDecoder().feed(raw) == frames
    link.send(Frame(96, b"\x01"))
    heard = peer.recv(1.0)
    assert heard is not None
    assert (heard.arbitration_id, bytes(heard.data), heard.is_extended_id) == (96, b"\x01", False)
    assert link.receive(0.05).frames == ()
    link.close()
    link.close()


def test_frames_of_other_kinds_are_skipped_and_error_frames_counted(peer: can.BusABC) -> None:
    link = open_transport("can://virtual/transport-test")
    peer.send(can.Message(arbitration_id=66, data=b"1", is_extended_id=True))
    peer.send(can.Message(arbitration_id=66, is_remote_frame=True, is_extended_id=False))
    peer.send(can.Message(arbitration_id=66, data=b"1", is_fd=True, is_extended_id=False))
    peer.send(can.Message(is_error_frame=True))
    peer.send(can.Message(arbitration_id=SAMPLE.id, data=SAMPLE.data, is_extended_id=False))
    assert link.receive(1.0).frames == (SAMPLE,)
    assert link.errors == {"crc": 0, "framing": 1}
    link.close()


def test_only_an_error_frame_of_the_class_bus_off_ends_the_connection(peer: can.BusABC) -> None:
    """Linux numbers the class bus-off 0x40; 0x04 and 0x80 are a problem of the controller and a bus error."""
    link = open_transport("can://virtual/transport-test")
    for error_class in (0x04, 0x80):
        peer.send(can.Message(is_error_frame=True, arbitration_id=error_class))
    assert link.receive(1.0).frames == ()
    assert link.errors["framing"] == 2
    peer.send(can.Message(is_error_frame=True, arbitration_id=0x44))
    with pytest.raises(DeviceLost, match="bus-off"):
        link.receive(1.0)
    link.close()


def test_a_read_of_a_busy_bus_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame takes 1 ms, and a read ends after 20 ms at the latest."""
    clock = count(0.0, 1e-3)
    monkeypatch.setattr(can_bus, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    message = can.Message(arbitration_id=SAMPLE.id, data=SAMPLE.data, is_extended_id=False)
    messages = chain([message] * 100, repeat(None))
    busy: Any = SimpleNamespace(recv=lambda _: next(messages))
    assert 18 <= len(can_bus.CanBus("can://virtual/busy", busy, ()).receive(1.0).frames) <= 21


def test_an_slcan_line_with_more_data_than_it_states_is_damaged() -> None:
    decoder = SlcanDecoder()
    assert decoder.feed(b"t12311122\rt1231") == []
    assert decoder.errors == 1
    assert decoder.feed(b"11\r") == [Frame(0x123, b"\x11")]
    assert decoder.errors == 1


def test_slcan_opens_the_bus_at_the_bit_rate_and_survives_damaged_lines(adapter: tuple[int, str]) -> None:
    device, path = adapter
    link = open_transport(f"can://slcan{path}?bitrate=1000000")
    assert b"S8\r" in os.read(device, 100)
    line = b"t0428" + SAMPLE.data.hex().upper().encode() + b"\r"
    for damage in (b"t0z28\r", b"t\r", b"t04280011\r", b"\xff\xfe\r"):
        os.write(device, damage)
        assert link.receive(0.1).frames == ()
    assert link.errors == {"crc": 0, "framing": 4}
    os.write(device, line + line)
    assert link.receive(1.0).frames == (SAMPLE, SAMPLE)
    link.send(Frame(96, b"\x01"))
    assert os.read(device, 100) == b"t060101\r"
    link.close()


def heard(device: int, end: bytes) -> bytes:
    """All bytes that the host sends to the adapter, up to this end."""
    result = b""
    while not result.endswith(end):
        assert select.select([device], [], [], 60.0)[0], result
        result += os.read(device, 100)
    return result


def test_busy_slcan_port_is_reported_and_not_used(adapter: tuple[int, str]) -> None:
    device, path = adapter
    first = open_transport(f"can://slcan{path}")
    try:
        heard(device, b"\rO\r")
        with pytest.raises(LinkError, match="in use by another program"):
            open_transport(f"can://slcan{path}")
        first.send(SAMPLE)
        line = b"t0428" + SAMPLE.data.hex().upper().encode() + b"\r"
        assert heard(device, line) == line  # nothing closed or reopened the bus in between
    finally:
        first.close()
    open_transport(f"can://slcan{path}").close()


def test_pulled_slcan_adapter_is_device_lost(adapter: tuple[int, str]) -> None:
    device, path = adapter
    link = open_transport(f"can://slcan{path}")
    os.close(device)
    with pytest.raises(DeviceLost, match="the port is lost"):
        link.receive(0.5)
    with pytest.raises(DeviceLost):
        link.send(SAMPLE)
    link.close()


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("can://carrier-pigeon/x", "unknown CAN backend 'carrier-pigeon'; python-can has:.*slcan.*virtual"),
        ("can://virtual", "contains no channel"),
        ("can://slcan/dev/nothing?settle_s=0", "there is no port /dev/nothing"),
        ("can://socketcan/can7", "sudo ip link set can7 up type can bitrate"),
    ],
)
def test_bus_that_cannot_be_opened_is_reported_with_the_reason(url: str, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence):
        open_transport(url)


@pytest.mark.parametrize("uid", ["", "&uid=51d000000001"], ids=["a port", "a search"])
def test_slcan_refuses_a_bit_rate_it_has_no_letter_for(uid: str, adapter: tuple[int, str]) -> None:
    with pytest.raises(LinkUrlError, match="does not run at 123456 bit/s: choose one of 10000"):
        open_transport(f"can://slcan{adapter[1]}?bitrate=123456{uid}")


def test_an_adapter_without_a_device_is_named_and_left(adapter: tuple[int, str]) -> None:
    device, path = adapter
    with pytest.raises(LinkError, match=rf"searched {path} \(no DPR device\)"):
        open_transport(f"can://slcan{path}?uid=51d000000001")
    heard(device, b"\rC\r")  # the bus is left
    open_transport(f"can://slcan{path}").close()


def test_capacity_counts_stuffed_bits_and_the_adapters_uart(adapter: tuple[int, str]) -> None:
    link = open_transport(f"can://slcan{adapter[1]}?bitrate=500000&tty_baud=115200")
    bus, uart = link.capacities
    assert bus.max_rate_hz == int(0.8 * 500_000 / 135)
    with pytest.raises(LinkError, match="higher tty_baud"):
        uart.check(1000)
    link.close()

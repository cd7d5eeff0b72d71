import fcntl
import os
import pty
import socket
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from dpr_lab.errors import DeviceLost, LinkError
from dpr_lab.transports import open_transport, serial_port
from dpr_lab.transports.transport import Transport
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.messages import Frame

FRAMES = tuple(Frame(65, bytes(range(n))) for n in range(9))


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """Device end of a pseudo-terminal, and path of the host end."""
    device, host = pty.openpty()
    tty.setraw(host)
    yield device, os.ttyname(host)
    for descriptor in (device, host):
        try:
            os.close(descriptor)
        except OSError:
            pass


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5)
        yield server


def _address(listener: socket.socket) -> str:
    return f"socket://127.0.0.1:{listener.getsockname()[1]}"


def _send_for_ever(link: Transport) -> None:
    while True:
        link.send(FRAMES[8])


def test_serial_carries_frames_both_ways(terminal: tuple[int, str]) -> None:
    device, path = terminal
    link = open_transport(f"serial://{path}?baud=921600")
    sent = b"".join(encode_frame(frame) for frame in FRAMES)
    asked = time.monotonic()
    os.write(device, sent)
    received = link.receive(1.0)
    assert received.frames == FRAMES
    assert received.raw == sent
    assert asked <= received.host_time <= time.monotonic()
    link.send(FRAMES[8])
    assert FrameDecoder().feed(os.read(device, 100)) == [FRAMES[8]]
    link.close()
    link.close()


def test_a_byte_of_a_serial_line_has_start_and_stop_bits(terminal: tuple[int, str]) -> None:
    link = open_transport(f"serial://{terminal[1]}?baud=115200")
    sample = encode_frame(Frame(66, bytes(8)))
    assert [capacity.max_rate_hz for capacity in link.capacities] == [int(0.8 * 115_200 / (10 * len(sample)))]
    link.close()


def test_serial_timeout_returns_nothing_after_about_the_requested_time(terminal: tuple[int, str]) -> None:
    link = open_transport(f"serial://{terminal[1]}")
    start = time.monotonic()
    assert link.receive(0.2).frames == ()
    assert time.monotonic() - start > 0.15
    link.close()


def test_serial_counts_damage_by_cause(terminal: tuple[int, str]) -> None:
    device, path = terminal
    link = open_transport(f"serial://{path}")
    damaged = bytearray(encode_frame(FRAMES[8]))
    damaged[5] ^= 0x10
    os.write(device, encode_frame(FRAMES[3]) + damaged + encode_frame(FRAMES[4]))
    assert link.receive(1.0).frames == (FRAMES[3], FRAMES[4])
    assert sum(link.errors.values()) == 1
    link.close()


def test_pulled_serial_port_is_device_lost_when_reading_and_writing(terminal: tuple[int, str]) -> None:
    device, path = terminal
    link = open_transport(f"serial://{path}")
    os.close(device)
    with pytest.raises(DeviceLost, match="the port is lost"):
        link.receive(0.5)
    with pytest.raises(DeviceLost, match="check cable and power"):
        link.send(FRAMES[0])
    link.close()


def test_busy_serial_port_is_reported(terminal: tuple[int, str]) -> None:
    url = f"serial://{terminal[1]}"
    first = open_transport(url)
    with pytest.raises(LinkError, match="in use by another program"):
        open_transport(url)
    first.close()
    open_transport(url).close()


def test_missing_serial_port_lists_those_found(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LinkError, match=r"there is no port /dev/ttyUSB99; (found: |no serial port was found)"):
        open_transport("serial:///dev/ttyUSB99")
    with pytest.raises(LinkError, match="contains no port"):
        open_transport("serial://")


def test_forbidden_serial_port_names_the_group(monkeypatch: pytest.MonkeyPatch, terminal: tuple[int, str]) -> None:
    def refuse(*args: object, **options: object) -> None:
        raise serial_port.serial.SerialException(13, "could not open port")

    monkeypatch.setattr(serial_port.serial, "Serial", refuse)
    with pytest.raises(LinkError, match="usermod -aG dialout"):
        open_transport(f"serial://{terminal[1]}")


def test_a_file_or_folder_is_not_a_serial_port(tmp_path: Path) -> None:
    file = tmp_path / "log.txt"
    file.write_text("no port")
    for name in (file, tmp_path):
        with pytest.raises(LinkError, match=f"{name} is not a serial port; "):
            open_transport(f"serial://{name}")


def test_device_that_reads_nothing_is_lost_not_a_hang(
    terminal: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_port, "SERIAL", serial_port.SerialSettings(write_timeout_s=0.1))
    link = open_transport(f"serial://{terminal[1]}")
    with pytest.raises(DeviceLost):
        _send_for_ever(link)
    link.close()


def test_tcp_carries_frames_both_ways_in_bulk(listener: socket.socket) -> None:
    link = open_transport(_address(listener))
    device, _ = listener.accept()
    with device:
        many = FRAMES * 500
        device.sendall(b"".join(encode_frame(frame) for frame in many))
        received: list[Frame] = []
        while len(received) < len(many):
            received += link.receive(1.0).frames
        assert tuple(received) == many
        link.send(FRAMES[5])
        assert FrameDecoder().feed(device.recv(100)) == [FRAMES[5]]
    link.close()


def test_tcp_keeps_what_came_before_the_peer_closed(listener: socket.socket) -> None:
    link = open_transport(_address(listener))
    device, _ = listener.accept()
    device.sendall(encode_frame(FRAMES[2]))
    device.close()
    assert link.receive(1.0).frames == (FRAMES[2],)
    with pytest.raises(DeviceLost, match="closed by the device"):
        link.receive(1.0)
    link.close()
    with pytest.raises(DeviceLost):
        link.receive(0.1)


def test_tcp_timeout_and_refusal() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = _address(server)
        link = open_transport(url)
        start = time.monotonic()
        assert link.receive(0.1).raw == b""
        assert time.monotonic() - start > 0.08
        link.close()
    with pytest.raises(LinkError, match="no connection"):
        open_transport(url)


@pytest.mark.parametrize("place", ["", "127.0.0.1", ":5555", "127.0.0.1:no", "127.0.0.1:70000", "127.0.0.1:1/path"])
def test_tcp_url_needs_host_and_port(place: str) -> None:
    with pytest.raises(LinkError, match="use socket://HOST:PORT"):
        open_transport(f"socket://{place}")


def test_ports_are_held_exclusively_by_the_lock_other_programs_respect(terminal: tuple[int, str]) -> None:
    link = open_transport(f"serial://{terminal[1]}")
    other = os.open(terminal[1], os.O_RDWR | os.O_NOCTTY)
    with pytest.raises(BlockingIOError):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)
    link.close()

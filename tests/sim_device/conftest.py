"""A host for the simulated device: the host role of the protocol on any link, without the driver of dpr-lab."""

import socket
import time
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any, NamedTuple

import can
import numpy as np
import pytest
import serial

from firmware_protocol.errors import CommandRefused, CommandUnanswered
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.host_role import HostSession
from firmware_protocol.messages import (
    Command,
    Event,
    EventKind,
    Frame,
    Hold,
    Message,
    Release,
    Sample,
    Stop,
    Stream,
)
from sim_device.__main__ import main
from sim_device.assemble import assemble
from sim_device.options import Options
from sim_device.plant.operator import HABITS


class Ended(NamedTuple):
    code: int
    out: str
    err: str


@pytest.fixture
def program(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    """Run `python -m sim_device` in this process. An exception that would end it is raised."""

    def run(*words: object) -> Ended:
        capsys.readouterr()
        try:
            code = main(list(map(str, words)))
        except SystemExit as end:
            code = int(end.code or 0)
        return Ended(code, *capsys.readouterr())

    return run


class SerialEnd:
    def __init__(self, path: str, baud: int) -> None:
        self.port = serial.Serial(path, baud, timeout=0, exclusive=True)
        self.decoder = FrameDecoder()
        self.bytes_in = 0

    def read(self) -> list[Frame]:
        data = self.port.read(65536)
        self.bytes_in += len(data)
        return self.decoder.feed(data)

    def write(self, frame: Frame) -> None:
        self.port.write(encode_frame(frame))

    def close(self) -> None:
        self.port.close()


class SocketEnd:
    def __init__(self, host: str, port: int) -> None:
        self.socket = socket.create_connection((host, port))
        self.socket.setblocking(False)
        self.decoder = FrameDecoder()

    def read(self) -> list[Frame]:
        try:
            return self.decoder.feed(self.socket.recv(65536))
        except BlockingIOError:
            return []

    def write(self, frame: Frame) -> None:
        self.socket.sendall(encode_frame(frame))

    def close(self) -> None:
        self.socket.close()


class ReadAhead:
    """A serial port read in pieces as they come.

    python-can reads each byte by itself, so that on a busy machine a device that samples faster than real time fills
    the port, and its answers come behind seconds of samples.
    """

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._held = b""

    @property
    def in_waiting(self) -> int:
        return len(self._held) or self._port.in_waiting

    def read(self, size: int) -> bytes:
        self._held = self._held or self._port.read(max(size, self._port.in_waiting))
        read, self._held = self._held[:size], self._held[size:]
        return read

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)


class CanEnd:
    def __init__(self, interface: str, channel: str, bitrate: int) -> None:
        options = {"sleep_after_open": 0.0} if interface == "slcan" else {}
        self.bus: Any = can.Bus(channel, interface=interface, bitrate=bitrate, **options)
        if interface == "slcan":
            self.bus.serialPortOrig = ReadAhead(self.bus.serialPortOrig)

    def read(self) -> list[Frame]:
        # python-can waits for a byte on an empty port: once is enough.
        messages = islice(iter(lambda: self.bus.recv(0.0), None), 64)
        return [Frame(m.arbitration_id, bytes(m.data)) for m in messages]

    def write(self, frame: Frame) -> None:
        self.bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))

    def close(self) -> None:
        self.bus.shutdown()


def open_end(url: str):
    scheme, rest = url.split("://")
    address, _, query = rest.partition("?")
    if scheme == "serial":
        return SerialEnd(address, int(query.removeprefix("baud=")))
    if scheme == "socket":
        host, port = address.split(":")
        return SocketEnd(host, int(port))
    interface, _, channel = address.partition("/")
    return CanEnd(interface, f"/{channel}" if interface == "slcan" else channel, int(query.removeprefix("bitrate=")))


class DirectEnd:
    """Replacement for a link: frames are passed directly, and wall time advances in steps."""

    def __init__(self, options: Options, step_s: float = 0.01) -> None:
        self.device, self.link, _ = assemble(options)
        self.link.close()
        self.wall, self.step_s = 100.0, step_s
        self.device.service(self.wall)
        self._answers: list[Frame] = []

    def now(self) -> float:
        return self.wall

    def read(self) -> list[Frame]:
        self.wall += self.step_s
        frames = self._answers + self.device.service(self.wall)
        self._answers = []
        return frames

    def write(self, frame: Frame) -> None:
        self._answers += self.device.receive(frame, self.wall)

    def close(self) -> None:
        pass


class Host:
    def __init__(self, end, now: Callable[[], float] = time.monotonic) -> None:
        self.end, self.now = end, now
        self.session = HostSession()
        self.messages: list[Message] = []

    def poll(self) -> None:
        for frame in self.session.due(self.now()):
            self.end.write(frame)
        frames = self.end.read()
        self.messages += [message for frame in frames if (message := self.session.receive(frame)) is not None]
        if not frames and self.now is time.monotonic:
            time.sleep(0.0005)

    def until(self, done: Callable[[], bool], timeout: float = 60.0) -> None:
        end = self.now() + timeout
        while not done():
            assert self.now() < end, "timed out"
            self.poll()

    def run_for(self, seconds: float) -> None:
        end = self.now() + seconds
        self.until(lambda: self.now() >= end, seconds + 1)

    def do(self, command: Command, patience: int = 20) -> None:
        for attempt in range(patience):
            self.end.write(self.session.command(command, self.now()))
            self.until(lambda: self.session.outcome is not None)
            assert self.session.outcome is not None
            error = self.session.outcome.error
            if error is None or (attempt and isinstance(error, CommandRefused)):  # the first was heard after all
                return
            if attempt == patience - 1 or not isinstance(error, CommandUnanswered):
                raise error  # else a loaded machine left the device standing

    def hello(self) -> None:
        self.end.write(self.session.hello(self.now()))
        self.until(lambda: self.session.outcome is not None)
        assert self.session.info is not None, self.session.outcome

    def of(self, kind: type) -> list:
        return [message for message in self.messages if isinstance(message, kind)]

    def release(self, pose: int = 1, rate_hz: int = 1000, rest: int = 300, swing: int = 2000) -> int:
        """Hold, rest, release, swing and stop; return the tick of the release."""
        self.messages.clear()
        self.do(Hold(pose=pose))
        assert self.session.info is not None
        self.run_for(0.0 if self.session.info.simulated_time else 1.2 * HABITS.placing_time)
        self.do(Stream(rate_hz=rate_hz))
        self.until(lambda: len(self.of(Sample)) >= rest)
        self.do(Release())
        self.until(lambda: any(m.kind is EventKind.RELEASED for m in self.of(Event)), 60.0)
        tick = next(m.tick for m in self.of(Event) if m.kind is EventKind.RELEASED)
        self.until(lambda: len(self.of(Sample)) >= tick + swing, 60.0)
        self.do(Stop())
        return tick

    def counts(self) -> np.ndarray:
        """Ticks and low words of the counters (n, 4)."""
        return np.array([(m.tick, m.position0, m.position1, m.position2) for m in self.of(Sample)])


class Bench:
    """Creates hosts and devices, and closes them at the end."""

    def __init__(self, simulated) -> None:
        self._simulated = simulated
        self._closers: list[Callable[[], None]] = []

    def direct(self, step_s: float = 0.01, **options) -> Host:
        end = DirectEnd(Options(clock="realtime", **options), step_s)
        host = Host(end, end.now)
        host.hello()
        return host

    def serve(self, **options) -> str:
        """Run a device in a thread and return its URL."""
        served = self._simulated(**{"clock": "realtime", "seed": None, **options})
        self.device, self.thread = served.board, served.thread
        return served.url

    def connect(self, url: str) -> Host:
        host = Host(open_end(url))
        self._closers.append(host.end.close)
        return host

    def host(self, **options) -> Host:
        host = self.connect(self.serve(**options))
        host.hello()
        return host

    def close(self) -> None:
        for closer in reversed(self._closers):
            closer()


@pytest.fixture
def bench(simulated) -> Iterator[Bench]:
    made = Bench(simulated)
    try:
        yield made
    finally:
        made.close()

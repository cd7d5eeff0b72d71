"""One device behind three implementations: the Python role, the C core on this machine, the C core on a Cortex-M.

Each is a `Role`: what it is sent and what happens to it go in, its messages come out.
"""

import ctypes
import select
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
import serial

import firmware_protocol
from firmware_protocol.device_role import Answer, DeviceSession
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import (
    MESSAGES,
    ArmQuantity,
    Event,
    EventKind,
    Fault,
    Frame,
    KeepAlive,
    Message,
    Ping,
    Pong,
    Position,
    Release,
    Sample,
    State,
    Status,
    TorqueKind,
    decode,
    encode,
)
from sim_device.firmware.c_firmware import Firmware

SOURCES = Path(firmware_protocol.__file__).parent / "c"
INFO = DeviceInfo("1.0.0", "00a385000000dead", (16384, 16384, 16384), rate_max_hz=4000, rate_default_hz=1000)
WITH_DRIVES = {
    "": INFO,
    "joints": replace(INFO, torque_kinds=tuple(TorqueKind), torque_unit_uNm=100),
    "arm": replace(INFO, input_kinds=tuple(TorqueKind), input_unit=100, input_quantity=ArmQuantity.VOLTAGE),
}

PATIENCE_S = 60.0
"""Time limit for events that must occur, s."""


class Role(Protocol):
    """Device that has just been switched on."""

    def send(self, frame: Frame) -> list[Message]: ...

    def fall_silent(self, seconds: float, answers: int) -> list[Message]: ...

    def set_fault(self, fault: int, answers: int) -> list[Message]: ...

    def status(self) -> Status: ...


class PythonRole:
    def __init__(self, drives: str) -> None:
        self.session, self.now = DeviceSession(WITH_DRIVES[drives]), 0.0

    def send(self, frame: Frame) -> list[Message]:
        return self._carry_out(self.session.receive(frame, self.now))

    def fall_silent(self, seconds: float, answers: int) -> list[Message]:
        self.now += seconds
        return self._carry_out(self.session.check_lease(self.now, 7))

    def set_fault(self, fault: int, answers: int) -> list[Message]:
        return self._carry_out(self.session.fault(Fault(fault), 7)) if fault else []

    def status(self) -> Status:
        status = decode(self.session.status(0, 0, 0))
        assert isinstance(status, Status)
        return status

    def _carry_out(self, answer: Answer) -> list[Message]:
        frames = list(answer.frames)
        if isinstance(answer.task, Release):
            frames.append(self.session.released(9))
        if isinstance(answer.task, Ping):
            frames.append(self.session.pong(answer.task, 9, 0.5))
        return [decode(frame) for frame in frames]


class CRole:
    def __init__(self, library: ctypes.PyDLL, drives: str) -> None:
        self.firmware, self.millis = Firmware(WITH_DRIVES[drives], library=library), 0

    def send(self, frame: Frame) -> list[Message]:
        return [decode(answer) for answer in self.firmware.receive(frame, self.millis, 9.5)]

    def fall_silent(self, seconds: float, answers: int) -> list[Message]:
        self.millis += round(1000 * seconds)
        return [decode(frame) for frame in self.firmware.poll(self.millis)]

    def set_fault(self, fault: int, answers: int) -> list[Message]:
        self.firmware.set_fault(fault)
        return [decode(frame) for frame in self.firmware.poll(self.millis)]

    def status(self) -> Status:
        """From the report that a reading a second later is due for."""
        late = np.array([[self.firmware.next_tick + 1000, 0, 0, 0]])
        messages = [decode(frame) for frame in self.firmware.poll(self.millis, late)]
        return next(message for message in messages if isinstance(message, Status))


class QemuBoard:
    """Cortex-M image in QEMU. The link is a pseudo-terminal; stdin and stdout simulate the hardware."""

    def __init__(self, image: Path) -> None:
        flags = "-machine mps2-an385 -icount shift=3 -display none -monitor none -serial pty -serial stdio".split()
        self.process = subprocess.Popen(
            ["qemu-system-arm", *flags, "-kernel", image], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self.path = self._bench_until(b"(label serial0)").split()[-3].decode()
        self._bench_until(b"started\n")

    @property
    def url(self) -> str:
        return f"serial://{self.path}?baud=921600"

    def reset(self) -> None:
        self._tell_bench(b"0")
        self._bench_until(b"0")
        self._tell_bench(b"r")
        self._bench_until(b"started\n")

    def set_fault(self, fault: int) -> None:
        self._tell_bench(b"%d" % fault)
        self._bench_until(b"%d" % fault)

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()

    def _tell_bench(self, data: bytes) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(data)

    def _bench_until(self, end: bytes) -> bytes:
        assert self.process.stdout is not None
        result, deadline = b"", time.monotonic() + PATIENCE_S
        while not result.endswith(end):
            assert select.select([self.process.stdout], [], [], max(0.0, deadline - time.monotonic()))[0], result
            fresh = self.process.stdout.read(1)
            assert fresh, f"QEMU ended: {result!r}"
            result += fresh
        return result


class QemuRole:
    """Device in QEMU. A PING after each request separates its answers from later ones."""

    def __init__(self, board: QemuBoard, port: serial.Serial) -> None:
        self.board, self.port, self.token = board, port, 0
        self.switch_on()

    def switch_on(self) -> None:
        """Switch the device off and on. Earlier answers are discarded."""
        self.board.reset()
        self.port.reset_input_buffer()
        self.decoder, self.heard = FrameDecoder(), list[Message]()
        self.released: Event | None = None
        self.allowed_errors = 1  # QEMU may still pass on the frame that the reset cut off
        self._barrier()
        self.allowed_errors = self._errors()

    def send(self, frame: Frame) -> list[Message]:
        self.port.write(encode_frame(frame))
        return self._answers(self._barrier())

    def fall_silent(self, seconds: float, answers: int) -> list[Message]:
        """Until the device has said as much as it should, for it counts its own time; else as long as it takes."""
        started, before = time.monotonic(), len(self._answers(self.heard))
        while len(self._answers(self.heard)) < before + answers if answers else time.monotonic() < started + seconds:
            assert time.monotonic() < started + PATIENCE_S, "the device said nothing"
            self._read()
        return self._answers(self._barrier())

    def set_fault(self, fault: int, answers: int) -> list[Message]:
        """Set a fault. The device checks for faults once per cycle, so it may answer a marker first."""
        self.board.set_fault(fault)
        return self.fall_silent(0.0, answers)

    def status(self) -> Status:
        self._barrier()
        self.heard.clear()
        self._wait(lambda: any(isinstance(message, Status) for message in self.heard))
        return next(message for message in self.heard if isinstance(message, Status))

    def _barrier(self) -> list[Message]:
        """Wait for all messages that were sent until now."""
        self.token = self.token % 255 + 1
        mark = Ping(0xBA00 + self.token)
        self._wait(lambda: any(isinstance(m, Pong) and m.token == mark.token for m in self.heard), mark)
        result, self.heard = self.heard, []
        return result

    def _wait(self, done: Callable[[], bool], mark: Ping | None = None) -> None:
        """Read until `done`; a mark is sent again now and then, for nobody hears what is said to an unplugged port."""
        deadline, again = time.monotonic() + PATIENCE_S, 0.0
        while not done():
            now = time.monotonic()
            assert now < deadline, "the device said nothing"
            if now >= again:
                self.port.write(encode_frame(encode(mark or KeepAlive())))
                again = now + 0.1
            self._read()

    def _read(self) -> None:
        self.heard += map(decode, self.decoder.feed(self.port.read(self.port.in_waiting or 1)))
        assert self._errors() <= self.allowed_errors

    def _errors(self) -> int:
        return self.decoder.crc_errors + self.decoder.framing_errors

    def _answers(self, received: list[Message]) -> list[Message]:
        """Messages without reports, samples and markers. Of a repeated release, only the first is kept."""
        answers: list[Message] = []
        for message in received:
            if isinstance(message, Sample | Position | Status) or (
                isinstance(message, Pong) and message.token & 0xFF00 == 0xBA00
            ):
                continue
            if isinstance(message, Event) and message.kind is EventKind.RELEASED:
                if message == self.released:
                    continue
                self.released = message
            answers.append(message)
        return answers


def message_of(name: str, fields: dict[str, int]) -> Message:
    """Message of a trace. Fields that are not given have the values of this version of dpr.dbc."""
    return MESSAGES[name](**fields)


@pytest.fixture(scope="session")
def run_trace() -> Callable[[Role, list[dict]], None]:
    return _run_trace


def _run_trace(role: Role, steps: list[dict]) -> None:
    for number, step in enumerate(steps):
        expected = step["answers"]
        answers = _take_step(role, step, len(expected))
        assert [type(answer) for answer in answers] == [MESSAGES[name] for name, _ in expected], (number, step, answers)
        for answer, (_, fields) in zip(answers, expected, strict=True):
            outcome = {name: getattr(answer, name) for name in fields}
            assert outcome == fields, (number, step, answers)
        if "then" in step:
            state, latched, fault = step["then"]
            status = role.status()
            result = (status.state, status.latched, status.fault)
            assert result == (State[state], latched, Fault[fault]), (number, step)


def _take_step(role: Role, step: dict, answers: int) -> list[Message]:
    if "silent_s" in step:
        return role.fall_silent(step["silent_s"], answers)
    if "fault" in step:
        return role.set_fault(step["fault"], answers)
    if "frame" in step:
        identifier, data = step["frame"]
        return role.send(Frame(identifier, bytes.fromhex(data)))
    return role.send(encode(message_of(*step["send"])))


@pytest.fixture(scope="session")
def make(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Run a target of the firmware's Makefile in a new folder; skip the test if a tool is missing."""

    def run(target: str, *tools: str) -> Path:
        for tool in ("make", *tools):
            if shutil.which(tool) is None:
                pytest.skip(f"{tool} is not installed")
        build = tmp_path_factory.mktemp("firmware")
        command = ["make", "--no-print-directory", "-C", SOURCES, target, f"BUILD={build}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stderr
        return build

    return run


@pytest.fixture(scope="session")
def image(make) -> Path:
    """The Cortex-M image."""
    return make("firmware", "arm-none-eabi-gcc") / "mps2_an385.elf"


@pytest.fixture
def board(image: Path) -> Iterator[QemuBoard]:
    if shutil.which("qemu-system-arm") is None:
        pytest.skip("qemu-system-arm is not installed")
    board = QemuBoard(image)
    try:
        yield board
    finally:
        board.close()


@pytest.fixture
def python_role() -> Callable[[str], Role]:
    return PythonRole


@pytest.fixture
def c_role(library: ctypes.PyDLL) -> Callable[[str], Role]:
    return partial(CRole, library)


@pytest.fixture
def qemu_role(board: QemuBoard) -> Iterator[QemuRole]:
    with serial.Serial(board.path, 921_600, timeout=0.02, exclusive=True) as port:
        yield QemuRole(board, port)

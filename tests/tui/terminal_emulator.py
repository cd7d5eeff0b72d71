"""Emulated terminal at the other end of a pseudo-terminal, with limited speed and cursor position reports."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import threading
import time
from collections.abc import Callable, Mapping, Sequence

from dpr_lab.tui.terminal.multiplexer import IN_ENVIRONMENT
from tests.warm_process import started

TOKEN = re.compile(
    rb"\x1b\[(?P<parameters>[?>=<0-9;:$]*)(?P<final>[@-~])|\x1b[()].|\x1b[=>78]|\x1b\][^\x07]*\x07|(?P<text>[^\x1b]+)"
)
PATIENCE_S = 300.0
DIRECT = {"TERM": "xterm-256color", "COLORTERM": "truecolor"}


class VirtualScreen:
    """The cells that a program draws; it answers where its cursor is.

    Args:
        size: columns and rows
        answer: takes what the terminal says to the program
        replies: what it says it is: final letter of the question `ESC [ > ...` -> reply
    """

    def __init__(
        self, size: tuple[int, int], answer: Callable[[bytes], object], replies: Mapping[bytes, bytes] | None = None
    ) -> None:
        self.size, self._answer, self._replies = size, answer, replies or {}
        self.answers = True
        self.modes: set[bytes] = set()
        """Private modes that are set, such as `?1049`."""
        self._cells = [[" "] * size[0] for _ in range(size[1])]
        self._x = self._y = 0
        self._rest = b""

    def text(self) -> str:
        """Displayed text."""
        return "\n".join("".join(row).rstrip() for row in self._cells)

    def take(self, data: bytes) -> None:
        data, at = self._rest + data, 0
        for token in TOKEN.finditer(data):
            if token.start() != at:
                break
            at = token.end()
            if (text := token["text"]) is not None:
                decoded, left = _decoded(text)
                self._put(decoded)
                at -= left
            elif token["final"] is not None:
                self._control(token["parameters"], token["final"])
        self._rest = data[at:]

    def _put(self, text: str) -> None:
        for character in text:
            if character == "\r":
                self._x = 0
            elif character == "\n":
                self._y = min(self._y + 1, self.size[1] - 1)
            elif character.isprintable():
                self._cells[self._y][min(self._x, self.size[0] - 1)] = character
                self._x += 1

    def _control(self, parameters: bytes, final: bytes) -> None:
        if parameters[:1] == b"?" and final in b"hl":
            (self.modes.add if final == b"h" else self.modes.discard)(parameters)
        elif parameters == b">" and final in self._replies:
            self._answer(self._replies[final])
        elif final == b"H":
            row, column = ([int(part or 1) for part in parameters.split(b";")] + [1, 1])[:2]
            self._x, self._y = min(column, self.size[0]) - 1, min(row, self.size[1]) - 1
        elif final == b"C":
            self._x += int(parameters or 1)
        elif final == b"n" and parameters == b"6" and self.answers:
            self._answer(f"\x1b[{self._y + 1};{min(self._x, self.size[0] - 1) + 1}R".encode())


class Terminal(VirtualScreen):
    """`dpr-lab` on a terminal of our own.

    Args:
        words: arguments of the command
        environment: its variables
        size: columns and rows
        bytes_per_s: what the line carries; None for any amount
        answers: whether it answers cursor-position reports
        replies: what it says it is, see `VirtualScreen`
    """

    def __init__(
        self,
        words: Sequence[str],
        environment: Mapping[str, str],
        size: tuple[int, int] = (80, 24),
        bytes_per_s: float | None = None,
        answers: bool = True,
        replies: Mapping[bytes, bytes] | None = None,
    ) -> None:
        super().__init__(size, lambda data: os.write(self._master, data), replies)
        self.bytes_per_s, self.answers = bytes_per_s, answers
        self.received = 0
        """Number of bytes received so far."""
        self.shown: list[tuple[float, str]] = []
        """Content of the screen after each read, with its time."""
        self.reading = True
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
        self._before = termios.tcgetattr(slave)
        self._slave = slave
        self.process = started(
            "dpr_lab",
            words,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            env={**without_multiplexer(os.environ), **DIRECT, **environment},
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def press(self, keys: str) -> None:
        """Press keys."""
        os.write(self._master, keys.encode())

    def until(self, condition: Callable[[], object]) -> None:
        """Wait for a condition."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"waited in vain; the terminal shows\n{self.text()}"
            assert self.process.poll() is None, f"the program ended; the terminal shows\n{self.text()}"
            time.sleep(0.02)

    def until_shown(self, text: str) -> None:
        """Wait until a text is displayed."""
        self.until(lambda: text in self.text())

    def ended(self, patience_s: float = PATIENCE_S) -> int:
        """Wait for the end and return the exit code."""
        return self.process.wait(patience_s)

    @property
    def restored(self) -> bool:
        """Whether the terminal is in the state in which the program found it."""
        return termios.tcgetattr(self._slave)[:4] == self._before[:4]

    def hang_up(self) -> None:
        """Close the terminal."""
        self.reading = False
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1

    def close(self) -> None:
        """End the program and its child processes if they still run."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        if self._master >= 0:
            self.hang_up()

    def _run(self) -> None:
        while self.reading:
            if not select.select([self._master], [], [], 0.05)[0]:
                continue
            rate = self.bytes_per_s
            try:
                data = os.read(self._master, 65536 if rate is None else max(int(rate / 50), 1))
            except OSError:
                return
            self.received += len(data)
            self.take(data)
            self.shown.append((time.monotonic(), self.text()))
            if rate is not None:
                time.sleep(len(data) / rate)


def without_multiplexer(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment of a terminal without tmux or similar programs."""
    return {name: value for name, value in environment.items() if name not in IN_ENVIRONMENT}


def to_ready(terminal: Terminal) -> None:
    """Guide the rods until they may be released."""
    terminal.until_shown("the latch closes")
    terminal.press("s")
    terminal.until_shown("to RELEASE")


def _decoded(data: bytes) -> tuple[str, int]:
    """Decode text, and return the number of remaining bytes of an incomplete character."""
    for left in range(4):
        try:
            return data[: len(data) - left].decode(), left
        except UnicodeDecodeError:
            continue
    return data.decode(errors="replace"), 0

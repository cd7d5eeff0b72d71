"""Output to a terminal that may be slow, stopped, or closed, without waiting."""

import os
import select
import termios
import threading
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TerminalWriterSettings:
    """Settings of the output to the terminal."""

    at_once: int = 512
    """Maximum number of bytes per write; the output can be stopped between two writes."""
    patience_s: float = 3.0
    """Maximum time that a slow terminal has at the end to accept the remaining output, s."""
    grace_s: float = 0.5
    """Additional time for the thread to stop, s."""


SETTINGS = TerminalWriterSettings()


class TerminalWriter:
    """Thread that writes to a terminal.

    Args:
        fileno: file descriptor of the terminal
    """

    def __init__(self, fileno: int) -> None:
        self._fileno = fileno
        self._waiting: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._busy = self._closing = self._given_up = False
        self._thread = threading.Thread(target=self._run, name="terminal writer", daemon=True)
        self._thread.start()

    @property
    def idle(self) -> bool:
        """Whether the terminal has received everything."""
        return not self._waiting and not self._busy

    def write(self, text: str) -> None:
        """Write without waiting."""
        with self._changed:
            self._waiting.append(text.encode("utf-8", "replace"))
            self._changed.notify()

    def stop(self, last_words: str) -> None:
        """Write the remaining output, and end within a limited time.

        Args:
            last_words: text written instead of the remaining output if the terminal does not accept the output
        """
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(SETTINGS.patience_s)
        if not self._thread.is_alive():
            return
        self._given_up = True
        try:
            termios.tcflush(self._fileno, termios.TCOFLUSH)
            self._thread.join(SETTINGS.grace_s)
            if select.select([], [self._fileno], [], 0)[1]:
                os.write(self._fileno, last_words.encode())
        except (OSError, termios.error):
            pass  # a closed terminal need not be restored

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing)
                if not self._waiting:
                    return
                data = b"".join(self._waiting)
                self._waiting.clear()
                self._busy = True
            self._push(data)
            self._busy = False

    def _push(self, data: bytes) -> None:
        while data and not self._given_up:
            try:
                data = data[os.write(self._fileno, data[: SETTINGS.at_once]) :]
            except BlockingIOError:
                select.select([], [self._fileno], [], 0.1)
            except OSError:
                self._given_up = True

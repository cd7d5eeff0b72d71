"""Bytes to a terminal that may be slow, stopped, or gone: who writes never waits."""

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
    """Bytes handed to the terminal at a time; between two of them it can be stopped."""
    patience_s: float = 3.0
    """How long the end waits for a slow terminal to take what is left."""
    grace_s: float = 0.5
    """And then for the thread to notice that it is to give up."""


SETTINGS = TerminalWriterSettings()


class TerminalWriter:
    """A thread that writes to a terminal.

    Args:
        fileno: the terminal
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
        """Whether the terminal has taken everything."""
        return not self._waiting and not self._busy

    def write(self, text: str) -> None:
        """Write soon."""
        with self._changed:
            self._waiting.append(text.encode("utf-8", "replace"))
            self._changed.notify()

    def stop(self, last_words: str) -> None:
        """Write what is left, and end within a bounded time.

        Args:
            last_words: written in its place if the terminal does not take it
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
            pass  # the terminal is gone, so there is nothing to restore

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

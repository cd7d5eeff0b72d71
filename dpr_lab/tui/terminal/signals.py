"""SIGTERM, SIGHUP and SIGINT end the screen as its own key does, and within a bounded time."""

import os
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType


@dataclass(frozen=True, slots=True)
class EndSettings:
    """Time limits of the shutdown."""

    exit_code: int = 130
    """The command line's for an interruption."""
    patience_s: float = 25.0
    """For the end in good order: a recorder that does not answer is ended by signals within 15 s."""


SETTINGS = EndSettings()


def end_on_signals(end: Callable[[], object], restore: Callable[[], object]) -> None:
    """Let these signals end the app.

    A handler of Python's runs between two steps of the main thread, so `end` must only ask for the end. If the process
    is still there after a while, for any reason, the terminal is restored and the process ends at once; the
    recorder finishes its file by itself when the other end of its pipe is gone.

    Args:
        end: asks for the end
        restore: restores the terminal
    """

    def give_up() -> None:
        restore()
        os._exit(SETTINGS.exit_code)

    def caught(number: int, frame: FrameType | None) -> None:
        watch = threading.Timer(SETTINGS.patience_s, give_up)
        watch.daemon = True
        watch.start()
        end()

    for name in ("SIGTERM", "SIGHUP", "SIGINT"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), caught)

"""Orderly shutdown of the screen on SIGTERM, SIGHUP and SIGINT, within a limited time."""

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
    """Exit code of the process after an interruption."""
    patience_s: float = 25.0
    """Maximum time for an orderly shutdown, s. A recorder that does not answer is ended by signals within 15 s."""


ENDING = EndSettings()


def end_on_signals(end: Callable[[], object], restore: Callable[[], object]) -> None:
    """End the app on SIGTERM, SIGHUP and SIGINT.

    A Python signal handler runs between two steps of the main thread, so `end` must only request the shutdown. If the
    process has not ended after a time limit, the terminal is restored and the process exits at once. The recorder
    process finishes its file when the other end of its pipe is closed.

    Args:
        end: function that requests the shutdown
        restore: function that restores the terminal
    """

    def give_up() -> None:
        restore()
        os._exit(ENDING.exit_code)

    def caught(number: int, frame: FrameType | None) -> None:
        watch = threading.Timer(ENDING.patience_s, give_up)
        watch.daemon = True
        watch.start()
        end()

    for name in ("SIGTERM", "SIGHUP", "SIGINT"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), caught)

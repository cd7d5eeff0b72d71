"""Delay of Ctrl-C and SIGTERM during a step that must not be interrupted."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unbroken() -> Iterator[None]:
    """Defer Ctrl-C and SIGTERM until the block of this context manager ends, also by an exception.

    An incomplete record would make the rest of the file unreadable, and a lock whose acquisition is interrupted stays
    locked. Only the main thread receives signals; in other threads the context has no effect.

    Raises:
        KeyboardInterrupt: one of these signals arrived during the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held_back: list[int] = []
    interrupt = signal.signal(signal.SIGINT, lambda caught, frame: held_back.append(caught))
    terminate = signal.signal(signal.SIGTERM, lambda caught, frame: held_back.append(caught))
    try:
        yield
    finally:
        try:
            signal.signal(signal.SIGTERM, terminate)
        finally:
            signal.signal(signal.SIGINT, interrupt)
        if held_back:
            signal.raise_signal(signal.SIGINT)

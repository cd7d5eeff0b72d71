"""Ctrl-C and SIGTERM between two steps instead of in the middle of one."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def unbroken() -> Iterator[None]:
    """Hold Ctrl-C and SIGTERM back until the block is done.

    A record half written would cost the rest of the file, and a lock whose acquisition is broken off stays locked.
    Outside the main thread, which alone hears signals, the block just runs.
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

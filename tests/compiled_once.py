"""Python compiles the tests and the libraries in one process; the others that run tests wait, and load them.

Each of the workers would compile them all in a fresh clone, which takes three times as long as to load them.
"""

import fcntl
import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.warm_process import SERVER

COMPILED = Path(__file__).parent / "__pycache__"
PATIENCE_S = 60.0
"""Maximum time for which a worker waits until the first worker begins, s."""


def compiled_before() -> bool:
    """Whether tests were collected here before, or Python does not store bytecode."""
    return sys.dont_write_bytecode or any(COMPILED.glob("test_*-pytest-*.pyc"))


@contextmanager
def one_after_the_other(worker: str, place: Path) -> Iterator[None]:
    """Context that a worker enters only after the worker gw0 has left it.

    Args:
        worker: this worker
        place: the lock, for all workers
    """
    give_up = time.monotonic() + PATIENCE_S
    while worker != "gw0" and not place.exists() and time.monotonic() < give_up:
        time.sleep(0.05)
    with place.open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # released when its process ends
        if worker == "gw0":
            yield
    if worker != "gw0":
        yield


@contextmanager
def compiled_once() -> Iterator[None]:
    """Collect the tests; in a fresh clone only after the first worker."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None or compiled_before():
        yield
        return
    with one_after_the_other(worker, Path(json.loads(os.environ[SERVER])[0]).with_name("compiling")):
        yield

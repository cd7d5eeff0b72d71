"""Importing this lets one process at a time compile kernels: the others wait, and load what it has compiled.

What is compiled already is loaded at once: a host that talks to a device in real time must not wait for it.
"""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from dpr_lab.kernel_cache import CACHE

compiled_alone = Dispatcher.compile  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
depth = 0


@contextmanager
def alone() -> Iterator[None]:
    """Hold the lock of the cache: one thread of one process, which compiles what its kernel calls under it too."""
    global depth
    assert CACHE is not None
    with global_compiler_lock, (CACHE / "compiling.lock").open("w") as lock:
        if depth == 0:
            fcntl.flock(lock, fcntl.LOCK_EX)
        depth += 1
        try:
            yield
        finally:
            depth -= 1


def compiled_before(self: Any, sig: Any) -> bool:
    """Whether a kernel is in the cache for arguments of these types."""
    cache = self._cache
    return hasattr(cache, "_cache_file") and (
        cache._index_key(sig, self.targetctx.codegen()) in cache._cache_file._load_index()
    )


def compile_or_load(self: Any, sig: Any) -> Any:
    """As Numba does."""
    if compiled_before(self, sig):
        return compiled_alone(self, sig)
    with alone():
        return compiled_alone(self, sig)


if CACHE is not None and compiled_alone is not compile_or_load:
    Dispatcher.compile = compile_or_load

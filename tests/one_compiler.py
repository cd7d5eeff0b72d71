"""Importing this lets one process at a time compile a kernel: the others wait, and load what it has compiled.

Several processes compile several kernels at a time. What is compiled already is loaded at once: a host that talks to a
device in real time must not wait for it.
"""

import fcntl
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from dpr_lab.kernel_cache import CACHE

compile_kernel: Callable[..., Any] = Dispatcher.compile  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
compile_pointer: Callable[..., Any] = CFunc.compile
_places: set[int] = set()
"""Locked bytes of the lock file: those of the kernels that this process compiles, one called by the other."""
_opened: dict[int, Any] = {}


def place_of(kernel: Callable[..., Any]) -> int:
    """Byte of a kernel; the same kernel in another copy of the repository has another, as Numba stores it by path."""
    return zlib.crc32(f"{kernel.__code__.co_filename}:{kernel.__qualname__}".encode())


@contextmanager
def alone(kernel: Callable[..., Any]) -> Iterator[None]:
    """Hold the lock of a kernel: a byte of one file. A lock of a byte belongs to the process, and not to its children.

    No process waits in a circle, because kernels do not call one another in a circle.
    """
    assert CACHE is not None
    place = place_of(kernel)
    with global_compiler_lock:
        if place in _places:
            yield
            return
        _places.add(place)
        fcntl.lockf(_file(), fcntl.LOCK_EX, 1, place)
        try:
            yield
        finally:
            fcntl.lockf(_file(), fcntl.LOCK_UN, 1, place)
            _places.remove(place)


def _file() -> Any:
    """Lock file, which stays open: closing it anywhere would release every lock of this process."""
    assert CACHE is not None
    if os.getpid() not in _opened:  # a forked process may have closed what it inherited
        _opened[os.getpid()] = (CACHE / "compiling.lock").open("w")
    return _opened[os.getpid()]


def compiled_before(cache: Any, sig: Any, target: Any) -> bool:
    """Whether a kernel is in its cache for arguments of these types."""
    return hasattr(cache, "_cache_file") and cache._index_key(sig, target.codegen()) in cache._cache_file._load_index()


def compile_or_load(self: Any, sig: Any) -> Any:
    """Replacement for `Dispatcher.compile`."""
    if compiled_before(self._cache, sig, self.targetctx):
        return compile_kernel(self, sig)
    with alone(self.py_func):
        return compile_kernel(self, sig)


def compile_or_load_pointer(self: Any) -> None:
    """Replacement for `CFunc.compile`."""
    if compiled_before(self._cache, self._sig, self._targetdescr.target_context):
        return compile_pointer(self)
    with alone(self._pyfunc):
        return compile_pointer(self)


if CACHE is not None and compile_kernel is not compile_or_load:
    Dispatcher.compile = compile_or_load
    CFunc.compile = compile_or_load_pointer

"""Compilation of numerical kernels by Numba, with a disk cache that is never outdated.

`dpr_lab.kernel_cache` describes the cache.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any, TypeVar, overload

import numba
from llvmlite import binding as llvm
from numba.core import caching, codegen, config, event
from numba.core.ccallback import CFunc
from numba.core.codegen import get_host_cpu_features
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime.nrt import rtsys as runtime
from numba.core.sigutils import normalize_signature
from numba.core.types import FunctionType
from numba.experimental import function_type as function_type  # type of a kernel that is passed as a pointer
from numba.extending import register_jitable, typeof_impl

from dpr_lab.kernel_cache import CACHE
from dpr_lab.progress import compiling

# Threads that wait by spinning make a parallel kernel slower than a serial one if other programs run too. OpenMP
# reads this when the first parallel kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

# Exceptions that Numba can raise while it reads its own cache; this package itself loads no pickle.
numba_caching: Any = caching
UNPICKLING_ERROR: type[Exception] = numba_caching.pickle.UnpicklingError
UNREADABLE = (UNPICKLING_ERROR, EOFError, ValueError, LookupError, AttributeError, TypeError, ImportError)
"""Errors that occur when a kernel is loaded from a truncated file, for example after a power cut or on a full disk."""

numba_config: Any = config
if numba_config.CPU_FEATURES is None and "+avx512f" in (features := get_host_cpu_features()):
    # By default the compiler uses half of the vector width to keep the clock high, which makes these kernels a quarter
    # slower.
    numba_config.CPU_FEATURES = f"{features},-prefer-256-bit"

Function = TypeVar("Function", bound=Callable[..., Any])


class _Compiling(event.Listener):
    """Numba listener that reports the start of each compilation.

    Loading a kernel from the cache is not reported.
    """

    def on_start(self, event: event.Event) -> None:
        """Handle the start of a compiler pass."""
        compiler_pass: Any = event.data
        # the first pass of each compilation
        if compiler_pass["name"].startswith("translate_bytecode") and compiler_pass["module"].startswith("dpr_lab"):
            compiling()

    def on_end(self, event: event.Event) -> None:
        """Do nothing."""


event.register("numba:run_pass", _Compiling())


@overload
def njit(function: Function) -> Function: ...
@overload
def njit(*, parallel: bool = False, allocates: bool = True) -> Callable[[Function], Function]: ...
def njit(function: Callable[..., Any] | None = None, *, allocates: bool = True, **options: Any) -> Any:
    """Compile a kernel that Python calls, without the GIL and with a disk cache.

    The arithmetic is strict IEEE. Division by zero gives inf or nan. Sums are neither reassociated nor contracted, so
    that a result has the same bits for any batch size and any number of threads. With `allocates=False`, for kernels
    that neither allocate arrays nor return views, reference counting is omitted; it can take half of the time of a loop
    over samples. With the environment variable NUMBA_DISABLE_JIT=1 the kernel is the Python function.
    """
    if function is None:
        return partial(njit, allocates=allocates, **options)
    if numba_config.DISABLE_JIT:
        return function
    compiled: Any = partial(numba.njit, error_model="numpy", nogil=True, _nrt=allocates, **options)
    return _cached(compiled()(function), allocates)


def subroutine(function: Function) -> Function:
    """Decorate a function that is compiled as part of each kernel that calls it.

    A call from Python executes the Python function. No compiled wrapper for calls from Python is generated, which
    halves the compilation time.
    """
    return register_jitable(error_model="numpy")(function)


def inlined(function: Function) -> Function:
    """Decorate a short subroutine that is inlined, so that loops that call it are vectorised.

    By default the compiler inlines only small functions, and a loop with a call is not vectorised.
    """
    return register_jitable(error_model="numpy", forceinline=True)(function)


def behind_pointer(function: Callable[..., None], *examples: Any) -> Any:
    """Compile a kernel that other kernels receive as an argument and call through a pointer.

    An ordinary call of a kernel compiles its whole code again for each caller. A call through a pointer takes some
    nanoseconds instead, which is negligible for kernels with much work per call.

    Args:
        function: a kernel that returns nothing, not yet compiled
        examples: example arguments, which determine the types of the compiled function
    """
    if numba_config.DISABLE_JIT:
        return function
    signature = normalize_signature(numba.void(*map(numba.typeof, examples)))
    kernel: Any = _Pointer(function, signature, locals={}, options={"error_model": "numpy", "_nrt": False})
    kernel.pointer_type = FunctionType(kernel._sig)
    kernel._cache = _cache_of(function, False) or kernel._cache
    with _loops_kept():
        kernel.compile()
    return kernel


@contextmanager
def _loops_kept() -> Iterator[None]:
    """Compile without unrolling of loops, if this version of Numba permits it.

    The compiler unrolls a short loop over few lanes before it converts loops to vector instructions, so that the loop
    stays scalar. Numba has no option for this. If a later version renames the internal function, kernels are slower,
    with equal results.
    """
    module: Any = codegen
    create = getattr(module, "create_pass_builder", None)
    if create is None:
        yield
        return
    with global_compiler_lock:
        module.create_pass_builder = partial(_without_unrolling, create)
        try:
            yield
        finally:
            module.create_pass_builder = create


def _without_unrolling(create: Callable[..., Any], machine: Any, **options: Any) -> Any:
    builder = create(machine, **options)
    settings: Any = getattr(builder, "_pto", None)
    if settings is None:
        return builder
    settings.loop_unrolling = False
    return llvm.create_pass_builder(machine, settings)


class _Pointer(CFunc):
    """Kernel that other kernels receive; its type is created only once.

    Each call of a kernel needs the type.
    """


@typeof_impl.register(_Pointer)
def _type_of_pointer(kernel: Any, context: Any) -> Any:
    return kernel.pointer_type


class KernelCache(caching.FunctionCache):
    """Cache of one kernel that needs no compiler imports and tolerates damaged files."""

    def __init__(self, function: Callable[..., Any], allocates: bool) -> None:
        super().__init__(function)
        self._allocates = allocates

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a kernel from the cache; return None if its file is damaged.

        A damaged kernel is recompiled. Before it loads a kernel, Numba by default imports everything that a compilation
        requires, which takes longer than loading all kernels of a diagnosis. Here only the reference counting is
        imported, for machine code that allocates arrays. All other imports are made when a kernel is compiled.
        """
        try:
            if self._allocates:
                runtime.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except UNREADABLE:
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled kernel if the disk has space."""
        with suppress(OSError):
            super().save_overload(sig, data)


def _cached(kernel: Any, allocates: bool) -> Any:
    """Attach the disk cache to a kernel; without a cache folder the kernel is unchanged."""
    kernel._cache = _cache_of(kernel.py_func, allocates) or kernel._cache
    return kernel


def _cache_of(function: Callable[..., Any], allocates: bool) -> KernelCache | None:
    """Create the cache of one kernel, or return None if its folder is not writable."""
    if CACHE is None:
        return None
    # Numba reads the folder when it creates a cache; the kernels of other libraries keep their folder.
    before, numba_config.CACHE_DIR = numba_config.CACHE_DIR, str(CACHE)
    try:
        return KernelCache(function, allocates)
    except OSError:  # the disk is full
        return None
    finally:
        numba_config.CACHE_DIR = before

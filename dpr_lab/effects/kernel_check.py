"""Trial compilation of the kernels of a plugin's effect, before all kernels are compiled together."""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from inspect import isfunction
from typing import Any

import numba
from numba.core import types

from dpr_lab.effects.effect import Effect
from dpr_lab.effects.fold import arguments
from dpr_lab.effects.quantities import BaseParameters, EncoderReading, Joint, Motion, RigConstants, Terms
from dpr_lab.kernel_cache import CACHE


def _filled(kind: Any) -> Any:
    return kind._make([0.1] * len(kind._fields))


QUANTITIES: dict[str, Any] = {
    "joint": _filled(Joint),
    "motion": _filled(Motion),
    "base": _filled(BaseParameters),
    "constants": _filled(RigConstants),
    "encoder": EncoderReading(1, 0.1, 0.0, 4096.0, 0.1, 0),
}
"""Example of each kernel argument that is a tuple; all other arguments are numbers."""


def compile_errors(effect: Effect) -> Iterator[str]:
    """Describe each kernel that cannot be compiled or returns a wrong type.

    A kernel must return a number. In the stages `torque` and `load`, a kernel that has no argument `joint` returns
    `Terms` instead. Effects that passed the test are recorded in the kernel cache and not tested again.
    """
    mark = CACHE / f"checked-{effect.name}" if CACHE is not None else None
    if mark is not None and mark.exists():
        return
    kernels = [effect.kernel, *(k for state in effect.internal for k in (state.after, state.sliding) if k is not None)]
    sentences = [sentence for kernel in kernels if (sentence := _error(kernel, effect))]
    yield from sentences
    if mark is not None and not sentences:
        with suppress(OSError):
            mark.touch()


def _error(kernel: Callable[..., Any], effect: Effect) -> str:
    if not isfunction(kernel):
        return f"the kernel {kernel!r} is not a Python function: use only the decorator `inlined` of dpr_lab.kernels"
    name, required = kernel.__name__, arguments(kernel)
    examples = [QUANTITIES.get(argument, 0.1) for argument in required]
    dispatcher: Any = numba.njit(error_model="numpy")(kernel)
    try:
        dispatcher.compile(tuple(numba.typeof(example) for example in examples))
    except Exception as error:  # the compiler raises errors of any class for code that it does not support
        return f"{_place(kernel, str(error))}the kernel {name} cannot be compiled: {_cause(str(error))}"
    returned = dispatcher.nopython_signatures[0].return_type
    whole = kernel is effect.kernel and effect.stage in ("torque", "load") and "joint" not in required
    right = returned == numba.typeof(Terms(*[0.0] * 5)) if whole else isinstance(returned, types.Number)
    kind = "torques(torque1, torque2) or Terms" if whole else "a number"
    return "" if right else f"{_place(kernel, '')}the kernel {name} must return {kind} on every path, not {returned}"


def _place(kernel: Callable[..., Any], message: str) -> str:
    """Return the file and line of an error.

    If the message does not contain them, the file and line of the kernel are returned.
    """
    code = kernel.__code__
    lines = re.findall(r'File "([^"]+)", line (\d+)', message) or [(code.co_filename, str(code.co_firstlineno))]
    return f"{lines[-1][0].rpartition('/')[2]}, line {lines[-1][1]}: "


def _cause(message: str) -> str:
    """Return the first informative sentence of a compiler error, without its formatting."""
    plain = [re.sub(r"\x1b\[[0-9;]*m", "", line).strip() for line in message.splitlines()]
    causes = [line for line in plain if line and not line.startswith(("Failed in", "File ", ">>>", "-", "During:"))]
    return causes[0].partition(" Raised from")[0].rstrip(".:") if causes else "unknown reason"

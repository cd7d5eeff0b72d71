"""Effects of one stage as one compiled function: a zero amplitude switches an effect off, nothing is recompiled."""

import inspect
import linecache
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from dpr_lab.effects.effect import Effect
from dpr_lab.kernels import subroutine


def slices(effects: Iterable[Effect]) -> dict[str, slice]:
    """Where each effect's parameters lie in the flat vector, in the order of `effects`."""
    places: dict[str, slice] = {}
    start = 0
    for effect in effects:
        places[effect.name] = slice(start, start + len(effect.parameters))
        start += len(effect.parameters)
    return places


def arguments(kernel: Callable[..., Any]) -> tuple[str, ...]:
    """Names of what a kernel asks for."""
    return tuple(inspect.signature(kernel).parameters)


def call(kernel: str, wanted: Iterable[str], *offered: Mapping[str, str]) -> str:
    """The source of a call that hands a kernel each argument by the first expression offered under its name."""
    values = [next(source[name] for source in offered if name in source) for name in wanted]
    return f"{kernel}({', '.join(values)})"


def compiled(lines: Iterable[str], names: Mapping[str, Any]) -> Any:
    """The function `folded` of some source lines, compiled.

    It is one function written out: a chain of closures that call each other costs ten times as much where all are off.
    The disk cache cannot recognise it again; the kernels that call it are cached with its code inside. `inspect` finds
    its source.
    """
    scope, source = dict(names), "\n".join(lines)
    file = f"<{__name__} {len(linecache.cache)}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    exec(compile(source, file, "exec"), scope)
    return subroutine(scope["folded"])

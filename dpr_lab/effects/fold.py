"""Slices of the parameter vector, and generation of the source code that evaluates effects."""

import inspect
import linecache
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from dpr_lab.effects.effect import Effect
from dpr_lab.kernels import subroutine


def slices(effects: Iterable[Effect]) -> dict[str, slice]:
    """Return, for each effect, the slice of the flat vector that contains its parameters.

    The effects keep their order.
    """
    blocks: dict[str, slice] = {}
    start = 0
    for effect in effects:
        blocks[effect.name] = slice(start, start + len(effect.parameters))
        start += len(effect.parameters)
    return blocks


def arguments(kernel: Callable[..., Any]) -> tuple[str, ...]:
    """Return the names of a kernel's arguments."""
    return tuple(inspect.signature(kernel).parameters)


def call(kernel: str, names: Iterable[str], *offered: Mapping[str, str]) -> str:
    """Return the source of a kernel call.

    Each argument is looked up by its name in the mappings `offered`; the first match is used.
    """
    values = [next(expressions[name] for expressions in offered if name in expressions) for name in names]
    return f"{kernel}({', '.join(values)})"


def compiled(lines: Iterable[str], names: Mapping[str, Any]) -> Any:
    """Compile a function from source lines.

    One generated function is used, because a chain of closures takes ten times as long if all effects are off. The disk
    cache does not store the function itself, but kernels that call it are cached together with its code. Its source is
    registered for `inspect`.

    Args:
        lines: source, with `def name(...)` in the first line
        names: objects by the names that the source uses
    """
    scope, source = dict(names), "\n".join(lines)
    name = source[len("def ") : source.index("(")]
    file = f"<{__name__} {len(linecache.cache)}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    exec(compile(source, file, "exec"), scope)
    return subroutine(scope[name])

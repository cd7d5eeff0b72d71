"""All effects of one stage as one compiled function: a zero amplitude switches an effect off, nothing is recompiled."""

from collections.abc import Callable, Iterable
from typing import Any

import numba

from dpr_lab.effects.effect import Effect, Stage


def slices(effects: Iterable[Effect]) -> dict[str, slice]:
    """Where each effect's parameters lie in the flat vector, in the order of `effects`."""
    places: dict[str, slice] = {}
    start = 0
    for effect in effects:
        places[effect.name] = slice(start, start + len(effect.parameters))
        start += len(effect.parameters)
    return places


def fold(effects: Iterable[Effect], stage: Stage, signature: str, zero: Any, plus: Any) -> Callable[..., Any]:
    """The sum of the kernels of one stage, of those effects that are on.

    It is one function written out: a chain of closures that call each other costs ten times as much where all are off.
    The disk cache cannot recognise it again; the kernels that call it are cached with its code inside.

    Args:
        effects: all effects, in the order of the vector
        stage: which of them
        signature: arguments that all kernels of the stage share, as in `motion, rods, known`
        zero: the sum of none
        plus: compiled sum of two

    Returns:
        compiled (*signature, vector, on) -> sum, with `on` of `dpr_lab.effects.switched`
    """
    effects = tuple(effects)
    names: dict[str, Any] = {"zero": zero, "plus": plus}
    lines = [f"def folded({signature}, vector, on):", "    total = zero"]
    for index, (effect, place) in enumerate(zip(effects, slices(effects).values(), strict=True)):
        if effect.stage == stage:
            names[effect.name] = effect.kernel
            lines += [
                f"    if on[{index}]:",
                f"        total = plus(total, {effect.name}({signature}, vector, {place.start}))",
            ]
    exec("\n".join([*lines, "    return total"]), names)
    return numba.njit(error_model="numpy", nogil=True)(names["folded"])

"""How many digits of a number to show: as many as its uncertainty supports."""

import math
from collections.abc import Iterable

NONE = "–"

NUMERIC = frozenset("0123456789 .,;:()+-\N{EN DASH}\N{MINUS SIGN}\N{PLUS-MINUS SIGN}<>≤≥~%e")
"""What numbers, intervals and times are written with: they read from the right, words from the left."""


def plus_minus(value: float, std: float | None) -> str:
    """A value with its standard deviation, to two digits of the latter; three digits of a value that has none."""
    if std is None:
        return f"{value:.3g}"
    if std == 0:
        return f"{value:.4g}"
    return _scaled("{} ± {}", (value, std), value, std)


def interval(low: float, high: float, value: float, std: float) -> str:
    """The interval around a value, to the places that `plus_minus` gives the value itself."""
    if std == 0:
        return f"{low:.4g} to {high:.4g}"
    return _scaled("{} to {}", (low, high), value, std)


def with_interval(value: float, low: float, high: float) -> str:
    """`0.1472 (0.1467 to 0.1476)`: to two digits of the half width of the interval."""
    reach = max(high - value, value - low)
    if not reach > 0 or not math.isfinite(reach):
        return f"{value:.4g} ({low:.4g} to {high:.4g})"
    return _scaled("{} ({} to {})", (value, low, high), value, reach)


def three(number: float) -> str:
    """Three digits, for what is read in passing; all of them up to a million; a dash for what is not known."""
    if not math.isfinite(number):
        return NONE
    return f"{number:.0f}" if 100 <= abs(number) < 1e6 else f"{number:#.3g}".rstrip(".")


def pair(numbers: Iterable[float]) -> str:
    """The numbers of both rods, inner first."""
    return ", ".join(three(number) for number in numbers)


def _scaled(form: str, numbers: tuple[float, ...], value: float, std: float) -> str:
    """Both numbers to the places of the standard deviation, a power of ten taken out of the unreadable ones."""
    size = max(abs(value), std)
    exponent = 0 if 0.01 <= size < 1e6 else math.floor(math.log10(size))
    unit = 10.0**exponent
    places = max(0, 1 - math.floor(math.log10(std / unit)))
    text = form.format(*(f"{number / unit:.{places}f}" for number in numbers))
    return f"({text})e{exponent}" if exponent else text

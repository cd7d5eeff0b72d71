"""Format numbers with as many digits as their uncertainty supports."""

import math
import re
from collections.abc import Iterable

NONE = "–"

NUMERIC = frozenset("0123456789 .,;:()+-\N{EN DASH}\N{MINUS SIGN}\N{PLUS-MINUS SIGN}<>≤≥~%e")
"""Characters of numbers, intervals and times. Cells that contain only these are aligned right, others left."""

_POWER = re.compile(r"\^(\d)(?!\.?\d)")


def plus_minus(value: float, std: float | None) -> str:
    """Format a value with two significant digits of its standard deviation.

    A value without a standard deviation has three significant digits.
    """
    if std is None:
        return f"{value:.3g}"
    if std == 0:
        return f"{value:.4g}"
    return _scaled("{} ± {}", (value, std), value, std)


def interval(low: float, high: float, value: float, std: float) -> str:
    """Format an interval with as many decimals as `plus_minus` uses for its value."""
    if std == 0:
        return f"{low:.4g} to {high:.4g}"
    return _scaled("{} to {}", (low, high), value, std)


def with_interval(value: float, low: float, high: float) -> str:
    """Format a value with its interval, for example `0.1472 (0.1467 to 0.1476)`.

    The larger half width of the interval has two significant digits.
    """
    half_width = max(high - value, value - low)
    if not half_width > 0 or not math.isfinite(half_width):
        return f"{value:.4g} ({low:.4g} to {high:.4g})"
    return _scaled("{} ({} to {})", (value, low, high), value, half_width)


def with_unit(text: str, unit: str) -> str:
    """Add a unit to a value.

    Examples are `0.80 mN m (0.70 to 0.90)` and `(8 (7 to 9))e-4 m`.
    """
    if text.startswith("("):  # value and interval share a power of ten
        return f"{text} {unit}".strip()
    value, _, interval = text.partition(" (")
    return f"{value} {unit}".strip() + (f" ({interval}" if interval else "")


def three(number: float) -> str:
    """Format a number with three significant digits.

    Integers up to a million are written in full. A number that is not finite is written as a dash.
    """
    if not math.isfinite(number):
        return NONE
    return f"{number:.0f}" if 100 <= abs(number) < 1e6 else f"{number:#.3g}".rstrip(".")


def pair(numbers: Iterable[float]) -> str:
    """Format the numbers of both rods, inner rod first."""
    return ", ".join(three(number) for number in numbers)


def superscripts(text: str) -> str:
    """Write powers as superscripts: `kg m²` for `kg m^2`."""
    return _POWER.sub(lambda power: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power[1])], text)


def _scaled(form: str, numbers: tuple[float, ...], value: float, std: float) -> str:
    """Format numbers with the decimals that the standard deviation supports.

    A power of ten is factored out if needed.
    """
    size = max(abs(value), std)
    exponent = 0 if 0.001 <= size < 1e6 else math.floor(math.log10(size))
    unit = 10.0**exponent
    places = max(0, 1 - math.floor(math.log10(std / unit)))
    text = form.format(*(f"{number / unit:.{places}f}" for number in numbers))
    return f"({text})e{exponent}" if exponent else text

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
    exponent, decimals = _precision(value, std)
    text = " ± ".join(f"{number / 10.0**exponent:.{decimals}f}" for number in (value, std))
    return f"({text})e{exponent}" if exponent else text


def interval(low: float, high: float, value: float, std: float) -> str:
    """Format an interval with as many decimals as `plus_minus` uses for its value."""
    if std == 0:
        return f"{low:.4g} to {high:.4g}"
    return "{} to {}".format(*_rounded((low, high), value, std))


def with_interval(value: float, low: float, high: float) -> str:
    """Format a value with its interval, for example `0.1472 (0.1467 to 0.1476)` or `8e-4 (7e-4 to 9e-4)`.

    The larger half width of the interval has two significant digits.
    """
    half_width = max(high - value, value - low)
    if not half_width > 0 or not math.isfinite(half_width):
        return f"{value:.4g} ({low:.4g} to {high:.4g})"
    return "{} ({} to {})".format(*_rounded((value, low, high), value, half_width))


def with_unit(text: str, unit: str) -> str:
    """Add a unit to a value, for example `0.80 mN m (0.70 to 0.90)`."""
    value, _, interval = text.partition(" (")
    return f"{value} {unit}".strip() + (f" ({interval}" if interval else "")


def three(number: float) -> str:
    """Format a number with three significant digits, for example `0.310` or `7.68e-5`.

    Integers up to a million are written in full. A number that is not finite is written as a dash.
    """
    if not math.isfinite(number):
        return NONE
    mantissa, power, exponent = f"{number:#.3g}".rstrip(".").partition("e")
    if 100 <= abs(number) < 1e6:
        return f"{number:.0f}"
    return f"{mantissa}e{int(exponent)}" if power else mantissa


def pair(numbers: Iterable[float]) -> str:
    """Format the numbers of both rods, inner rod first."""
    return ", ".join(three(number) for number in numbers)


def superscripts(text: str) -> str:
    """Write powers as superscripts: `kg m²` for `kg m^2`."""
    return _POWER.sub(lambda power: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power[1])], text)


def _rounded(numbers: tuple[float, ...], value: float, std: float) -> list[str]:
    """Format numbers with the decimals that the standard deviation supports.

    The numbers have the power of ten of `value`. A number of at least ten times this power has the next power.
    """
    return [_written(number, *_precision(value, std)) for number in numbers]


def _written(number: float, exponent: int, decimals: int) -> str:
    text = f"{number / 10.0**exponent:.{decimals}f}"
    if exponent and abs(float(text)) >= 10:
        return _written(number, exponent + 1, decimals + 1)
    if exponent and not float(text):
        return "0"
    return f"{text}e{exponent}" if exponent else text


def _precision(value: float, std: float) -> tuple[int, int]:
    """Return the power of ten of a value, and the decimals that the standard deviation supports.

    The power is 0 for values from 0.001 to 1e6.
    """
    size = max(abs(value), std)
    exponent = 0 if 0.001 <= size < 1e6 else math.floor(math.log10(size))
    decimals = max(0, 1 - math.floor(math.log10(std / 10.0**exponent)))
    if exponent and round(size / 10.0**exponent, decimals) >= 10:
        return exponent + 1, decimals + 1
    return exponent, decimals

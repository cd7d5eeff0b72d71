"""Parse numbers with units, and convert them to the units of the library."""

import math
import re
from collections.abc import Mapping

_PREFIXES = {"": 1.0, "m": 1e-3, "u": 1e-6}
_ANGLES = {"rad": 1.0, "deg": math.radians(1.0)}
_TORQUE = {
    **{f"{prefix}Nm": factor for prefix, factor in _PREFIXES.items()},
    "Ncm": 1e-2,
    "Nmm": 1e-3,
    "mNmm": 1e-6,
    "kgm2/s2": 1.0,
}

UNITS: Mapping[str, Mapping[str, float]] = {
    "N m": _TORQUE,
    "N m/rad": {f"{torque}/{angle}": x / y for torque, x in _TORQUE.items() for angle, y in _ANGLES.items()},
    "N m/rad^3": {f"{torque}/rad3": factor for torque, factor in _TORQUE.items()},
    "N m s/rad": {f"{torque}s{angle}": factor for torque, factor in _TORQUE.items() for angle in ("", "/rad")},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "rad": {**_ANGLES, "mrad": 1e-3, "urad": 1e-6, "arcmin": math.radians(1.0 / 60.0)},
    "m/s^2": {"m/s2": 1.0, "mm/s2": 1e-3},
    "kg m^2": {"kgm2": 1.0, "kgcm2": 1e-4, "gcm2": 1e-7, "gm2": 1e-3, "kgmm2": 1e-6},
    "kg/m^2": {"kg/m2": 1.0, "g/m2": 1e-3},
    "1/kg": {"1/kg": 1.0, "kg-1": 1.0, "1/g": 1e3},
    "1": {"%": 1e-2, "ppm": 1e-6, "1": 1.0},
    "counts": {"counts": 1.0, "count": 1.0},
}
"""Conversion factors to the unit of a parameter, by this unit and by accepted unit (without spaces and signs)."""

DISPLAYED: Mapping[str, tuple[str, float]] = {
    "N m": ("mN m", 1e3),
    "N m/rad": ("mN m/rad", 1e3),
    "N m/rad^3": ("mN m/rad³", 1e3),
    "N m s/rad": ("mN m s/rad", 1e3),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "rad": ("mrad", 1e3),
    "m/s^2": ("m/s²", 1.0),
    "kg m^2": ("kg cm²", 1e4),
    "kg/m^2": ("g/m²", 1e3),
    "1": ("%", 1e2),
}
"""Displayed unit and factor to it, for each SI unit of an amplitude."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf(?:inity)?)\b)(.*)", re.IGNORECASE)
_SPELLINGS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "³": "3", "°": "deg", "*": "", "·": "", "⋅": "", "^": ""})


def split_quantity(text: str) -> tuple[float, str]:
    """Split a text such as `6.1mN m` into number and unit, 6.1 and `mN m`.

    Raises:
        ValueError: the text does not start with a number.
    """
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        raise ValueError(f"{text!r} is not a number with its unit")
    if re.match(r",\d", match[2]):
        raise ValueError(f"{text!r}: write the number with a decimal point")
    return float(match[1]), match[2].strip()


def read_quantity(text: str, unit: str, example: str) -> float:
    """Convert a text such as `6.1 mN m` or `6.1mN*m` to the library's unit.

    Args:
        text: number and unit
        unit: unit of the library, a key of `UNITS`
        example: accepted number with its unit, for the message

    Raises:
        ValueError: the number or the unit is missing, or the unit belongs to another quantity; the message lists the
            accepted units.
    """
    number, written = split_quantity(text)
    stated, expected = _normal(written), _normal(unit)
    accepted = UNITS.get(unit, {expected: 1.0})
    if stated in accepted:
        return number * accepted[stated]
    problem = f"{written!r} is not a unit of this quantity" if stated else "the unit is missing"
    raise ValueError(f"{text!r}: {problem}. Accepted units: {', '.join(accepted)}. Example: {example}")


def _normal(unit: str) -> str:
    """Return the unit in the spelling of `UNITS`: without spaces, multiplication signs or carets.

    Superscripts become digits, and micro and degree signs become letters.
    """
    return "".join(unit.translate(_SPELLINGS).split())

"""Effects in words: `Coulomb friction, joint 2 [coulomb_joint2]`, and their sizes in units that a person reads."""

import re
from collections.abc import Mapping

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import three

_READ = {
    "N m": ("mN m", 1e3),
    "N m/rad": ("mN m/rad", 1e3),
    "N m/rad^3": ("mN m/rad³", 1e3),
    "N m s/rad": ("mN m s/rad", 1e3),
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "m/s^2": ("m/s²", 1.0),
    "kg m^2": ("kg cm²", 1e4),
    "kg/m^2": ("g/m²", 1e3),
    "1": ("%", 1e2),
}
"""Unit of an amplitude -> the unit in which it is read, and the factor to it."""

_IDENTIFIER = re.compile(rf"(?<![\[\w])(?<!--without )({'|'.join(sorted(EFFECTS, key=len, reverse=True))})(?!\w)")
_PLACE = re.compile(r"\b(joint|encoder)([12])\b")
_POWER = re.compile(r"\^(\d)")
_UNIT = re.compile(r"(_(per|Nms?|m2?|rad3?|s2?|kg(m2)?|Hz))+$")


def named(name: str, size: str = "") -> str:
    """An effect's words, its size if that is given, and its identifier; what is no effect stays."""
    if name not in EFFECTS:
        return name
    return f"{EFFECTS[name].words}{f' ({size})' if size else ''} [{name}]"


def in_words(text: str, sizes: Mapping[str, str] | None = None) -> str:
    """A text with words before every identifier of an effect that has none yet, and sizes where they are given.

    An identifier after `--without` stays as it is: the option can be pasted.
    """

    def words(found: re.Match[str]) -> str:
        told = named(found[0], (sizes or {}).get(found[0], ""))
        return told[0].upper() + told[1:] if text[: found.start()].endswith(". ") else told

    worded = _IDENTIFIER.sub(words, text)
    return _PLACE.sub(r"\1 \2", worded)


def scaled_unit(text: str) -> str:
    """A text with powers as a person reads them: `kg m²` of `kg m^2`."""
    return _POWER.sub(lambda power: "⁰¹²³⁴⁵⁶⁷⁸⁹"[int(power[1])], text)


def parameter_words(name: str) -> str:
    """`extra at rest` of `extra_at_rest_Nm`."""
    return _UNIT.sub("", name).replace("_", " ")


def negative_words(effect: str, name: str, value: float) -> str:
    """What a parameter below zero means; empty for others, and where the sign needs no words."""
    known = (p for p in EFFECTS[effect].parameters if p.name == name) if effect in EFFECTS else ()
    parameter = next(iter(known), None)
    return parameter.negative if parameter is not None and value < 0 else ""


def size_words(effect: str, name: str, angles: AngleUnit = RADIANS, *values: float) -> str:
    """`0.80 mN m`, or `0.80 mN m (0.70 to 0.90)` of a value and its interval.

    Args:
        effect: name of the effect
        name: one of its parameters
        angles: the unit of angles
        values: SI: the value alone, or the value and both ends of its interval
    """
    known = (p for p in EFFECTS[effect].parameters if p.name == name) if effect in EFFECTS else ()
    unit, factor = _read_in(next(iter(known), None), angles)
    value, *ends = (three(factor * value) for value in values)
    return f"{value} {unit}".strip() + (f" ({ends[0]} to {ends[1]})" if ends else "")


def _read_in(parameter: EffectParameter | None, angles: AngleUnit) -> tuple[str, float]:
    match parameter:
        case None:
            return "", 1.0
        case EffectParameter(unit="rad"):
            return angles.small, angles.small_per_rad
        case EffectParameter(unit="rad/s"):
            return f"{angles.symbol.strip()}/s", angles.per_rad
        case EffectParameter(role="amplitude", unit=unit) if unit in _READ:
            return _READ[unit]
        case EffectParameter(unit="1"):
            return "", 1.0
    return parameter.unit, 1.0

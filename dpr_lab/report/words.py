"""Describe effects, and format their sizes in practical units.

A description is for example `Coulomb friction, joint 2 [coulomb_joint2]`.
"""

import re

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.units import DISPLAYED
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import three, with_interval, with_unit
from dpr_lab.report.run_names import run_label

_IDENTIFIER = re.compile(rf"(?<![\[\w])(?<!--without )({'|'.join(sorted(EFFECTS, key=len, reverse=True))})(?!\w)")
_PLACE = re.compile(r"\b(joint|encoder)([012])\b")
_RUN = re.compile(r"(?<![\w/])\d{8}T\d{6}Z_[\w.-]+_[0-9a-f]{8}(?:-\d+)?+(?!\.?\w)")
"""Name of a recorded run without the ending of its file."""


def named(name: str) -> str:
    """Return the description and the identifier of an effect; other text is returned unchanged."""
    return f"{EFFECTS[name].words} [{name}]" if name in EFFECTS else name


def in_words(text: str) -> str:
    """Add a description to each effect identifier that has none in a text, and replace run names by their labels.

    An identifier after `--without` is not changed, so that the option can be copied.
    """

    def words(match: re.Match[str]) -> str:
        label = named(match[0])
        return label[0].upper() + label[1:] if match.string[: match.start()].endswith(". ") else label

    labelled = _RUN.sub(lambda match: run_label(match[0]), text)
    return _PLACE.sub(r"\1 \2", _IDENTIFIER.sub(words, labelled))


def parameter_words(effect: str, name: str) -> str:
    """Return the description of a parameter, for example `extra at rest` for `extra_at_rest_Nm`."""
    parameter = _parameter(effect, name)
    return name if parameter is None else parameter.words


def negative_words(effect: str, name: str, value: float) -> str:
    """Return the meaning of a negative value of a parameter.

    The text is empty for other values, or if the sign needs no explanation.
    """
    parameter = _parameter(effect, name)
    return parameter.negative if parameter is not None and value < 0 else ""


def size_words(effect: str, name: str, angles: AngleUnit = RADIANS, *values: float) -> str:
    """Format a size with or without its interval.

    An example is `0.80 mN m (0.70 to 0.90)`. A selected integer has no interval.

    Args:
        effect: name of the effect
        name: one of its parameters
        angles: the unit of angles
        values: value in SI units, optionally followed by both ends of its interval
    """
    parameter = _parameter(effect, name)
    unit, factor = _displayed_unit(parameter, angles)
    if len(set(values)) == 1:  # a chosen value has no interval
        values = values[:1]
        if parameter is not None and parameter.whole:
            return with_unit(f"{values[0]:.0f}", unit)
    scaled = [factor * value for value in values]
    value, *ends = map(three, scaled)
    if value in ends and len(set(scaled)) > 1:  # three digits would not show the interval
        return with_unit(with_interval(*scaled), unit)
    return with_unit(f"{value} ({ends[0]} to {ends[1]})" if ends else value, unit)


def _parameter(effect: str, name: str) -> EffectParameter | None:
    if effect not in EFFECTS:
        return None
    return next((p for p in (*EFFECTS[effect].parameters, *EFFECTS[effect].derived) if p.name == name), None)


def _displayed_unit(parameter: EffectParameter | None, angles: AngleUnit) -> tuple[str, float]:
    match parameter:
        case None:
            return "", 1.0
        case EffectParameter(unit="rad"):
            return angles.small, angles.small_per_rad
        case EffectParameter(unit="rad/s"):
            return f"{angles.symbol.strip()}/s", angles.per_rad
        case EffectParameter(role="amplitude", unit=unit) if unit in DISPLAYED:
            return DISPLAYED[unit]
        case EffectParameter(unit="1"):
            return "", 1.0
    return parameter.unit, 1.0

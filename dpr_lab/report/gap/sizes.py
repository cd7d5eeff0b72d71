"""Sizes of named effects: the ratio to b first if only ratios are identified, then the absolute value."""

from dpr_lab.gap.result.diagnosis import Diagnosis, EffectSize, NamedEffect
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import scaled_unit, with_interval
from dpr_lab.report.words import negative_words, parameter_words, size_words


def only_ratios(diagnosis: Diagnosis) -> bool:
    """Whether only prior bounds determine the scale, so that only ratios to b are identified."""
    return diagnosis.scale is not None and not diagnosis.scale.known


def assumed(diagnosis: Diagnosis) -> str:
    """`assuming b = 0.00534 kg m² (not measured)`; empty where the scale is known."""
    return scaled_unit(diagnosis.scale.assumption) if diagnosis.scale and not diagnosis.scale.known else ""


def scale_note(diagnosis: Diagnosis) -> str:
    """The assumption behind all absolute sizes of a diagnosis; empty in a diagnosis of an older version."""
    return scaled_unit(diagnosis.scale.sentence) if diagnosis.scale else ""


def sizes_cell(diagnosis: Diagnosis, effect: NamedEffect, angles: AngleUnit = RADIANS) -> str:
    """All parameters of an effect with intervals; ratios first if only these are identified."""
    ratios = [_ratio(name, size) for name, size in effect.parameters.items() if size.ratio is not None]
    ratios = ratios if only_ratios(diagnosis) else []
    scaled, others = [], []
    for name, size in effect.parameters.items():
        words = f"{parameter_words(name)} {_absolute(effect, name, size, angles)}"
        (scaled if ratios and size.ratio is not None else others).append(words)
    absolute = [f"{assumed(diagnosis)}: {', '.join(scaled)}"] if scaled else []
    signs = [negative_words(effect.name, name, size.value) for name, size in effect.parameters.items()]
    return "; ".join([*ratios, *absolute, *others, *filter(None, signs)])


def _ratio(name: str, size: EffectSize) -> str:
    """`torque / b = 0.1472 1/s² (0.1467 to 0.1476)`."""
    ratio = size.ratio or 0.0
    value, _, interval = with_interval(ratio, *(size.ratio_interval90 or (ratio, ratio))).partition(" (")
    operator = "· b" if size.ratio_unit == "m^2" else "/ b"  # a size in 1/kg falls as the scale rises
    unit = "" if size.ratio_unit == "1" else f" {scaled_unit(size.ratio_unit)}"
    return f"{parameter_words(name)} {operator} = {value}{unit} ({interval}"


def _absolute(effect: NamedEffect, name: str, size: EffectSize, angles: AngleUnit) -> str:
    """`0.796 mN m (0.70 to 0.90)`, the uncertainty of the scale included."""
    return size_words(effect.name, name, angles, size.value, *(size.interval90_with_scale or size.interval90))

"""Format the sizes of named effects.

If only ratios are identified, the ratio to b precedes the absolute value.
"""

from collections.abc import Mapping

from dpr_lab.effects import EFFECTS
from dpr_lab.exports.corrected import significant_values
from dpr_lab.gap.result.causes import FittedEffect, NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.angles import RADIANS, AngleUnit
from dpr_lab.report.digits import NONE, superscripts, three, with_interval, with_unit
from dpr_lab.report.words import negative_words, parameter_words, size_words

RUN = "run"
"""Name of a parameter that is not a size but the index of a recording. The recommended action names this recording."""

IN_MODELS = "in the exported models"
"""Words before the sizes that the exported models contain instead of the fitted sizes."""


def only_ratios(diagnosis: Diagnosis) -> bool:
    """Check whether only ratios to the inertia b are identified, so that only prior bounds determine the scale."""
    return diagnosis.scale is not None and not diagnosis.scale.known


def assumed(diagnosis: Diagnosis) -> str:
    """Return the assumed scale, for example `assuming b = 0.00534 kg m² (not measured)`.

    The text is empty if the scale is known.
    """
    return superscripts(diagnosis.scale.assumption) if diagnosis.scale and not diagnosis.scale.known else ""


def scale_note(diagnosis: Diagnosis) -> str:
    """Return the sentence on the scale of absolute values; empty for a diagnosis of an older version."""
    return superscripts(diagnosis.scale.sentence) if diagnosis.scale else ""


def sizes_cell(diagnosis: Diagnosis, effect: FittedEffect, angles: AngleUnit = RADIANS, *, brief: bool = False) -> str:
    """Format the parameters of an effect with intervals for a table cell.

    Ratios come first if only ratios are identified. Parameters that are held at zero follow, then the sizes in the
    exported models if these differ. If `brief` is true, amplitudes whose interval contains zero are listed only by
    name, unless the intervals of all amplitudes contain zero.
    """
    parameters = {name: size for name, size in effect.parameters.items() if name != RUN}
    sizes = {name: size for name, size in parameters.items() if any((size.value, *size.interval90))}
    zeros = ", ".join(parameter_words(effect.name, name) for name in parameters if name not in sizes)
    unclear = effect.insignificant if brief else set()
    open_words = ", ".join(parameter_words(effect.name, name) for name in sizes if name in unclear)
    sizes = {name: size for name, size in sizes.items() if name not in unclear}
    words = {
        name: size_words(effect.name, name, angles, size.value, *(size.interval90_with_scale or size.interval90))
        for name, size in sizes.items()
    }
    ratios = {
        name: _ratio(
            size.ratio_unit, _inertia(diagnosis), size.ratio, *(size.ratio_interval90 or (size.ratio, size.ratio))
        )
        for name, size in sizes.items()
        if size.ratio is not None
    }
    signs = [negative_words(effect.name, name, size.value) for name, size in sizes.items()]
    at_zero = f"at zero: {zeros}" if zeros else ""
    around_zero = f"not distinguishable from zero: {open_words}" if open_words else ""
    in_models = _in_models(diagnosis, effect.name, angles) if isinstance(effect, NamedEffect) else ""
    ends = [*signs, around_zero, at_zero, in_models]
    return "; ".join([*_ratios_first(diagnosis, effect.name, words, ratios), *filter(None, ends)])


def _in_models(diagnosis: Diagnosis, effect: str, angles: AngleUnit) -> str:
    """Return the sizes that the exported models contain instead of the fitted sizes; empty if none differ.

    The models omit insignificant amplitudes, which changes the other sizes (`dpr_lab.exports.corrected`).
    """
    if effect not in diagnosis.model_effects:
        return ""
    fitted, exported = (
        {name: size_words(effect, name, angles, size) for name, size in sizes.get(effect, {}).items() if size}
        for sizes in (diagnosis.model_effects, significant_values(diagnosis)[1])
    )
    changed = [f"{parameter_words(effect, name)} {size}" for name, size in exported.items() if fitted.get(name) != size]
    return f"{IN_MODELS}: {', '.join(changed)}" if changed else ""


def true_sizes_cell(diagnosis: Diagnosis, effect: str, sizes: Mapping[str, float]) -> str:
    """Format the true sizes of an effect for a table cell.

    The sizes are stated at the inertia b of the diagnosis. Ratios come first if only ratios are identified.
    """
    words = {name: size_words(effect, name, RADIANS, value) for name, value in sizes.items()}
    scaled = {p.name: p for p in EFFECTS[effect].parameters if p.name in sizes and p.scale_power}
    assumed_b = diagnosis.scale.b if diagnosis.scale else diagnosis.scale_b
    ratios = {
        name: _ratio(p.ratio_unit, _inertia(diagnosis), sizes[name] / assumed_b**p.scale_power)
        for name, p in scaled.items()
    }
    return "; ".join(_ratios_first(diagnosis, effect, words, ratios)) or NONE


def _ratios_first(diagnosis: Diagnosis, effect: str, sizes: Mapping[str, str], ratios: Mapping[str, str]) -> list[str]:
    """Return the texts of ratios, then of sizes at the assumed b, then of other sizes.

    Ratios are omitted if the scale is known.
    """
    ratios = ratios if only_ratios(diagnosis) else {}
    labelled = {name: f"{parameter_words(effect, name)} {words}" for name, words in sizes.items()}
    scaled = [words for name, words in labelled.items() if name in ratios]
    others = [words for name, words in labelled.items() if name not in ratios]
    return [
        *(f"{parameter_words(effect, name)} {ratio}" for name, ratio in ratios.items()),
        *([f"{assumed(diagnosis)}: {', '.join(scaled)}"] if scaled else []),
        *others,
    ]


def _inertia(diagnosis: Diagnosis) -> str:
    """Return the reference inertia of the ratios: b, or a for an inner rod alone."""
    return diagnosis.scale.inertia if diagnosis.scale else "b"


def _ratio(unit: str, inertia: str, ratio: float, *interval90: float) -> str:
    """Format a ratio, for example `/ b = 0.1472 1/s² (0.1467 to 0.1476)`.

    The interval is optional.
    """
    operator = f"{'·' if unit == 'm^2' else '/'} {inertia}"  # a size in 1/kg decreases as the scale increases
    shown = "" if unit == "1" else superscripts(unit)
    size = with_unit(with_interval(ratio, *interval90) if interval90 else three(ratio), shown)
    return f"{operator} = {size}"

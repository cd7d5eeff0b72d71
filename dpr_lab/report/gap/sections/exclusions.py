"""Show excluded effects, which would be visible in the recordings at the stated size."""

from collections import defaultdict

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import EXCLUDED, Exclusion
from dpr_lab.report.angles import RADIANS
from dpr_lab.report.gap.section import EvidenceSection, evidence_of
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import in_words, named, parameter_words, size_words
from dpr_lab.shown import percent


def exclusion_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the number of excluded effects and the limits of this statement."""
    excluded, not_excluded = _split(diagnosis)
    undetectable = [name for name, sizes in diagnosis.detectable.items() if sizes and not any(sizes.values())]
    sentences = [
        f"Excluded effects of the library: {len(excluded)}. Each is absent or smaller than the size in the table. The"
        " confidence that a larger effect would have been detected in these recordings is at least"
        f" {percent(EXCLUDED.sure)} ({percent(EXCLUDED.of_shapes)} for effects of unknown order, frequency or speed)."
        " Effects that are indistinguishable from a named effect are not listed."
        if excluded
        else "No effect of the library is excluded."
    ]
    if not_excluded:
        sentences.append(
            "Not excluded, because the remainder has a component with the signature of the effect:"
            f" {', '.join(map(named, not_excluded))}. A further release shows whether this component recurs."
        )
    if undetectable:
        names = in_words(", ".join(undetectable))
        condition = "If the named effects act, these" if diagnosis.effects else "These"
        sentences.append(f"{condition} effects are undetectable at any size: {names}.")
    if diagnosis.open_gap and excluded:
        sentences.append(
            "The remainder has no named cause and could hide an effect. The stated confidence assumes that"
            " the signature of the remainder differs from the signature of the effect."
        )
    return sentences


@page_table("effect", "excluded from this size", "confidence", style="prose", title="All excluded effects")
def exclusion_table(diagnosis: Diagnosis) -> Rows:
    """Return one row for each excluded effect, in the order of the library."""
    excluded, _ = _split(diagnosis)
    return [
        (
            named(name),
            ", ".join(
                f"{parameter_words(name, e.parameter)} {size_words(name, e.parameter, RADIANS, e.size)}"
                for e in exclusions
            ),
            _percent(min(e.confidence for e in exclusions)),
        )
        for name, exclusions in excluded.items()
    ]


def _split(diagnosis: Diagnosis) -> tuple[dict[str, list[Exclusion]], list[str]]:
    """Return the excluded effects with their amplitudes, and the names of the effects that are not excluded."""
    by_effect: dict[str, list[Exclusion]] = defaultdict(list)
    for exclusion in evidence_of(diagnosis).exclusions:
        by_effect[exclusion.effect].append(exclusion)
    order = [name for name in diagnosis.detectable if name in by_effect]
    excluded = {name: by_effect[name] for name in order if all(e.is_excluded for e in by_effect[name])}
    not_excluded = [name for name in order if name not in excluded]
    possible = {name for effect in diagnosis.effects for name in effect.members}
    return {name: excluded[name] for name in excluded if name not in possible}, not_excluded


def _percent(confidence: float) -> str:
    return "> 99.9 %" if confidence > 0.999 else percent(confidence, 1)


EXCLUSIONS = EvidenceSection(
    name="exclusions",
    title="Excluded effects",
    words=exclusion_words,
    tables=(exclusion_table,),
    symbols="Size: 5 σ. Here σ is the standard deviation of a, the linear estimate of the effect when it is fitted in"
    " addition to all named effects; σ includes the correlation of the residuals. Confidence: Φ(5 − |a| / σ).",
)

"""What the rig does not have: least detectable sizes read as exclusions."""

from collections import defaultdict

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.report.angles import RADIANS
from dpr_lab.report.gap.section import PAGE, EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.words import in_words, named, parameter_words, size_words


def exclusion_words(diagnosis: Diagnosis) -> list[str]:
    """What can be said, and what not."""
    sure, open_ = _split(diagnosis)
    blind = [name for name, sizes in diagnosis.detectable.items() if sizes and not any(sizes.values())]
    said = [
        f"{len(sure)} of the effects of the library are not there, or are smaller than the size beside their name: a"
        f" larger one"
        f" would have shown in these recordings. Each line says how sure that is; {PAGE.sure:.0%} at least.",
        "Below that size nothing is said. An effect that does the same to the readings as one that is named stands in"
        " for it,"
        " and is excluded only beside it.",
    ]
    if open_:
        said.append(
            f"Not excluded, for what is left of the gap has a part of their shape: {', '.join(map(named, open_))}."
        )
    if blind:
        names = in_words(", ".join(blind))
        said.append(
            f"Beside what is named no size of {names} would show in these recordings: of these nothing is known."
        )
    if diagnosis.verdict in ("partly_explained", "unexplained"):
        said.append(
            "What is left of the gap has no name, and could hide an effect that works against it: the confidence counts"
            " on its being of another shape."
        )
    return said


def exclusion_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """One row for each effect that is excluded, the surest kinds by name."""
    sure, _ = _split(diagnosis)
    return [
        (
            named(name),
            ", ".join(
                f"{parameter_words(i.parameter)} {size_words(name, i.parameter, RADIANS, i.size)}" for i in items
            ),
            _confident(min(item.confidence for item in items)),
        )
        for name, items in sure.items()
    ]


def _split(diagnosis: Diagnosis) -> tuple[dict[str, list[Exclusion]], list[str]]:
    """Excluded effects with their amplitudes, and those that are not."""
    by_effect: dict[str, list[Exclusion]] = defaultdict(list)
    for item in evidence_of(diagnosis).exclusions:
        by_effect[item.effect].append(item)
    order = [name for name in diagnosis.detectable if name in by_effect]
    sure = {name: by_effect[name] for name in order if all(item.confidence >= PAGE.sure for item in by_effect[name])}
    return sure, [name for name in order if name not in sure]


def _size(item: Exclusion) -> str:
    return f"{parameter_words(item.parameter)} {size_words(item.effect, item.parameter, RADIANS, item.size)}"


def _confident(confidence: float) -> str:
    return "> 99.9%" if confidence > 0.999 else f"{confidence:.1%}"


EXCLUSIONS = EvidenceSection(
    name="exclusions",
    title="What it is not",
    words=exclusion_words,
    tables=(
        FoldedTable("Every excluded effect", ("effect", "not there from this size on", "confidence"), exclusion_rows),
    ),
    symbols="Size: 5 s, s the standard deviation of its linear estimate a beside all that is named, correlation of"
    " the residuals"
    " included. Confidence: Φ(5 − |a| / s).",
)

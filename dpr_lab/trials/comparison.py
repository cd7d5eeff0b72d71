"""Table of a revealed trial: the hidden effects with their diagnosis, and the wrongly named effects.

If the recordings determine only ratios to b, true and estimated sizes are given as ratios, followed by the absolute
values at the assumed b.
"""

from dpr_lab.gap.result.causes import NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.digits import NONE
from dpr_lab.report.gap.sizes import sizes_cell, true_sizes_cell
from dpr_lab.report.words import named
from dpr_lab.rig import Rig
from dpr_lab.shown import percent
from dpr_lab.trials.protocol import Opened
from dpr_lab.trials.score import cause_named
from dpr_lab.trials.truth import assumed_inertia

COLUMNS = ("hidden effect", "true size", "diagnosis", "estimated size, 90 % interval", "probability")


def comparison_rows(opened: Opened, rig: Rig) -> list[tuple[str, ...]]:
    """Return one row for each hidden effect, and one for each wrongly named effect.

    A cell of sizes has one line for each size.
    """
    truth, diagnosis = opened.truth, Diagnosis.model_validate(opened.diagnosis)
    unmatched = [effect for effect in diagnosis.effects if effect.name in opened.outcome.named]
    sizes = truth.sizes(rig, assumed_inertia(opened.diagnosis, rig))
    rows: list[tuple[str, ...]] = []
    for number, right in enumerate(truth.answers):
        hit = next(
            (effect for effect in unmatched if cause_named(effect.model_dump(by_alias=True), truth) == number), None
        )
        unmatched = [effect for effect in unmatched if effect is not hit]
        known = list(truth.effects)[number] if number < len(truth.effects) else ""
        label = named(known) if known else f"{truth.foreign} (any of {', '.join(map(named, right))})"
        true = _lines(true_sizes_cell(diagnosis, known, sizes[known])) if known else NONE
        rows.append((label, true, *_diagnosed(diagnosis, hit)))
    if truth.outside:
        rows.append((f"{truth.foreign} (not in the library)", NONE, diagnosis.verdict.replace("_", " "), NONE, NONE))
    return rows + [(NONE, NONE, *_diagnosed(diagnosis, effect)) for effect in unmatched]


def _diagnosed(diagnosis: Diagnosis, effect: NamedEffect | None) -> tuple[str, str, str]:
    if effect is None:
        return NONE, NONE, NONE
    twins = [name for name in effect.members if name != effect.name]
    words = " or ".join(map(named, [effect.name, *twins]))
    return words, _lines(sizes_cell(diagnosis, effect)), percent(effect.probability)


def _lines(sizes: str) -> str:
    return sizes.replace("; ", "\n")

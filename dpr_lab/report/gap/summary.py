"""The one-look summary of a diagnosis: gap budget and causes."""

from itertools import pairwise

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.digits import three
from dpr_lab.report.gap.tables import PROBABLE, causes, steps
from dpr_lab.report.pages.page import ShareBar
from dpr_lab.report.words import named
from dpr_lab.shown import listed

BASIS = {
    "one release": "cross-validation between the quarters of one run",
    "releases left out": "leave-one-run-out cross-validation",
    "held-out runs": "held-out runs",
}
"""`Diagnosis.basis` -> the data on which the gap reduction is measured, in words."""


def budget_bar(diagnosis: Diagnosis) -> ShareBar | None:
    """The gap of the bare model, split into the part that each effect removes and the remainder.

    Parts are differences of rms values (rad) as effects are added one at a time. A probable cause has a part of its
    own; the terms of improbable causes share one. None where there is no gap to split.
    """
    if diagnosis.evidence is not None and diagnosis.evidence.closing:
        gaps = [(step.effect or "", step.left_rad) for step in diagnosis.evidence.closing]
        basis = BASIS[diagnosis.basis]
    else:
        effects = ["", *(str(step["effect"]) for step in diagnosis.gap.waterfall)]
        gaps = list(zip(effects, (gap for _, gap in steps(diagnosis)), strict=True))
        basis = "fitted recordings"
    before, remainder = gaps[0][1], gaps[-1][1]
    if before <= 0 or diagnosis.verdict in ("no_gap", "inconclusive"):
        return None
    labels = {effect.name: words for words, effect in causes(diagnosis).items()}
    removed: dict[str, float] = {}
    for (_, gap), (effect, gap_with_effect) in pairwise(gaps):
        label = labels.get(effect, "terms without a probable cause")
        removed[label] = removed.get(label, 0.0) + gap - gap_with_effect
    parts = [*removed.items(), ("remainder", remainder)]
    total = sum(max(part, 0.0) for _, part in parts)  # an effect may enlarge the gap on held-out data
    return ShareBar(
        f"Gap budget: {three(1e3 * before)} mrad rms above the noise ({basis})",
        [(f"{label}: {three(1e3 * part)} mrad ({part / before:.1%})", max(part, 0.0) / total) for label, part in parts],
    )


def summary_note(diagnosis: Diagnosis) -> str:
    """Name the effects of the corrected model that are improbable as causes; empty if there are none."""
    improbable = [named(effect.name) for effect in diagnosis.effects if effect.probability < PROBABLE]
    return (
        f"The corrected model also contains {listed(improbable)}, which improve the fit but are improbable as causes"
        f" (probability below {PROBABLE:.0%})."
        if improbable
        else ""
    )

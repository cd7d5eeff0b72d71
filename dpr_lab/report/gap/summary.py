"""Summarise a diagnosis: gap budget, reproducible part of the gap, and improbable effects."""

from itertools import pairwise

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.gap_budget import VaryingParameter
from dpr_lab.gap.screen.pieces import are_pieces
from dpr_lab.report.angles import RADIANS
from dpr_lab.report.digits import three
from dpr_lab.report.gap.tables import causes, steps
from dpr_lab.report.pages.page import ShareBar
from dpr_lab.report.words import named, parameter_words, size_words
from dpr_lab.shown import listed, percent

BASIS = {
    "one release": "cross-validation between the quarters of one run",
    "releases left out": "leave-one-run-out cross-validation",
}
"""Words for the data on which the gap reduction is measured, without held-out data."""


def basis_words(diagnosis: Diagnosis) -> str:
    """Describe the data on which the gap reduction is measured."""
    return BASIS.get(diagnosis.basis) or held_out_words(diagnosis)


def held_out_words(diagnosis: Diagnosis) -> str:
    """Describe the held-out data: whole runs, or pieces of a single recording."""
    pieces = are_pieces(diagnosis.gap.closed_held_out.held_out)
    return "held-out pieces of the recording" if pieces else "held-out runs"


def budget_bar(diagnosis: Diagnosis) -> ShareBar | None:
    """Divide the gap of the bare model into reductions by effects and the remainder.

    The effects are added one after another. The part of an effect is the difference of the gap, rad, before and after
    the effect is added. Each probable effect has a part of its own. All other effects share one part. The result is
    None if there is no gap.
    """
    if diagnosis.evidence is not None and diagnosis.evidence.closing:
        gaps = [(step.effect or "", step.left_rad) for step in diagnosis.evidence.closing]
        basis = basis_words(diagnosis)
    else:
        effects = ["", *(str(step["effect"]) for step in diagnosis.gap.waterfall)]
        gaps = list(zip(effects, (gap for _, gap in steps(diagnosis)), strict=True))
        basis = "fitted recordings"
    before, remainder = gaps[0][1], gaps[-1][1]
    if before <= 0 or not diagnosis.has_gap:
        return None
    labels = {effect.name: words for words, effect in causes(diagnosis).items()}
    removed: dict[str, float] = {}
    for (_, gap), (effect, gap_with_effect) in pairwise(gaps):
        label = labels.get(effect, "terms without a probable cause")
        removed[label] = removed.get(label, 0.0) + gap - gap_with_effect
    parts = [*removed.items(), ("remainder", remainder)]
    total = sum(max(part, 0.0) for _, part in parts)  # an effect may increase the gap on held-out data
    shares = [
        (f"{label}: {three(1e3 * part)} mrad ({percent(part / before, 1)})", max(part, 0.0) / total)
        for label, part in parts
    ]
    if diagnosis.verdict == "named":
        label, share = shares[-1]
        square = percent((remainder / before) ** 2, 1)
        shares[-1] = (f"{label}, {square} of the mean square: only noise remains in the fit", share)
    return ShareBar(f"Gap budget: {three(1e3 * before)} mrad rms above the noise ({basis})", shares)


def repeatability_parts(diagnosis: Diagnosis) -> list[tuple[str, float]]:
    """Return label and share of each part of the mean squared residual; empty without a gap."""
    budget = diagnosis.gap.budget
    if budget is None or budget.of_gap is None:
        return []
    parts = {
        "explained by the corrected model": budget.explained,
        f"parameters that vary between {_repeated(diagnosis)}": budget.varying,
        "reproducible, not in the model": budget.unmodelled,
        "not reproducible": budget.not_reproducible,
        "noise": budget.noise,
    }
    return list(parts.items())


def repeatability_bar(diagnosis: Diagnosis) -> ShareBar | None:
    """Return a bar of the mean squared residual by reproducibility, or None without a gap."""
    parts = [(f"{label}: {percent(share, 1)}", share) for label, share in repeatability_parts(diagnosis)]
    title = f"Repeatability: mean squared residual of the bare model on held-out {_repeated(diagnosis)}"
    return ShareBar(title, parts) if parts else None


def _repeated(diagnosis: Diagnosis) -> str:
    """Return the name of the compared recordings: "recordings", or "pieces" of a single recording."""
    budget = diagnosis.gap.budget
    single = budget is not None and budget.basis != "recordings"
    return "pieces" if single or are_pieces(diagnosis.gap.closed_held_out.held_out) else "recordings"


def repeatability_sentences(diagnosis: Diagnosis) -> list[str]:
    """Describe the explained share of the gap, and the varying parameters; empty without a gap."""
    budget = diagnosis.gap.budget
    if budget is None or budget.of_gap is None:
        return []
    between = _repeated(diagnosis)
    model = "the corrected model"
    if diagnosis.verdict == "unexplained" and diagnosis.model_effects:
        model += ", whose effects are not confirmed as causes,"
    explains = f"Fitted to the other {between}, {model} explains {percent(budget.of_gap)} of the mean squared gap"
    if budget.of_reproducible is None:
        reason = budget.undecided or "No part of the gap is known to be reproducible."
        sentences = [f"{explains}. {reason}"]
    else:
        sentences = [f"{explains}, and {percent(budget.of_reproducible)} of its reproducible part."]
    if diagnosis.verdict == "named" and percent(budget.of_gap) != percent(1.0):
        sentences.append(f"A fit to all {between} leaves only noise.")
    if budget.basis == "pieces of one recording":
        sentences.append("Pieces of a single recording cannot show differences between releases.")
    return [*sentences, *(f"Between {between} {_varying(parameter)}." for parameter in budget.parameters)]


def _varying(parameter: VaryingParameter) -> str:
    """Describe a varying parameter: extreme values with 90 % intervals, scatter, and standard deviation."""

    def size(*values: float) -> str:
        return size_words(parameter.effect, parameter.name, RADIANS, *values)

    # a ratio belongs to no effect; its name is its description
    size_name = parameter_words(parameter.effect, parameter.name)
    words = f"{size_name} of {named(parameter.effect)}" if parameter.effect else size_name
    ends = sorted((value, name) for name, value in parameter.values.items())
    reach = NORMAL_Q90 * parameter.std
    smallest, largest = (f"{size(v, v - reach, v + reach)} in {name}" for v, name in (ends[0], ends[-1]))
    return (
        f"{words} varies from {smallest} to {largest}. Its scatter is {parameter.sigmas:.2g} times that of noise alone;"
        f" the standard deviation of the true value is {size(parameter.spread)}"
    )


def summary_note(diagnosis: Diagnosis) -> str:
    """Name the effects of the corrected model that are improbable as causes; empty without such effects."""
    improbable = [named(effect.name) for effect in diagnosis.effects if effect.probability < PROBABLE]
    return (
        f"The corrected model also contains {listed(improbable)}, with a probability below {percent(PROBABLE)}: this"
        " improves the fit but does not show a cause."
        if improbable
        else ""
    )

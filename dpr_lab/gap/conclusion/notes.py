"""Notes below the verdict: limitations of the named effects, components, and the remainder."""

from collections.abc import Collection, Iterator, Sequence

from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.families import FAMILIES
from dpr_lab.gap.conclusion.verdict import VERDICT, causes_named, listed_causes, small_causes, small_effects
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.result.causes import NamedFamily
from dpr_lab.gap.result.diagnosis import Verdict
from dpr_lab.gap.screen.pieces import are_pieces, whole
from dpr_lab.gap.state import Transferred
from dpr_lab.gap.transfer.lone_recording import LONE
from dpr_lab.run import truncation
from dpr_lab.shown import listed, percent


def notes(state: Transferred, kind: Verdict, named_families: Sequence[NamedFamily]) -> list[str]:
    """Return the notes of a verdict, in sentences.

    If another interpretation of the recordings is at least as good, only truncated recordings are noted.
    """
    records = [*state.fitted.recordings.records, *state.fitted.held_out.records]
    names = [whole(record.run.name) for record in records if not record.run.complete]
    cut = [f"{warning[:1].upper()}{warning[1:]}." for warning in truncation(names)]
    if state.description.withholds:
        return cut
    return [
        *cut,
        *_restrictions(state, kind),
        *_small_effects(state, kind),
        *component_notes(named_families, state.fitted.recordings.rig.joints.geared),
        *_varying_sizes(state),
        *_lone_recording(state),
        *_remainder(state, kind),
        *_undetermined_sizes(state, kind),
    ]


def _restrictions(state: Transferred, kind: Verdict) -> Iterator[str]:
    if kind != "partly_explained":
        return
    if withdrawn := state.transfer.withdrawn:
        yield f"Effects that do not carry over to held-out data: {listed(withdrawn)}."
    if oversized := state.transfer.oversized:
        yield (
            f"Effects with an implausible size: {listed(oversized)}. The true cause must be another"
            " effect with a similar signature."
        )


def _small_effects(state: Transferred, kind: Verdict) -> Iterator[str]:
    """Yield a sentence on the small effects that the verdict omits because they are improbable."""
    of_model = small_effects(state.selection.bare, state.selection.path)
    listable = [cause.name for cause in listed_causes(state.posteriors)]
    stated = (*causes_named(state), *small_causes(state))
    excluded = {*state.transfer.withdrawn, *(cause.name for cause in stated)}
    small = [name for name in listable if name in of_model and name not in excluded]
    if small and kind in ("named", "partly_explained"):
        least = percent(THRESHOLDS.small)
        yield f"Small effects, together less than {least} of the excess chi-square: {listed(small)}."


def component_notes(named_families: Sequence[NamedFamily], geared: Collection[int]) -> Iterator[str]:
    """Yield the sentences on components that explain several effects.

    If the rig file does not state the drive of a joint, its sentence is conditional.
    """
    joints = {family.name: family.joint for family in FAMILIES}
    for family in named_families:
        effects, share = listed(family.effects), percent(family.share)
        if joints[family.name] in geared:
            yield (
                f"{effects} are the effects of a {family.words} [{family.name}]; together they explain {share} of the"
                " excess."
            )
        else:
            yield (
                f"{effects} may be the effects of a {family.words} [{family.name}]; together they explain {share} of"
                " the excess. If the rig has this drive, state it in the rig file ([joints] geared)."
            )


def _varying_sizes(state: Transferred) -> Iterator[str]:
    """Yield sentences on withdrawn effects whose sizes differ between the recordings."""
    budget = state.gap.budget
    if budget is None or budget.basis != "recordings":
        return
    for parameter in budget.parameters:
        if parameter.effect in state.transfer.withdrawn:
            size = next(p for p in EFFECTS[parameter.effect].parameters if p.name == parameter.name)
            values = [f"{value:.3g} {size.unit} in {run}" for run, value in parameter.values.items()]
            yield f"The recordings differ in the size of {parameter.effect} ({size.words} {listed(values)})."


def _lone_recording(state: Transferred) -> Iterator[str]:
    """Yield a sentence on the only recording that the model does not explain, with the next step."""
    if (lone := state.transfer.lone) is None:
        return
    piece = are_pieces([lone.name])
    others = "only noise" if lone.others < LONE.least else f"a remainder of at most {lone.others:.2g} times the noise"
    yield (
        f"The model leaves a remainder of {lone.remainder:.2g} times the noise in {lone.name}. If {lone.name} is not"
        f" fitted, the model leaves {others} in each other {'piece' if piece else 'recording'}. Either a cause acted"
        f" only in {lone.name}, or {lone.name} contains a motion that the others do not contain."
        f"{'' if piece else ' Diagnose the others without it.'}"
    )


def _remainder(state: Transferred, kind: Verdict) -> Iterator[str]:
    """Yield a sentence on the size and location of the remainder, or on a rig that was probably changed."""
    if kind not in ("partly_explained", "unexplained"):
        return
    if changed := state.gap.budget and state.gap.budget.changed_ratio:
        values = listed([f"{value:.3g} in {run}" for run, value in changed.values.items()])
        yield (
            f"The recordings differ in {changed.name} ({values}). If the rig was changed between these recordings,"
            " diagnose them separately."
        )
    elif state.remainder:
        yield state.remainder.sentence


def _undetermined_sizes(state: Transferred, kind: Verdict) -> Iterator[str]:
    """Yield a sentence on probable causes whose intervals contain zero because of the remainder."""
    if kind not in ("named", "partly_explained") or state.remainder is None:
        return
    values = named_params(state.selection.chosen.estimate.params)
    names = [
        cause.name
        for cause in causes_named(state)
        if cause.probability >= VERDICT.rather
        if all(
            abs(values.get(cause.name, {}).get(p.name, 0.0)) <= state.intervals.get((cause.name, p.name), 0.0)
            for p in EFFECTS[cause.name].amplitudes
        )
    ]
    if names:
        yield (
            f"The 90 % interval of the size of {listed(names)} contains zero, because the unknown cause of the"
            " remainder may change this size. The probability does not include this uncertainty."
        )

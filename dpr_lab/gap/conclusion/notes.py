"""Notes below the verdict: restrictions of the named effects, components that they form, and the remainder."""

from collections.abc import Iterator, Sequence

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.backlash import BACKLASH_JOINT0
from dpr_lab.effects.friction_curve import FRICTION_CURVE_JOINT0
from dpr_lab.effects.hysteresis import HYSTERESIS_JOINT0
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.gap.conclusion.verdict import Verdict
from dpr_lab.gap.result.causes import NamedFamily
from dpr_lab.gap.state import Advised
from dpr_lab.shown import listed, parameter_words, percent


def notes(state: Advised, kind: Verdict, named_families: Sequence[NamedFamily]) -> list[str]:
    """All notes, one sentence each; a wrong description of the recordings leaves none."""
    if state.description.withholds:
        return []
    return [
        *_restrictions(state, kind),
        *_families(named_families),
        *motor_in_backlash(state.selection.chosen.effects),
        *_varying_sizes(state),
        *_remainder(state, kind),
    ]


def _restrictions(state: Advised, kind: Verdict) -> Iterator[str]:
    if kind != "partly_explained":
        return
    if withdrawn := state.transfer.withdrawn:
        yield f"Effects that do not carry over to held-out data: {listed(withdrawn)}."
    if oversized := state.transfer.oversized:
        yield f"Effects of a size that no rig has; another cause must have a similar signature: {listed(oversized)}."


def _families(named_families: Sequence[NamedFamily]) -> Iterator[str]:
    for family in named_families:
        yield (
            f"Together {listed(family.effects)} are the effects of a {family.words} [{family.name}]:"
            f" {percent(family.share)} of the excess."
        )


def motor_in_backlash(effects: Sequence[str]) -> Iterator[str]:
    """Notes on effects that the inertia of the motor may cause, if a backlash of the arm's gear is named with them.

    The model of this backlash neglects that inertia. A real motor takes some time to cross it, which resembles a delay,
    and moves by itself within it, which on a free arm resembles a friction that depends on the angle or on the speed.
    """
    if BACKLASH_JOINT0.name not in effects:
        return
    if INPUT_DELAY.name in effects:
        yield (
            "The input delay may be the time that the motor needs to cross the backlash of its gear, because the"
            " model of the backlash neglects the inertia of the motor; these recordings cannot separate them. Record"
            " with torques of one sign, which keep the gear in contact: only a delay of the input remains visible."
        )
    if frictions := [name for name in effects if name in (HYSTERESIS_JOINT0.name, FRICTION_CURVE_JOINT0.name)]:
        yield (
            f"{listed(frictions)} may be the motion of the motor within the backlash of its gear, because the model of"
            " the backlash neglects the inertia and the friction of the motor; these recordings cannot separate them."
            " Record with the gear pressed to one side, for example by a constant torque: only a friction remains"
            " visible."
        )


def _varying_sizes(state: Advised) -> Iterator[str]:
    """Effects that do not carry over because each recording has its own size."""
    budget = state.gap.budget
    if budget is None or budget.basis != "recordings":
        return
    for parameter in budget.parameters:
        if parameter.effect in state.transfer.withdrawn:
            unit = next(p.unit for p in EFFECTS[parameter.effect].parameters if p.name == parameter.name)
            values = [f"{value:.3g} {unit} in {run}" for run, value in parameter.values.items()]
            size = parameter_words(parameter.name)
            yield f"The recordings differ in the size of {parameter.effect} ({size} {listed(values)})."


def _remainder(state: Advised, kind: Verdict) -> Iterator[str]:
    """Size and location of the unmodelled remainder, or that the rig seems to have been changed."""
    if kind not in ("partly_explained", "unexplained"):
        return
    if changed := state.gap.budget and state.gap.budget.changed_ratio:
        values = listed([f"{value:.3g} in {run}" for run, value in changed.values.items()])
        yield (
            f"The recordings differ in {changed.name} ({values}): if the rig was changed between them, diagnose them"
            " separately."
        )
    elif state.remainder:
        yield state.remainder.sentence

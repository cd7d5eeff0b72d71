"""Remedies for the named effects at the rig, or in its file, readings or simulator."""

from collections.abc import Mapping, Sequence

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Params
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.gap.conclusion.verdict import VERDICT
from dpr_lab.gap.result.causes import NamedEffect
from dpr_lab.shown import listed


def remedies(named: Sequence[NamedEffect], sizes: Mapping[str, Params], rig: RigConstants) -> list[str]:
    """Return the remedies: one sentence per faulty part, and one for the simulator.

    An effect with a probability below one half has no remedy, for example if it worsens the free runs.

    Args:
        named: the effects, in order
        sizes: fitted parameters of each effect
        rig: values of the rig file
    """
    sentences: list[str] = []
    simulated: list[str] = []
    for effect in named:
        remedy = EFFECTS[effect.name].remedy
        if effect.probability < VERDICT.rather:
            continue
        if remedy is None:
            simulated.append(effect.name)
            continue
        others = [name for name in effect.members if name != effect.name]
        unless = f" (first rule out {' and '.join(others)}: indistinguishable in these recordings)" if others else ""
        sentences.append(
            f"For {effect.name}: {remedy(sizes[effect.name], rig, EFFECTS[effect.name].joints[0])}{unless}."
        )
    if simulated:
        sentences.append(
            f"Add {listed(simulated)} to the simulator: model.json in the folder of this diagnosis, and the"
            " models for other programs, contain the fitted sizes."
        )
    return sentences

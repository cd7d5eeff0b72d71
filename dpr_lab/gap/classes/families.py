"""Families: named effects that together form one component, such as a geared drive, with their share of the gap."""

from functools import reduce

import numpy as np

from dpr_lab.effects.families import FAMILIES
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refit_without
from dpr_lab.gap.result.causes import NamedEffect, NamedFamily
from dpr_lab.gap.which.selected import Selection


def families(problem: Problem, selection: Selection, named: list[NamedEffect]) -> list[NamedFamily]:
    """Families to which the named effects belong.

    The probability of a family is the largest probability of its characteristic effects. Friction alone is not evidence
    of a drive, because it may come from a bearing.
    """
    probable = {effect.name: effect.probability for effect in named}
    return [
        NamedFamily(
            name=family.name,
            words=family.words,
            effects=list(parts),
            probability=max(probable[name] for name in parts if name in family.marks),
            share=_share(problem, selection, parts),
        )
        for family in FAMILIES
        if (parts := family.among(tuple(probable)))
    ]


def _share(problem: Problem, selection: Selection, parts: tuple[str, ...]) -> float:
    """Share of the excess chi2 that returns if all effects of a family are removed, 0 to 1."""

    def without(model: Hypothesis, name: str) -> Hypothesis:
        return refit_without(problem, model, name, selection.bare)

    chosen, total = selection.chosen, selection.bare.residuals.excess
    returned = reduce(without, parts, chosen).residuals.excess - max(chosen.residuals.excess, 0.0)
    return float(np.clip(returned / total, 0.0, 1.0)) if total > 0 else 0.0

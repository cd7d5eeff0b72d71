"""The posterior as a mixture: each fitted set of effects with its probability and the covariance of its values.

The probability of a set follows from its predictive cost, as for a class (`dpr_lab.gap.classes.posterior`). Sets with a
very small probability are omitted.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import named_params
from dpr_lab.fitting.estimate import FreeParameter
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.classes.posterior import CALIBRATION
from dpr_lab.gap.conclusion.scatter import between_recordings
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS, follows_remainder
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class MixtureSettings:
    """Limits for the stored sets."""

    least: float = 0.01
    """Probability below which a set is omitted."""
    most: int = 8
    """Maximum number of sets."""


MIXTURE = MixtureSettings()


def components(
    problem: Problem, selection: Selection, rig: Rig, remainder: Discrepancy | None
) -> list[PosteriorComponent]:
    """Sets of effects with their probabilities, the most probable first.

    Args:
        problem: segments and noise
        selection: all fitted sets
        rig: measured constants
        remainder: discrepancy term of the selected set
    """
    kept = list(_likeliest(selection))
    whole = sum(weight for _, weight in kept)
    made = [_component(problem, at, rig, remainder, weight / whole) for at, weight in kept]
    return [component for component in made if component is not None]


def _likeliest(selection: Selection) -> Iterator[tuple[Hypothesis, float]]:
    """The selected set and other sets that may be true, the most probable first, with their weights."""
    chosen = selection.chosen
    others = {at.key: at for at in selection.fitted.values() if at is not chosen and _may_be_true(selection, at)}
    models = {**others, chosen.key: chosen}
    span = 2 * chosen.residuals.inflation * CALIBRATION.temperature
    logs = {key: -_worse(at, chosen) / span for key, at in models.items()}
    most = max(logs.values())
    weights = {key: float(np.exp(log - most)) for key, log in logs.items()}
    ranked = sorted(models, key=lambda key: (-weights[key], key != chosen.key))
    kept = [key for key in ranked if weights[key] >= MIXTURE.least * sum(weights.values())][: MIXTURE.most]
    for key in kept if chosen.key in kept else [*kept[: MIXTURE.most - 1], chosen.key]:
        yield models[key], weights[key]


def _may_be_true(selection: Selection, at: Hypothesis) -> bool:
    """Whether nothing but its cost speaks against a set: possible sizes, no effect that held-out runs refute."""
    refuted = set(selection.misleading) & at.key or at.key in selection.impossible
    return bool(np.isfinite(at.cost)) and not refuted and not follows_remainder(selection.base, at, selection.chosen)


def _worse(at: Hypothesis, chosen: Hypothesis) -> float:
    """Cost of a set above that of the selected one, with the remainder of either as noise for both.

    Each effect beyond the number of the selected set was the best of hundreds, so it must explain more than chance.
    """
    inflation = max(at.residuals.inflation, chosen.residuals.inflation)
    further = max(len(at.effects) - len(chosen.effects), 0)
    return at.cost_at(inflation) - chosen.cost_at(inflation) + further * THRESHOLDS.chance * inflation


def _component(
    problem: Problem, at: Hypothesis, rig: Rig, remainder: Discrepancy | None, probability: float
) -> PosteriorComponent | None:
    own = [i for i, parameter in enumerate(at.fit.free) if _name(parameter)]
    spread = covariance(problem, at, rig, remainder)[np.ix_(own, own)]
    if not np.isfinite(spread).all():
        return None
    return PosteriorComponent(
        probability=probability,
        ratios=dict(zip(RATIOS, at.fit.estimate.ratios.tolist(), strict=False)),
        effects=named_params(at.fit.estimate.params),
        free=[_name(at.fit.free[i]) for i in own],
        covariance=spread.tolist(),
        between=between_recordings(problem, at.fit)[np.ix_(own, own)].tolist(),
    )


def _name(parameter: FreeParameter) -> str:
    """`a/b` or `coulomb_joint2.torque_Nm`; empty for a parameter that a simulation does not need."""
    if parameter.block == "effects":
        return f"{parameter.effect}.{parameter.name}"
    return parameter.name if parameter.name in RATIOS else ""

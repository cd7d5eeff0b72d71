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
    chosen = selection.chosen
    others = {at.key: at for at in selection.fitted.values() if np.isfinite(at.cost)} | {chosen.key: chosen}
    span = 2 * chosen.residuals.inflation * CALIBRATION.temperature
    weights = {key: float(np.exp(min((chosen.cost - at.cost) / span, 0.0))) for key, at in others.items()}
    ranked = sorted(others, key=lambda key: (key != chosen.key, -weights[key]))
    whole = sum(weights.values())
    for key in ranked[: MIXTURE.most]:
        if key == chosen.key or weights[key] >= MIXTURE.least * whole:
            yield others[key], weights[key]


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

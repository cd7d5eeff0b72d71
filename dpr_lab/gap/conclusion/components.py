"""Posterior mixture: the probable sets of effects, each with its probability and covariance.

The probability of a set follows from its predictive cost, as for a class (`dpr_lab.gap.classes.posterior`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import named_params
from dpr_lab.fitting.estimate import SCALE, UNKNOWN_RATIOS, FreeParameter
from dpr_lab.gap.classes.posterior import prior_odds
from dpr_lab.gap.conclusion.scatter import between_recordings, left_out_values
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.state import Transferred
from dpr_lab.gap.which.selected import Selection


@dataclass(frozen=True, slots=True)
class MixtureSettings:
    """Limits of the sets that the mixture contains."""

    least: float = 0.01
    """Minimum probability of a set that belongs to the mixture."""
    most: int = 8
    """Maximum number of sets in the mixture."""


MIXTURE = MixtureSettings()

SCALED = UNKNOWN_RATIOS[: SCALE + 1]
"""Names of the ratios and of the scale b; the recordings determine some of them."""


def components(state: Transferred) -> list[PosteriorComponent]:
    """Return the sets of the mixture with their probabilities, the most probable first.

    A set whose covariance is not finite is left out.
    """
    models = list(_likeliest(state.selection))
    total = sum(weight for _, weight in models)
    candidates = (_component(state, model, weight / total) for model, weight in models)
    return [component for component in candidates if component is not None]


def _likeliest(selection: Selection) -> Iterator[tuple[Hypothesis, float]]:
    """Yield the selected set and the other possible sets with their weights, largest weight first."""
    chosen = selection.chosen
    others = {
        model.key: model
        for model in selection.fitted.values()
        if model is not chosen and _may_be_true(selection, model)
    }
    models = {**others, chosen.key: chosen}
    unit = CALIBRATION.unit(chosen.inflation)
    evidence = {key: min(-_worse(model, chosen) / unit, CALIBRATION.negligible) for key, model in models.items()}
    weights = {key: min(1.0, prior_odds(selection, models[key]) * math.exp(log)) for key, log in evidence.items()}
    ranked = sorted(models, key=lambda key: (-weights[key], key != chosen.key))
    most_likely = [key for key in ranked if weights[key] >= MIXTURE.least * sum(weights.values())][: MIXTURE.most]
    for key in most_likely:
        yield models[key], weights[key]


def _may_be_true(selection: Selection, model: Hypothesis) -> bool:
    """Return whether a set can contain the true causes.

    Its cost must be finite and its sizes possible, and held-out runs must not refute any of its effects.
    """
    refuted = set(selection.misleading) & model.key or model.key in selection.impossible
    return bool(np.isfinite(model.cost) and not refuted)


def _worse(model: Hypothesis, chosen: Hypothesis) -> float:
    """Return the cost of a set minus that of the selected set.

    Both costs are computed with the same noise: the noise of the readings plus the remainder of the selected set. A
    larger remainder of the other set therefore increases its cost. If the other set is larger, two rules apply. The
    search rejected it even if it fits better, so its cost counts as at least that of the selected set. Each further
    effect was selected among hundreds, so it must explain more than the best of them would explain by chance.
    """
    inflation, further = chosen.inflation, len(model.effects) - len(chosen.effects)
    difference = model.cost_at(inflation) - chosen.cost_at(inflation)
    if further:  # prior odds apply to sets of equal size, of which only they may reject the one that fits better
        difference = max(difference, 0.0)
    return difference + max(further, 0) * THRESHOLDS.chance * inflation


def _component(state: Transferred, model: Hypothesis, probability: float) -> PosteriorComponent | None:
    problem, places = state.fitted.problem, [i for i, parameter in enumerate(model.fit.free) if _name(parameter)]
    spread = covariance(problem, model, state.fitted.recordings.rig, state.remainder)[np.ix_(places, places)]
    if not np.isfinite(spread).all():
        return None
    free = [_name(model.fit.free[i]) for i in places]
    ratios = dict(zip(SCALED, model.estimate.ratios.tolist(), strict=False))
    return PosteriorComponent(
        probability=probability,
        ratios={name: value for name, value in ratios.items() if name in RATIOS or name in free},
        effects=named_params(model.estimate.params),
        free=free,
        covariance=spread.tolist(),
        between=between_recordings(problem, model.fit)[np.ix_(places, places)].tolist(),
        left_out=left_out_values(problem, model.fit)[:, places].tolist(),
    )


def _name(parameter: FreeParameter) -> str:
    """Return the name of a parameter, such as `a/b` or `coulomb_joint2.torque_Nm`.

    The name is empty for other values: p/b, and encoder zeros of single recordings.
    """
    if parameter.block == "effects":
        return f"{parameter.effect}.{parameter.name}"
    return parameter.name if parameter.name in SCALED else ""

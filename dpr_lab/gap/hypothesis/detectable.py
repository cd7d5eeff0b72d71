"""Minimum detectable size of each effect in these recordings."""

from collections.abc import Mapping

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.projection import TINY
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest

SIGMAS = 5.0
"""Standard deviations from which an effect is detectable: beyond chance among some 600 shapes."""

SEEN = 1e-6
"""Fraction of a column's squared length that must remain after projection for its amplitude to be detectable."""


def detectable(model: Hypothesis, test: ScoreTest) -> Mapping[str, Mapping[str, float | None]]:
    """Minimum detectable amplitude of each effect, given the fitted model: five standard deviations.

        size = 5 sqrt(f) / | s |,

    where s is the change of the whitened readings per unit, with initial states and fitted parameters projected out,
    and f is the variance inflation n / n_eff. None if the readings do not change at all.

    Args:
        model: the fitted model
        test: its score test
    """
    spread = SIGMAS * model.residuals.inflation**0.5
    least: dict[str, dict[str, float | None]] = {}
    for score in test.ranking:
        remaining_shares = np.diag(test.projected(score.columns).H)
        scales = test.space.scale[list(score.columns)]
        sizes = {
            test.free[column].name: _size(spread, scale, remaining)
            for column, scale, remaining in zip(score.columns, scales, remaining_shares, strict=True)
        }
        least[score.effect.name] = {
            p.name: None if p.name in score.absorbed else sizes[p.name] for p in score.effect.amplitudes
        }
    fitted = test.space.chosen(list(test.fitted_columns))
    remaining_shares = fitted.scale**2 / np.diag(fitted.covariance())
    for name in model.effects:
        parameters = zip(model.fit.free, fitted.scale, remaining_shares, strict=True)
        least[name] = {
            p.name: _size(spread, s, remaining) for p, s, remaining in parameters if p.effect == name and p.amplitude
        }
    return {name: least[name] for name in EFFECTS if name in least}


def _size(spread: float, scale: float, remaining: float) -> float | None:
    """Detectable amplitude of a column of norm 1 / scale, with the remaining fraction of its squared length."""
    return float(spread * scale / remaining**0.5) if remaining > SEEN and scale < 1 / TINY else None


def visible(least: Mapping[str, Mapping[str, float | None]]) -> tuple[int, int]:
    """Count the effects that are detectable at their typical size, and those that are detectable at any size.

    An effect that is undetectable at any size does not act in these recordings or is absorbed by the ratios.

    Args:
        least: result of `detectable`
    """
    acting = {name: sizes for name, sizes in least.items() if any(size is not None for size in sizes.values())}
    shown = [
        any(size is not None and size <= p.typical for p in EFFECTS[name].amplitudes if (size := sizes.get(p.name)))
        for name, sizes in (acting or least).items()
    ]
    return sum(shown), len(shown)

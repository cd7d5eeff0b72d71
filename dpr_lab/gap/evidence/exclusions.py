"""Excluded effects: the minimum detectable size of an effect, and the confidence that the effect is smaller.

A score test with all named effects in the model gives for each amplitude a linear estimate a with standard deviation s.
The minimum detectable size is 5 s, so the effect is smaller with the confidence

    P(|x| < 5 s) = Phi(5 - |a| / s)

In this test the other amplitudes of the effect are zero. A limit of one amplitude, for example of the stiffness of a
cable, must hold for any others. Its interval is therefore that of the fit of all amplitudes of the effect together.
"""

from collections.abc import Mapping
from statistics import NormalDist

import numpy as np

from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.hypothesis.detectable import SEEN, SIGMAS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.result.evidence import Exclusion


def exclusions(model: Hypothesis, test: ScoreTest, least: Mapping[str, Mapping[str, float | None]]) -> list[Exclusion]:
    """Every amplitude of every effect that is not named and is detectable.

    Args:
        model: the fitted model
        test: its score test
        least: minimum detectable sizes, see `detectable`
    """
    excluded = []
    for score in test.ranking:
        name = score.effect.name
        given = test.projected(score.columns)
        joint = None if score.effect.shapes and len(score.columns) > 1 else _joint(given, model.residuals.inflation)
        for i, column in enumerate(score.columns):
            parameter = test.free[column]
            size = least.get(name, {}).get(parameter.name)
            if name in model.effects or not size:
                continue
            estimate = float(given.gradient[i] / given.H[i, i] * given.scale[i])
            sigma = size / SIGMAS
            excluded.append(
                Exclusion(
                    effect=name,
                    parameter=parameter.name,
                    size=size,
                    estimate=estimate,
                    confidence=float(NormalDist().cdf(SIGMAS - abs(estimate) / sigma)),
                    interval90=None if joint is None else joint[i],
                )
            )
    return excluded


def _joint(given: ColumnSpace, inflation: float) -> list[tuple[float, float]] | None:
    """90 % interval of each amplitude, fitted with the others of its effect; None if they cannot be separated.

    Args:
        given: columns of the amplitudes, with the model projected out
        inflation: variance inflation n / n_eff
    """
    if np.linalg.eigvalsh(given.H)[0] < SEEN:
        return None
    reach = NORMAL_Q90 * np.sqrt(inflation * np.diag(given.covariance()))
    return [(float(x - r), float(x + r)) for x, r in zip(given.solution(), reach, strict=True)]

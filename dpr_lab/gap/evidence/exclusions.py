"""Excluded effects: the minimum detectable size of an effect, and the confidence that the effect is smaller.

A score test with all named effects in the model gives for each amplitude a linear estimate a with standard deviation s.
The minimum detectable size is 5 s, so the effect is smaller with the confidence

    P(|x| < 5 s) = Phi(5 - |a| / s)
"""

from collections.abc import Mapping
from statistics import NormalDist

from dpr_lab.gap.hypothesis.detectable import SIGMAS
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
                )
            )
    return excluded

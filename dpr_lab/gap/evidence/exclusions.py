"""Excluded effects: the minimum detectable size of an effect, and the confidence that the effect is smaller.

A score test with all named effects in the model gives for each amplitude a linear estimate a with standard deviation s.
The minimum detectable size is 5 s, so the effect is smaller with the confidence

    P(|x| < 5 s) = Phi(5 - |a| / s)

In this test the other amplitudes of the effect are zero. A limit of one amplitude, for example of the stiffness of a
cable, must hold for any values of the other amplitudes. Its interval is therefore that of the fit of all amplitudes of
the effect together, and over all shapes of an effect such as cogging (`dpr_lab.gap.evidence.every_shape`).
"""

from collections.abc import Mapping
from statistics import NormalDist

from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.evidence.every_shape import intervals_of_all_shapes, joint_intervals
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.result.evidence import Exclusion


def exclusions(
    problem: Problem, model: Hypothesis, test: ScoreTest, least: Mapping[str, Mapping[str, float | None]]
) -> list[Exclusion]:
    """Every amplitude of every effect that is not named and is detectable.

    Args:
        problem: the segments
        model: the fitted model
        test: its score test
        least: minimum detectable sizes, see `detectable`
    """
    excluded = []
    for score in test.ranking:
        name = score.effect.name
        sizes = least.get(name, {})
        if name in model.effects or not any(sizes.values()):
            continue
        given = test.projected(score.columns)
        joint = _intervals(problem, model, score, given)
        for i, column in enumerate(score.columns):
            parameter = test.free[column]
            size = sizes.get(parameter.name)
            if not size:
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
                    interval90=joint.get(parameter.name),
                )
            )
    return excluded


def _intervals(problem: Problem, model: Hypothesis, score: Score, given: ColumnSpace) -> dict[str, tuple[float, float]]:
    """90 % interval of each amplitude; empty if the recordings do not separate them.

    If the shapes of an effect come from the recordings, such as an instant, the interval is that of its best shape.
    """
    names = [p.name for p in score.effect.amplitudes if p.name not in score.absorbed]
    every = intervals_of_all_shapes(score.effect, problem, model) if score.effect.shapes else None
    if every is not None:
        return dict(zip((p.name for p in score.effect.amplitudes), every, strict=True))
    if score.effect.shapes and len(score.columns) > 1:
        return {}
    return dict(zip(names, joint_intervals(given, model.residuals.inflation) or (), strict=False))

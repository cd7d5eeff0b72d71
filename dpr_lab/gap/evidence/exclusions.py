"""Excluded effects: minimum detectable sizes, and the confidence that effects are smaller.

A score test with all named effects in the model gives a linear estimate of each amplitude, and the confidence that the
effect is smaller than its minimum detectable size (`dpr_lab.gap.hypothesis.detectable.linear_exclusions`).

In this test the other amplitudes of the effect are zero. A limit of one amplitude, for example of the stiffness of a
cable, must hold for any values of the other amplitudes. The interval of an amplitude is therefore computed with all
amplitudes of the effect fitted together, and over all shapes of an effect such as cogging
(`dpr_lab.gap.evidence.every_shape`).
"""

from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.evidence.every_shape import AllShapes, joint_intervals
from dpr_lab.gap.hypothesis.detectable import DetectableSizes, linear_exclusions
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.result.evidence import Exclusion


def exclusions(problem: Problem, model: Hypothesis, test: ScoreTest, least: DetectableSizes) -> list[Exclusion]:
    """Return the exclusions of all detectable amplitudes of the effects that are not named.

    Args:
        problem: the segments
        model: the fitted model
        test: score test of the model
        least: minimum detectable sizes, see `detectable`
    """
    excluded, all_shapes = list[Exclusion](), AllShapes(problem, model)
    for score in test.ranking:
        name = score.effect.name
        sizes = least.get(name, {})
        if name in model.effects or not any(sizes.values()):
            continue
        joint = _intervals(all_shapes, score, test.projected(score.columns))
        excluded += [
            exclusion.model_copy(update={"interval90": joint.get(exclusion.parameter)})
            for exclusion in linear_exclusions(test, score, sizes)
        ]
    return excluded


def _intervals(all_shapes: AllShapes, score: Score, given: ColumnSpace) -> dict[str, tuple[float, float]]:
    """Return the 90 % interval of each amplitude.

    The result is empty if the recordings do not separate the amplitudes. If the shapes of an effect come from the
    recordings, such as an instant, the interval applies to its best shape.
    """
    names = [p.name for p in score.effect.amplitudes if p.name not in score.absorbed]
    every = all_shapes.intervals(score.effect) if score.effect.shapes else None
    if every is not None:
        return dict(zip((p.name for p in score.effect.amplitudes), every, strict=True))
    if score.effect.shapes and len(score.columns) > 1:
        return {}
    return dict(zip(names, joint_intervals(given, all_shapes.model.inflation) or (), strict=False))

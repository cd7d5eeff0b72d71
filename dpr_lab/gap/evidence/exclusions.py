"""Excluded effects: the confidence that an effect is smaller than its minimum detectable size, and intervals.

A score test with all named effects in the model gives a linear estimate of each amplitude, and the confidence that the
effect is smaller than its minimum detectable size (`dpr_lab.gap.hypothesis.detectable.linear_exclusions`). In this test
the other amplitudes of the effect are zero.

A limit of one amplitude, for example of the stiffness of a cable, must hold for any values of the other amplitudes and
for any shape of the effect, for example any order of cogging. The 90 % interval of an amplitude is therefore computed
with all amplitudes of the effect fitted together, and it covers the intervals in all shapes (an intersection-union
test). Suppose that the effect has one of the shapes, and an amplitude beyond the limit. The interval in this shape then
lies inside the limit with a probability of at most 5 %, however many other shapes are tested.

Frequencies are tested in steps of half the inverse of the recording length. To limit their number, a frequency is
tested in the first 10 s of each recording only. For any other shape parameter, the effect changes little between
neighbouring tested values.

Source: R. L. Berger (1982), Multiparameter hypothesis testing and acceptance sampling, Technometrics 24, 295-300.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import param_index
from dpr_lab.effects.effect import Effect, Shape
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace, SmallSets
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.fitting.uncompiled import RIDGE
from dpr_lab.gap.hypothesis.detectable import SEEN, linear_exclusions
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.scan import FittedColumns, shape_columns
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.result.evidence import DetectableSizes, Exclusion


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


def _intervals(all_shapes: "AllShapes", score: Score, space: ColumnSpace) -> dict[str, tuple[float, float]]:
    """Return the 90 % interval of each amplitude in a joint fit of all amplitudes of an effect.

    The result is empty if the recordings do not separate the amplitudes. If the shapes cannot be listed, such as the
    instant of an event, the interval of a single amplitude applies to the best shape.

    Args:
        all_shapes: test over all shapes
        score: score of the effect in its best shape
        space: columns of the amplitudes in this shape, with the model projected out
    """
    names = [p.name for p in score.effect.amplitudes]
    intervals = all_shapes.intervals(score.effect) if score.effect.shapes else None
    if intervals is None:
        if score.effect.shapes and len(score.columns) > 1:
            return {}
        names = [name for name in names if name not in score.absorbed]
        ridged = space.H + RIDGE * np.eye(len(space))
        one_shape = SmallSets(space.scale[None], ridged[None], space.gradient[None])
        intervals = _union(one_shape, all_shapes.model.inflation)
    return {} if intervals is None else {name: (low, high) for name, (low, high) in zip(names, intervals, strict=False)}


@dataclass(frozen=True, slots=True)
class ShapeSettings:
    """Settings of the test of all shapes."""

    longest_s: float = 10.0
    """Length of the beginning of each recording in which a frequency is tested, s."""
    most: int = 800
    """Maximum number of shapes, which allows frequencies up to 40 Hz in 10 s. A test of more shapes is too slow."""
    nodes: tuple[float, int] = (1.2, 20)
    """Number of nodes of the interpolation between frequencies: factor on the phase range, and a constant."""


SHAPES = ShapeSettings()


@dataclass(frozen=True)
class AllShapes:
    """Test of an effect that is added to a fitted set, over all shapes of the effect."""

    problem: Problem
    """The segments."""
    model: Hypothesis
    """Fitted set, which does not contain the tested effects."""

    def intervals(self, effect: Effect) -> list[tuple[float, float]] | None:
        """Return the 90 % interval of each amplitude over all shapes of an effect.

        The result is None if the amplitudes are inseparable in one of the shapes. It is also None for an effect that is
        not a torque along the swing, that has internal states, shapes proposed from a recording or several shape
        parameters, or whose shape parameter has too many values.
        """
        if effect.stage not in TRAJECTORY_TORQUES or effect.internal or effect.propose or len(effect.shapes) != 1:
            return None
        swings = self._beginnings if _is_frequency(effect) and self.problem.disturbance is None else self._whole
        values = _values(effect, swings.problem)
        if not 0 < len(values) <= SHAPES.most:
            return None
        of_frequencies = swings.at_frequencies(effect, values) if _is_frequency(effect) else None
        ends = list[Array]()
        for columns in swings.of_shapes(effect, values) if of_frequencies is None else (of_frequencies,):
            intervals = _union(columns, self.model.inflation)
            if intervals is None:
                return None
            ends.append(np.array(intervals))
        return [(float(low.min()), float(high.max())) for low, high in np.stack(ends, axis=2)]

    @cached_property
    def _whole(self) -> "_Swings":
        """Swings along the whole recordings."""
        return _Swings.of(self.problem, self.model.estimate, self.model.fit.linear)

    @cached_property
    def _beginnings(self) -> "_Swings":
        """Swings at the beginning of the recordings, in which frequencies are tested."""
        problem, estimate = _beginning(self.problem, self.model.estimate)
        if len(problem.segments) == len(self.problem.segments):
            return self._whole
        return _Swings.of(problem, estimate, linearise(problem, estimate, self.model.fit.free))


def _union(columns: SmallSets, inflation: float) -> list[tuple[float, float]] | None:
    """Return the union of the 90 % intervals in all shapes, for each amplitude.

    The result is None if the amplitudes are inseparable in one of the shapes.

    Args:
        columns: columns of the amplitudes in each shape, with the model projected out
        inflation: variance inflation n / n_eff
    """
    if np.linalg.eigvalsh(columns.H)[:, 0].min() < SEEN:
        return None
    inverse = np.linalg.inv(columns.H)
    x = columns.scale * (inverse @ columns.gradient[:, :, None])[:, :, 0]
    half_width = NORMAL_Q90 * columns.scale * np.sqrt(inflation * np.diagonal(inverse, axis1=1, axis2=2))
    lower, upper = (x - half_width).min(axis=0), (x + half_width).max(axis=0)
    return list(zip(lower.tolist(), upper.tolist(), strict=True))


def _is_frequency(effect: Effect) -> bool:
    (shape,) = effect.shapes
    return shape.unit == "Hz" and bool(shape.scan)


def _beginning(problem: Problem, estimate: Estimate) -> tuple[Problem, Estimate]:
    """Keep the segments that end within `SHAPES.longest_s` after the first reading."""
    ends = problem.t[problem.segments.offsets[1:] - 1]
    indices = np.flatnonzero(ends <= problem.t.min() + SHAPES.longest_s)
    samples = problem.segments.samples_of(indices)
    shortened = replace(
        problem,
        segments=problem.segments.chosen(indices),
        measured=problem.measured[samples],
        weight=problem.weight[samples],
    )
    return shortened, estimate.changed(initial=estimate.initial[indices])


def _values(effect: Effect, problem: Problem) -> Array:
    """Return the tested values of the only shape parameter; frequencies are evenly spaced, Hz."""
    (shape,) = effect.shapes
    if not _is_frequency(effect):
        return np.array(shape.scan)
    longest = float(problem.t.max() - problem.t.min())
    return np.arange(shape.scan[0], shape.scan[-1], 0.5 / longest)


@dataclass(frozen=True, slots=True)
class _Swings:
    """Trajectories of a fitted model, along which the shapes of an effect are tested."""

    problem: Problem
    reference: Trajectory
    fitted: FittedColumns

    @classmethod
    def of(cls, problem: Problem, estimate: Estimate, linear: Linearisation) -> "_Swings":
        """Simulate the swings with the estimate at which the problem is linearised."""
        return cls(problem, trajectory(problem, estimate, spacing=TRAJECTORY.coarse_s), FittedColumns.of(linear))

    def of_shapes(self, effect: Effect, values: Array) -> Iterator[SmallSets]:
        """Yield the normal equations of the amplitudes for blocks of shapes, with the model projected out."""
        for columns in self._columns(effect, values, self.reference):
            yield self.fitted.projected(columns, len(effect.amplitudes))

    def at_frequencies(self, effect: Effect, values: Array) -> SmallSets | None:
        """Return the normal equations of a cosine and a sine, for evenly spaced frequencies.

        The model is projected out. With the middle of each segment as origin of time, the inner products of the columns
        are band-limited functions of the frequency, which Chebyshev polynomials interpolate. If the number of nodes
        exceeds half the phase range, the error is negligible. The result is None if the interpolation needs more than
        half as many nodes as there are frequencies.
        """
        t, offsets = self.problem.t, self.problem.segments.offsets
        middle = (t[offsets[:-1]] + t[offsets[1:] - 1]) / 2
        since = self.reference.motion.t - np.repeat(middle, np.diff(self.reference.edges))
        factor, constant = SHAPES.nodes
        half_range = (values[-1] - values[0]) / 2
        count = int(factor * 4 * np.pi * half_range * np.abs(since).max()) + constant
        if 2 * count > len(values):
            return None
        x = chebpts1(count)
        to_series = chebvander(x, count - 1).T * np.where(np.arange(count) > 0, 2, 1)[:, None] / count
        onto_values = chebvander((values - values[0]) / half_range - 1, count - 1) @ to_series
        centred = replace(self.reference, motion=self.reference.motion._replace(t=since))
        blocks = [
            self.fitted.products(columns, 2)
            for columns in self._columns(effect, values[0] + half_range * (1 + x), centred)
        ]
        products = np.concatenate([block for block, _ in blocks], axis=2).reshape(len(middle), -1, count, 2)
        within = np.concatenate([block for _, block in blocks], axis=1)
        turn = np.exp(2j * np.pi * middle[:, None] * values)
        real, imaginary = np.moveaxis(np.tensordot(products, onto_values, axes=(2, 1)), 2, 0)
        total = np.einsum("skf,sf->kf", real + 1j * imaginary, turn)
        (cc, cs), (_, ss) = np.tensordot(within, onto_values, axes=(1, 1)).transpose(1, 2, 0, 3)
        same, turned = np.sum(cc + ss, axis=0), np.sum((cc - ss + 2j * cs) * turn**2, axis=0)
        squares = np.array([[same + turned.real, turned.imag], [turned.imag, same - turned.real]]) / 2
        pairs = np.stack([total.real, total.imag], axis=2).reshape(len(total), -1)
        return self.fitted.of_products(pairs, squares.transpose(2, 0, 1), 2)

    def _columns(self, effect: Effect, values: Array, reference: Trajectory) -> Iterator[Array]:
        """Yield the columns of unit amplitudes for blocks of shapes, along a trajectory."""
        place = param_index(effect.name, effect.shapes[0].name)
        shapes = list[Shape](((place, value),) for value in values.tolist())
        return shape_columns(self.problem, reference, effect, [1.0] * len(effect.amplitudes), shapes)

"""Intervals of the amplitudes of an effect whose shape is unknown: an order, a frequency, a speed.

An equivalence test must not select the shape: the effect is smaller than a limit if it is smaller in every shape. The
interval of an amplitude therefore covers its 90 % intervals in all shapes (an intersection-union test). If the effect
has one of the shapes and an amplitude beyond the limit, the interval of this shape lies inside the limit with a
probability of at most 5 %, however many other shapes are tested.

A frequency is resolved to half the inverse of the longest recording. Longer recordings would need more frequencies, so
a frequency is tested in the first 10 s of each recording. For any other shape parameter, the effect changes little
between neighbouring tested values.

Source: R. L. Berger (1982), Multiparameter hypothesis testing and acceptance sampling, Technometrics 24, 295-300.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import effect_params, param_index
from dpr_lab.effects.effect import Effect
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import RIDGE, ColumnSpace
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.gap.hypothesis.detectable import SEEN
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis


@dataclass(frozen=True, slots=True)
class ShapeSettings:
    """Settings of the test of all shapes."""

    longest_s: float = 10.0
    """Length of the beginning of each recording in which a frequency is tested, s."""
    most: int = 800
    """Maximum number of shapes, which allows frequencies up to 40 Hz in 10 s. A test of more shapes is too slow."""
    block: int = 32
    """Number of columns that are processed together, which limits the memory."""


SHAPES = ShapeSettings()


@dataclass(frozen=True)
class AllShapes:
    """Intervals of the amplitudes of effects over all shapes of each effect, next to a fitted set of effects."""

    problem: Problem
    """The segments."""
    model: Hypothesis
    """Fitted set without the tested effects."""

    def intervals(self, effect: Effect) -> list[tuple[float, float]] | None:
        """90 % interval of each amplitude, over all shapes of an effect.

        The result is None if the amplitudes are inseparable in one of the shapes. It is also None for an effect that is
        not a torque along the swing, that has several shape parameters, or whose shape parameter has too many values.
        """
        if effect.stage not in TRAJECTORY_TORQUES or effect.internal or effect.propose or len(effect.shapes) != 1:
            return None
        swings = self._beginnings if _is_frequency(effect) and self.problem.disturbance is None else self._whole
        values = _values(effect, swings.problem)
        if not 0 < len(values) <= SHAPES.most:
            return None
        blocks: list[Array] = []
        for spaces in swings.spaces(effect, values):
            of_block = _union(spaces, self.model.residuals.inflation)
            if of_block is None:
                return None
            blocks.append(of_block)
        lower, upper = np.min(blocks, axis=0)[:, 0].tolist(), np.max(blocks, axis=0)[:, 1].tolist()
        return list(zip(lower, upper, strict=True))

    @cached_property
    def _whole(self) -> "_Swings":
        """Swings of the whole recordings."""
        return _Swings.of(self.problem, self.model.fit.estimate, self.model.fit.linear)

    @cached_property
    def _beginnings(self) -> "_Swings":
        """Swings at the beginning of the recordings, in which frequencies are tested."""
        problem, estimate = _beginning(self.problem, self.model.fit.estimate)
        return _Swings.of(problem, estimate, linearise(problem, estimate, self.model.fit.free))


def joint_intervals(given: ColumnSpace, inflation: float) -> list[tuple[float, float]] | None:
    """90 % interval of each amplitude, fitted together with the other amplitudes; None if they are inseparable.

    Args:
        given: columns of the amplitudes, with the model projected out
        inflation: variance inflation n / n_eff
    """
    intervals = _union([given], inflation)
    return None if intervals is None else [(low, high) for low, high in intervals.tolist()]


def _union(spaces: Sequence[ColumnSpace], inflation: float) -> Array | None:
    """(n, 2) smallest interval of each of n amplitudes that contains its 90 % intervals in all shapes.

    None if the amplitudes are inseparable in one of the shapes. The arguments are those of `joint_intervals`, with one
    column space for each shape.
    """
    H = np.array([space.H for space in spaces])
    if np.linalg.eigvalsh(H)[:, 0].min() < SEEN:
        return None
    scale, gradient = np.array([space.scale for space in spaces]), np.array([space.gradient for space in spaces])
    inverse = np.linalg.inv(H + RIDGE * np.eye(H.shape[1]))
    x = scale * (inverse @ gradient[:, :, None])[:, :, 0]
    reach = NORMAL_Q90 * scale * np.sqrt(inflation * np.diagonal(inverse, axis1=1, axis2=2))
    return np.stack([(x - reach).min(axis=0), (x + reach).max(axis=0)], axis=1)


def _is_frequency(effect: Effect) -> bool:
    (shape,) = effect.shapes
    return shape.unit == "Hz" and bool(shape.scan)


def _beginning(problem: Problem, estimate: Estimate) -> tuple[Problem, Estimate]:
    """Problem and estimate with only those segments that end within `SHAPES.longest_s` after the first reading."""
    ends = problem.t[problem.segments.offsets[1:] - 1]
    indices = np.flatnonzero(ends <= problem.t.min() + SHAPES.longest_s)
    samples = problem.segments.samples_of(indices)
    part = replace(
        problem,
        segments=problem.segments.chosen(indices),
        measured=problem.measured[samples],
        weight=problem.weight[samples],
    )
    return part, estimate.changed(initial=estimate.initial[indices])


def _values(effect: Effect, problem: Problem) -> Array:
    """Tested values of the shape parameter; the values of a frequency are evenly spaced."""
    (shape,) = effect.shapes
    if not _is_frequency(effect):
        return np.array(shape.scan)
    longest = float(problem.t.max() - problem.t.min())
    return np.arange(shape.scan[0], shape.scan[-1], 0.5 / longest)


@dataclass(frozen=True, slots=True)
class _Swings:
    """Swings along which shapes are tested, with a fitted model."""

    problem: Problem
    linear: Linearisation
    reference: Trajectory
    fitted: ColumnSpace
    """Columns of the fitted parameters."""

    @classmethod
    def of(cls, problem: Problem, estimate: Estimate, linear: Linearisation) -> "_Swings":
        """Swings of an estimate, at which the problem was linearised."""
        reference = trajectory(problem, estimate, spacing=TRAJECTORY.coarse_s)
        return cls(problem, linear, reference, ColumnSpace.of(*linear.flat))

    def spaces(self, effect: Effect, values: Array) -> Iterator[list[ColumnSpace]]:
        """Columns of the amplitudes in each shape, with the model projected out, in blocks of several shapes."""
        amplitudes = [param_index(effect.name, p.name) for p in effect.amplitudes]
        count, place = len(amplitudes), param_index(effect.name, effect.shapes[0].name)
        at_once = max(1, SHAPES.block // count)
        for first in range(0, len(values), at_once):
            chosen = values[first : first + at_once]
            params = np.tile(effect_params({}), (len(chosen), count, 1))
            params[:, range(count), amplitudes] = 1.0
            params[:, :, place] = chosen[:, None]
            params = params.reshape(len(chosen) * count, -1)
            torques = self.reference.torques(effect.stage, self.problem.model.constants, params)
            given = self._given(self.linear.projected(self.reference.response(self.problem, torques)))
            yield [given.chosen(slice(start, start + count)) for start in range(0, len(given), count)]

    def _given(self, columns: Array) -> ColumnSpace:
        """Column space of columns (segments, m, k), with the fitted parameters projected out."""
        A, e = self.linear.flat
        added, flat, fitted = ColumnSpace.of(columns, e), columns.reshape(len(e), -1), len(self.fitted)
        across = self.fitted.scale[:, None] * (A.T @ flat) * added.scale
        space = ColumnSpace(
            np.append(self.fitted.scale, added.scale),
            np.block([[self.fitted.H, across], [across.T, added.H]]),
            np.append(self.fitted.gradient, added.gradient),
        )
        return space.given(slice(0, fitted), slice(fitted, None))

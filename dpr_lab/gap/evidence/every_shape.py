"""Intervals of the amplitudes of an effect whose shape is unknown: an order, a frequency, a speed.

An equivalence test must not select the shape. The effect is smaller than a limit if it is smaller in every shape. The
interval of an amplitude therefore covers its 90 % intervals in all shapes (an intersection-union test). If the effect
has one of the shapes and an amplitude beyond the limit, the interval of this shape lies inside the limit with a
probability of at most 5 %, however many other shapes are tested.

A frequency is resolved to half the inverse of the longest recording. Longer recordings would need more frequencies, so
a frequency is tested in the first 10 s of each recording. Between tested values of any other shape parameter the effect
changes little.

Source: R. L. Berger (1982), Multiparameter hypothesis testing and acceptance sampling, Technometrics 24, 295-300.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import effect_params, param_index
from dpr_lab.effects.effect import Effect
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import TRAJECTORY, trajectory
from dpr_lab.gap.hypothesis.detectable import SEEN
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis


@dataclass(frozen=True, slots=True)
class ShapeSettings:
    """Settings of the test of all shapes."""

    longest_s: float = 10.0
    """Length of the beginning of each recording in which a frequency is tested, s."""
    most: int = 800
    """Maximum number of shapes, which allows frequencies up to 40 Hz in 10 s; the test of more is too slow."""
    block: int = 32
    """Number of columns that are processed together, which limits the memory."""


SHAPES = ShapeSettings()


def intervals_of_all_shapes(effect: Effect, problem: Problem, model: Hypothesis) -> list[tuple[float, float]] | None:
    """90 % interval of each amplitude, over all shapes of an effect.

    None if the amplitudes are inseparable in one of the shapes. Also None for an effect that is not a torque along the
    swing, has several shape parameters, or has too many values of its shape parameter.

    Args:
        effect: an effect with a shape
        problem: the segments
        model: fitted set without the effect
    """
    if effect.stage not in TRAJECTORY_TORQUES or effect.internal or effect.propose or len(effect.shapes) != 1:
        return None
    linear, estimate = model.fit.linear, model.fit.estimate
    if _is_frequency(effect) and problem.disturbance is None:
        problem, estimate = _beginning(problem, estimate)
        linear = linearise(problem, estimate, model.fit.free)
    values = _values(effect, problem)
    if not 0 < len(values) <= SHAPES.most:
        return None
    tested = _spaces(effect, values, problem, linear, estimate)
    spaces = [joint_intervals(space, model.residuals.inflation) for space in tested]
    every = [intervals for intervals in spaces if intervals is not None]
    if len(every) < len(spaces):
        return None
    lower, upper = np.min(every, axis=0)[:, 0].tolist(), np.max(every, axis=0)[:, 1].tolist()
    return list(zip(lower, upper, strict=True))


def joint_intervals(given: ColumnSpace, inflation: float) -> list[tuple[float, float]] | None:
    """90 % interval of each amplitude, fitted together with the other amplitudes; None if they are inseparable.

    Args:
        given: columns of the amplitudes, with the model projected out
        inflation: variance inflation n / n_eff
    """
    if np.linalg.eigvalsh(given.H)[0] < SEEN:
        return None
    reach = NORMAL_Q90 * np.sqrt(inflation * np.diag(given.covariance()))
    return [(float(x - r), float(x + r)) for x, r in zip(given.solution(), reach, strict=True)]


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


def _spaces(
    effect: Effect, values: Array, problem: Problem, linear: Linearisation, estimate: Estimate
) -> Iterator[ColumnSpace]:
    """Columns of the amplitudes in each shape, with the model projected out."""
    amplitudes = [param_index(effect.name, p.name) for p in effect.amplitudes]
    reference = trajectory(problem, estimate, spacing=TRAJECTORY.coarse_s)
    fitted, count = linear.A.shape[2], len(amplitudes)
    place = param_index(effect.name, effect.shapes[0].name)
    at_once = max(1, SHAPES.block // count)
    for first in range(0, len(values), at_once):
        chosen = values[first : first + at_once]
        params = np.tile(effect_params({}), (len(chosen), count, 1))
        params[:, range(count), amplitudes] = 1.0
        params[:, :, place] = chosen[:, None]
        torques = reference.torques(effect.stage, problem.model.constants, params.reshape(len(chosen) * count, -1))
        columns = linear.projected(reference.response(problem, torques))
        space = ColumnSpace.of(np.concatenate([linear.A, columns], axis=2), linear.e)
        for k in range(len(chosen)):
            start = fitted + k * count
            yield space.given(list(range(fitted)), list(range(start, start + count)))

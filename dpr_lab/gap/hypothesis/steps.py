"""Instants of lasting steps of an encoder reading: found by the screening, or likely by the residuals."""

from collections.abc import Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Recorded
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.whitening import padded
from dpr_lab.gap.screen.record import Record

STEPS_KEPT = 3
"""Number of steps of a residual that are tried; a recording with more lost counts is not worth fitting."""

BEFORE_S = 1e-4
"""Time between a step and the first reading that shows it: shorter than any sample period."""

BLIND = 1e-6
"""Fraction of a step's squared length that must remain after the initial state is projected out, for it to be visible.
"""


def recorded(records: Sequence[Record], problem: Problem, fit: Fit) -> Recorded:
    """Properties of the recordings from which shapes are proposed."""
    screened = [(axis, run, at) for run, record in enumerate(records) for at, axis in record.screened.breaks]
    return Recorded(
        arm_moves=tuple(record.arm_moves for record in records),
        steps=lambda: screened or [step[1:] for step in _possible(records, _step_gains(problem, fit))[:STEPS_KEPT]],
    )


def _possible(
    records: Sequence[Record], steps: list[tuple[float, int, int, float]]
) -> list[tuple[float, int, int, float]]:
    """Properties of those encoders whose readings are counts."""
    return [step for step in steps if records[step[2]].screened.on_grid[step[1]]]


def _step_gains(problem: Problem, fit: Fit) -> list[tuple[float, int, int, float]]:
    """Gain, joint, run and instant of a step at the best sample of each segment, by cumulative sums from the end.

    A segment that lies entirely after the step contains a constant, which its initial state nearly absorbs; the
    nonlinear fit determines the exact offset.
    """
    segments, gains = problem.segments, []
    firsts, lengths = segments.offsets[:-1], np.diff(segments.offsets)
    every = padded(np.ones((*problem.weight.shape, 1)), problem.weight, segments.offsets)[..., 0]
    for joint in range(2):
        weight, e, Q = (
            every[:, :, joint],
            fit.linear.e[:, joint :: problem.axes],
            fit.linear.Q[:, joint :: problem.axes],
        )
        inner, onto = _from_end(e * weight), _from_end(Q * weight[:, :, None])
        norm = _from_end(weight**2) - np.sum(onto**2, axis=2)
        seen = norm > (BLIND * weight.sum(axis=1) ** 2 / lengths)[:, None]
        gain = np.where(seen, inner**2 / np.where(seen, norm, 1.0), 0.0)
        best = np.argmax(gain[:, 1:], axis=1) + 1
        at, most = problem.t[firsts + best] - BEFORE_S, gain[np.arange(len(best)), best]
        gains += zip(most.tolist(), repeat(joint), segments.run.tolist(), at.tolist())
    return sorted(gains, reverse=True)


def _from_end(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cumulative sums from the last sample backwards, of (segments, samples, ...)."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]

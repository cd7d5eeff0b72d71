"""Lengthen segments as far as the model follows, and say how far a free run can be predicted."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_from_ratios
from dpr_lab.dynamics.sensitivity import swing_sensitivity
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.estimation.least_squares import Conditions, SegmentFit, fit_segments
from dpr_lab.estimation.segments import Segment, join

LINEAR_RANGE = 0.2  # a free run that strays further from the measurement than this, rad, is not Gauss-Newton-able
FOLLOWS = 3.0  # reduced chi-square above which longer segments would only amplify what the model misses
WORSE = 1.5  # a level whose reduced chi-square rises by this factor is thrown away

HORIZON_ERROR = 0.1
"""Angle error that ends the predictability horizon, rad."""


def grow(fit: SegmentFit, known: Conditions) -> SegmentFit:
    """Lengthen the segments while the model still follows: longer segments carry more information.

    Neighbours are joined where the first one's free run stays within `LINEAR_RANGE` of the second's measurement, and
    the joined set is fitted again; a level whose residual rises is thrown away.
    """
    while fit.chi2_per_dof < FOLLOWS:
        joined = _join_neighbours(fit, known)
        if len(joined) == len(fit.segments):
            break
        longer = fit_segments(fit.unknowns, joined, known)
        if not longer.converged or longer.chi2_per_dof > WORSE * fit.chi2_per_dof:
            break
        fit = longer
    return fit


def _join_neighbours(fit: SegmentFit, known: Conditions) -> list[Segment]:
    joined: list[Segment] = []
    queue = list(fit.segments)
    while queue:
        first = queue.pop(0)
        if queue and queue[0].run == first.run and _follows(fit, both := join(first, queue[0]), known):
            joined.append(both)
            queue.pop(0)
        else:
            joined.append(first)
    return joined


def _follows(fit: SegmentFit, segment: Segment, known: Conditions) -> bool:
    ratios, _ = known.ratios(fit.unknowns, segment.run)
    states = simulate(base_from_ratios(ratios), known.L1, known.g, segment.start, segment.t)
    return bool(np.max(np.abs(states[:, :2] - segment.theta)) < LINEAR_RANGE)


def free_run(
    fit: SegmentFit, index: int, t: NDArray[np.float64], known: Conditions
) -> tuple[NDArray[np.float64], float]:
    """A swing simulated from a segment's fitted start state, and how far it means anything.

    The horizon is where the start state's uncertainty alone, carried along by the variational equation, moves an
    angle by `HORIZON_ERROR`.

    Args:
        fit: gives unknowns and start state
        index: the segment to start from
        t: (n,) instants, the first of them the segment's own
        known: as in the fit

    Returns:
        (n, 2) theta1, theta2, rad, and the horizon on the clock of `t`, s
    """
    ratios, _ = known.ratios(fit.unknowns, fit.segments[index].run)
    states, slopes = swing_sensitivity(ratios, known.L1, known.g, fit.segments[index].start, t)
    growth = slopes[:, :2, 5:]
    variance = np.einsum("nij,jk,nik->ni", growth, fit.start_covariances[index], growth) * max(1.0, fit.chi2_per_dof)
    lost = np.flatnonzero(~(np.sqrt(variance.max(axis=1)) < HORIZON_ERROR))
    return states[:, :2], float(t[lost[0]] if len(lost) else t[-1])

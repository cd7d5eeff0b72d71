"""The gap against the noise floor: in rad by axis, in N m, and as it grows with the horizon."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.gap.heldout import remainder
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Point, Problem, carried, problem
from dpr_lab.gap.record import Record
from dpr_lab.gap.response import course
from dpr_lab.gap.screen import AXES
from dpr_lab.gap.shooting import fit
from dpr_lab.rig import Rig

Array = NDArray[np.float64]

HORIZONS_S = (0.25, 0.5, 1.0, 2.0)
TORQUE_HATS = 3  # of each joint in each segment: one every 0.25 s


def floor_rad(made: Problem) -> dict[str, float]:
    """Noise of a thinned reading by axis, rms, rad."""
    return _named(np.sqrt(np.mean(made.weight**-2.0, axis=0)))


def gap_rad(made: Problem, at: Hypothesis) -> dict[str, float]:
    """What a fit leaves above the noise by axis, rms, rad."""
    residual = made.by_sample(at.fit.linear.residual)
    lost = 1 - (4 * len(made.run) + len(at.fit.slots)) / residual.size
    above = np.mean(residual**2, axis=0) / lost - at.remainder.level
    return _named(np.sqrt(np.maximum(above, 0.0) / np.mean(made.weight**2, axis=0)))


def gap_torque(made: Problem, at: Hypothesis) -> dict[str, float]:
    """The torque that would make up for what a fit leaves, by joint, rms, N m.

    In every segment a torque in each joint, piecewise linear in time, is fitted to the residual; the variance that
    noise alone gives to it is taken off.
    """
    along = course(made, at.fit.point)
    torque = np.zeros((len(along.t), 2, 2 * TORQUE_HATS))
    for first, last in zip(along.edges[:-1], along.edges[1:], strict=True):
        share = np.linspace(0, TORQUE_HATS - 1, last - first)
        for k in range(TORQUE_HATS):
            hat = np.maximum(0.0, 1 - np.abs(share - k))
            torque[first:last, 0, k] = hat
            torque[first:last, 0, TORQUE_HATS + k], torque[first:last, 1, TORQUE_HATS + k] = -hat, hat
    linear = at.fit.linear
    columns = linear.projected(made.whitened(along.readings(torque)))
    scale = 1 / np.maximum(np.sqrt(np.sum(columns**2, axis=(0, 1))), 1e-300)
    columns = columns * scale
    G = columns.transpose(0, 2, 1) @ columns + 1e-9 * np.eye(len(scale))
    inverse = np.linalg.inv(G)
    values = (inverse @ (columns.transpose(0, 2, 1) @ linear.e[:, :, None]))[:, :, 0] * scale
    variance = np.diagonal(inverse, axis1=1, axis2=2) * scale**2 * at.remainder.level
    weight = 1 / (variance + np.median(variance, axis=0))
    above = np.sum(weight * (values**2 - variance), axis=0) / np.sum(weight, axis=0)
    both = np.maximum(above.reshape(2, TORQUE_HATS).mean(axis=1), 0.0)
    return _named(np.sqrt(both))


def by_horizon(
    records: Sequence[Record], rig: Rig, working: Problem, points: Mapping[str, Point]
) -> dict[str, dict[str, float]]:
    """Gap of several models by the length of segments with free start states: horizon (s) -> model -> rms, rad."""
    found: dict[str, dict[str, float]] = {}
    for length in HORIZONS_S:
        made, starts = problem(records, rig, length)
        found[f"{length:g}"] = {}
        for name, point in points.items():
            begun = replace(point, starts=carried(working, point, made, starts))
            reached = fit(made, begun, ())
            left = remainder(made, reached)
            rms = np.sqrt(max(left.excess, 0.0) / left.dof / np.mean(made.weight**2))
            found[f"{length:g}"][name] = float(rms)
    return found


def _named(values: Array) -> dict[str, float]:
    return dict(zip(AXES, values.tolist(), strict=True))

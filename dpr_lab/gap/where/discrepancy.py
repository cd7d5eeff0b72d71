"""Discrepancy term: free torques and reading errors with a Gaussian prior.

    e = A p + M m + noise,    m ~ N(0, s^2)

The columns of A are those of the fitted parameters. The columns of M are the responses to hat functions of angle, speed
and time of each joint. The initial states are projected out of both. The columns of each group of hat functions are
scaled to a mean squared norm of one, so that one size s applies to all groups.

The size s maximises the restricted likelihood, with p free and the noise variance profiled out. With the normal matrix
H of M after the projection of A, l = variance / s^2, q columns and n independent readings,

    -2 log L = n log(rss(l)) + log det(H + l) - q log l.

The term shifts the fitted values by (A^T A)^-1 A^T M m. Their intervals are therefore wider.

Source: M. C. Kennedy & A. O'Hagan (2001), Bayesian calibration of computer models, J. R. Statist. Soc. B 63, 425-464;
D. A. Harville (1977), Maximum likelihood approaches to variance component estimation, JASA 72, 320-338.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.where.coordinates import Coordinate, FreeFunctions, Kind, beyond_fit, free_functions


@dataclass(frozen=True, slots=True)
class DiscrepancyRules:
    """Settings of the discrepancy term, and of the sentence that describes it."""

    ridges: tuple[float, ...] = (100.0, 30.0, 10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001)
    """Tested ratios l of the noise variance to the prior variance, from a negligible term to a nearly free term."""
    kinds: tuple[tuple[Kind, Coordinate], ...] = (
        ("torque", "angle"),
        ("torque", "speed"),
        ("friction", "time"),
        ("error", "angle"),
    )
    """Kinds of free functions, each with its coordinate."""
    likelier: float = 10.0
    """Minimum reduction of -2 log likelihood for which the discrepancy term is included in the model."""
    mostly: float = 2.0
    """Minimum ratio of the mean squared torques at low and high speed, or vice versa, for which the sentence names the
    speed."""


DISCREPANCY = DiscrepancyRules()


@dataclass(frozen=True, slots=True)
class Discrepancy:
    """Discrepancy term with its maximum-likelihood size."""

    columns: Array
    """(segments, m, q) whitened change of the readings by one standard deviation of the prior, for each function."""
    torque_Nm: tuple[float, ...]
    """Rms, over the recordings, of the posterior mean torque of joint 1, joint 2 and, if the arm moves, joint 0, N
    m."""
    reading_rad: tuple[float, ...]
    """Rms of the posterior mean error of each encoder, rad."""
    slow: tuple[float, ...]
    """Ratio of the mean squared torques in the slower and the faster half of the readings, for each joint."""

    @property
    def sentence(self) -> str:
        """Sentence that states the size and the joint of the largest torque of the discrepancy."""
        joint = int(np.argmax(self.torque_Nm))
        text = f"{1e3 * self.torque_Nm[joint]:.2g} mN m rms in joint {ALL_AXES[joint][-1]}"
        if self.slow[joint] > DISCREPANCY.mostly:
            text += ", mostly at low speed"
        elif self.slow[joint] < 1 / DISCREPANCY.mostly:
            text += ", mostly at high speed"
        return f"Unmodelled remainder: {text}."


def discrepancy(problem: Problem, model: Hypothesis) -> Discrepancy | None:
    """Return the discrepancy term of a fit, or None if it is not significant.

    It is significant if more than noise remains and the term reduces -2 log L by at least `DISCREPANCY.likelier`.
    """
    linear = model.fit.linear
    if model.at_noise_floor or not np.isfinite(linear.residual).all():
        return None
    reference = trajectory(problem, model.estimate, spacing=TRAJECTORY.coarse_s)
    groups, M = _scaled(problem, model.fit, reference)
    if not groups:
        return None
    space = beyond_fit(linear, model.fit.inside, M)
    H = space.H / np.outer(space.scale, space.scale)
    gradient = space.gradient / space.scale
    eigen, vectors = np.linalg.eigh(H)
    eigen, along_each = np.maximum(eigen, 0.0), (vectors.T @ gradient) ** 2
    n = model.residuals.chi2 / model.inflation  # number of independent readings of unit variance
    total = float(np.sum(linear.e**2))

    def cost(ridge: float) -> float:
        remaining = max(total - float(np.sum(along_each / (eigen + ridge))), 1e-3 * total)
        return n * np.log(remaining / total) + float(np.sum(np.log1p(eigen / ridge)))

    ridge = min(DISCREPANCY.ridges, key=cost)
    if cost(ridge) > -DISCREPANCY.likelier:
        return None
    m = vectors @ ((vectors.T @ gradient) / (eigen + ridge))
    variance = (total - float(np.sum(along_each / (eigen + ridge)))) / model.residuals.dof
    return _discrepancy(groups, M * np.sqrt(max(variance, 1.0) / ridge), m, reference, problem.axes)


def discrepancy_columns(problem: Problem, fit: Fit) -> Array:
    """Return the (segments, m, q) whitened change of the readings by each hat function.

    The columns of each group of functions are scaled to a mean squared norm of one.
    """
    return _scaled(problem, fit, trajectory(problem, fit.estimate, spacing=TRAJECTORY.coarse_s))[1]


def _scaled(problem: Problem, fit: Fit, reference: Trajectory) -> tuple[list[FreeFunctions], Array]:
    """Return the groups of free functions, and the (segments, m, q) columns of all functions.

    The columns of each group have a mean squared norm of one.
    """
    groups, columns = list[FreeFunctions](), [np.zeros((*fit.linear.e.shape, 0))]
    prescribed = all(setup.inner is not None for setup in problem.segments.setups)
    for joint, (kind, coordinate) in product(np.flatnonzero(problem.read.any(axis=0)).tolist(), DISCREPANCY.kinds):
        if kind != "error" and joint == 0 and prescribed:
            continue
        free = free_functions(problem, reference, joint, kind, coordinate)
        projected = fit.linear.projected(np.nan_to_num(free.readings(problem, reference)))
        size = float(np.sqrt(np.sum(projected**2) / projected.shape[2]))
        if size > 0:
            groups.append(replace(free, values=free.values / size))
            columns.append(projected / size)
    return groups, np.concatenate(columns, axis=2)


def _discrepancy(
    groups: list[FreeFunctions], columns: Array, m: Array, reference: Trajectory, axes: int
) -> Discrepancy:
    torque, reading, slow = [0.0] * axes, [0.0] * axes, [1.0] * axes
    sums: dict[tuple[int, bool], Array] = {}
    for free, sizes in zip(groups, np.split(m, np.cumsum([len(free.knots) for free in groups])[:-1]), strict=True):
        key = free.joint, free.kind != "error"
        sums[key] = sums.get(key, 0.0) + free.values @ sizes
    for (joint, of_torque), values in sums.items():
        (torque if of_torque else reading)[joint] = float(np.sqrt(np.mean(values**2)))
        if of_torque:
            slow[joint] = _slow_to_fast(values**2, np.abs(reference.joint_speed[:, joint]))
    return Discrepancy(columns, tuple(torque), tuple(reading), tuple(slow))


def _slow_to_fast(squares: Array, speed: Array) -> float:
    """Return the mean of (n,) squares in the slower half of the samples, divided by that in the faster half."""
    slower = speed < np.median(speed)
    if not slower.any() or slower.all():
        return 1.0
    return float(np.mean(squares[slower])) / max(float(np.mean(squares[~slower])), np.finfo(np.float64).tiny)

"""Likelihood of sets of effects under torques that do not repeat: a draught, a cable, friction that drifts.

Such a torque accumulates along a swing like process noise (`dpr_lab.fitting.whitening`). It is modelled as white noise
of one intensity q for each joint, propagated along the trajectory: the residuals of neighbouring readings are then
correlated, and a law that merely follows one course of the torque hardly reduces the innovations. The cost of a set is

    -2 log L(q) + penalty,    -2 log L = |innovations|^2 + sum log S + log det B^T B,

maximised over the values of the set by linear algebra, and integrated over the initial states, on which the readings
depend by B. A set without an effect has intensities of its own, so that a torque that does not repeat competes with
each effect.

Source: F. C. Schweppe (1965), Evaluation of likelihood functions for Gaussian signals, IEEE Trans. Inf. Theory 11;
H. D. Patterson & R. Thompson (1971), Recovery of inter-block information when block sizes are unequal, Biometrika 58,
545-554.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.disturbance import ONTO_RODS, random_walk
from dpr_lab.fitting.linearise import slow_starts
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import TRAJECTORY, trajectory
from dpr_lab.fitting.whitening import innovations
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import at_noise_floor

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class WanderingRules:
    """Settings of the comparison of sets under torques that wander."""

    levels: tuple[float, ...] = (0.0, *(4.0**k for k in range(-3, 11)))
    """Intensities that are compared: at 1, the torque changes the readings by as much as their noise, rms."""
    extensions: int = 4
    """Number of further effects that are fitted in addition to the likeliest set."""


WANDERING = WanderingRules()


@dataclass(frozen=True, slots=True, eq=False)
class Wandering:
    """Torques that wander along the trajectories of a set of effects."""

    problem: Problem
    walks: tuple[Array, ...]
    """For each joint, (samples, 4, 4): covariance added since the previous sample at the intensity 1."""
    out: Array
    """(samples, 2, 4) change of the readings per change of the initial state."""
    levels: tuple[int, ...]
    """Indices of the intensities of the joints in `WANDERING`: those with the least cost of the set."""

    def cost(self, model: Hypothesis, shift: int = 0) -> float:
        """Cost of a set; infinite if a segment cannot be followed.

        Args:
            model: the set
            shift: number of levels by which the intensities are higher
        """
        return _cost(self.problem, model, self._walk(level + shift for level in self.levels), self.out)

    def least_cost(self, model: Hypothesis) -> float:
        """Cost of a set with the intensities that are likeliest for itself, in the same ratio for both joints."""
        cost = cache(lambda shift: self.cost(model, shift))
        shift = 0
        while (best := min((shift, shift + 1, shift - 1), key=cost)) != shift:
            shift = best
        return cost(shift)

    def likeliest(self, model: Hypothesis) -> "Wandering":
        """The torques with the intensities that are likeliest for a set, by a search among neighbouring levels."""

        @cache
        def cost(levels: tuple[int, ...]) -> float:
            return _cost(self.problem, model, self._walk(levels), self.out)

        levels = self.levels
        while (best := min(product(*((i, i + 1, i - 1) for i in levels)), key=cost)) != levels:
            levels = best
        return Wandering(self.problem, self.walks, self.out, levels)

    def _walk(self, levels: Iterable[int]) -> Array:
        inside = (WANDERING.levels[min(max(level, 0), len(WANDERING.levels) - 1)] for level in levels)
        return np.sum([size * walk for size, walk in zip(inside, self.walks, strict=True)], axis=0)


def wandering(problem: Problem, model: Hypothesis) -> Wandering | None:
    """Torques that wander in addition to the effects of a set, with their likeliest intensities.

    None if only noise remains. None as well if the inputs have noise, which is such a torque already, or if the arm
    moves.

    Args:
        problem: the segments
        model: a set, fitted to them
    """
    inapplicable = problem.disturbance is not None or problem.segments.arm_moves
    if inapplicable or at_noise_floor(model) or not np.isfinite(model.fit.linear.residual).all():
        return None
    reference = trajectory(problem, model.fit.estimate, spacing=TRAJECTORY.coarse_s)
    walks = []
    for joint in np.flatnonzero(problem.read.any(axis=0)).tolist():
        into = reference.into @ ONTO_RODS[:, joint]
        walk = random_walk(reference, into[:, :, None] * into[:, None, :])
        if (influence := _influence(problem, walk, reference.out)) > 0.0:
            walks.append(walk / influence)
    start = int(np.searchsorted(WANDERING.levels, model.residuals.chi2 / model.residuals.dof - 1.0))
    torques = Wandering(problem, tuple(walks), reference.out, (min(start, len(WANDERING.levels) - 1),) * len(walks))
    return torques.likeliest(model) if walks else None


def _influence(problem: Problem, walk: Array, out: Array) -> float:
    """Mean variance of the readings due to a random walk, relative to that of their noise."""
    total, offsets = np.cumsum(walk, axis=0), problem.segments.offsets
    total -= np.repeat(total[offsets[:-1]], np.diff(offsets), axis=0)
    variance = np.einsum("nja,nab,njb->nj", out, total, out) * problem.weight**2
    return float(variance[problem.read].mean())


def _cost(problem: Problem, model: Hypothesis, walk: Array, out: Array) -> float:
    linear, fit = model.fit.linear, model.fit
    if not np.isfinite(linear.residual).all():
        return float("inf")
    inside, states = fit.inside, linear.R.shape[1]
    of_values = linear.A[:, :, inside] + linear.Q @ linear.initial_state_coefficients[:, :, inside]
    columns = np.concatenate([linear.residual[:, :, None], of_values, linear.Q @ linear.R], axis=2)
    volume, blocks = 0.0, columns.reshape(len(columns), -1, problem.axes, columns.shape[2])
    if walk.any():
        shared = np.zeros((len(problem.t), problem.axes))
        volume = innovations(blocks, problem.weight, problem.segments.offsets, walk, out, shared)
    columns = blocks.reshape(columns.shape)
    slow = np.array([np.diag(slow_starts(setup, states)) for setup in problem.segments.setups])[problem.segments.run]
    Q, R = np.linalg.qr(np.concatenate([columns[:, :, -states:], slow], axis=1))
    Q, others = Q[:, :-states], columns[:, :, :-states]
    others = others - Q @ (Q.transpose(0, 2, 1) @ others)
    e, prior = others[:, :, 0], fit.prior[:, inside]
    space = ColumnSpace.of(others[:, :, 1:], e).with_prior(prior, np.zeros(len(prior)))
    of_starts = 2.0 * float(np.log(np.abs(np.diagonal(R, axis1=1, axis2=2))).sum())
    return float(np.sum(e**2)) - space.gain() + volume + of_starts + model.penalty

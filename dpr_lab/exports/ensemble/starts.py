"""Draw random initial states of segments from their distribution, given the readings and the model.

Let V be the covariance of the encoder zeros of one recording. J_x and J_z are the weighted derivatives of the readings
with respect to initial state and zeros. W is the weak prior of `dpr_lab.fitting.linearise`, and f the variance
inflation n / n_eff (`dpr_lab.gap.hypothesis.residuals`). A draw is then

    z ~ N(0, V),    x = x0 - P^-1 J_x^T J_z z / f + n,    n ~ N(0, P^-1),    P = J_x^T J_x / f + W.

x0 is the fitted initial state. f is computed for the model with effects, because the misfit of the same rods without
effects contains no information about the initial states. The prior W is not divided by f. If Coulomb friction stops a
joint at once, only the prior limits the initial speed of this joint. The readings of such a joint are not a linear
function of the state. A draw whose misfit exceeds a quantile of the linear problem is therefore moved towards the fit.
The encoder zeros are fixed unless the encoders are zeroed before each recording (`rezeroed`).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from dpr_lab.exports.ensemble.sampled import square_root
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import Estimate, moved
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.linearise import slow_starts
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.residuals import residual_statistics


@dataclass(frozen=True, slots=True)
class StartSettings:
    """Settings for drawing random initial states."""

    tail: float = 1e-3
    """Fraction of the draws that would exceed the largest accepted misfit if the problem were linear."""
    halvings: int = 10
    """Maximum number of halvings of the distance between a draw and the fit."""


STARTS = StartSettings()


def drawn_starts(problem: Problem, fit: Fit, rng: np.random.Generator) -> Estimate:
    """Draw random initial states and encoder zeros for a fitted estimate.

    The result is not finite if the model cannot follow the readings.

    Args:
        problem: readings to which the states were fitted
        fit: fit of the initial states, and of the zeros that are free
        rng: random numbers
    """
    inflation, linear, states = residual_statistics(problem, fit).inflation, fit.linear, problem.segments.states
    by_run = np.array([np.diag(slow_starts(setup, states) ** 2) for setup in problem.segments.setups])
    prior, turned = by_run[problem.segments.run], linear.R.transpose(0, 2, 1)
    precision = (turned @ linear.R - prior) / inflation + prior
    zeros = square_root(considered(fit, inflation)) @ rng.standard_normal(len(fit.free))
    by_zeros = turned @ (linear.initial_state_coefficients @ zeros)[:, :, None] / inflation
    noise = np.linalg.cholesky(precision) @ rng.standard_normal((*fit.estimate.initial.shape, 1))
    steps = np.asarray(np.linalg.solve(precision, noise - by_zeros)[:, :, 0], dtype=np.float64)
    most = linear.chi2_by_segment + inflation * float(chdtri(states + len(zeros), STARTS.tail))
    for _ in range(STARTS.halvings):
        drawn = moved(fit.estimate, fit.free, zeros, steps)
        residual = problem.whitened(problem.measured - problem.predict(drawn))
        far = ~(np.sum(residual**2, axis=1) <= most)
        if not far.any():
            break
        steps[far] /= 2.0
    return moved(fit.estimate, fit.free, zeros, steps)

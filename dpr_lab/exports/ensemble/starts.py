"""Random initial states of segments, drawn from their distribution given readings and model.

With V the covariance of the zeros of the encoders of one recording, R and C of `dpr_lab.fitting.linearise`, and f the
variance inflation n / n_eff (`dpr_lab.gap.hypothesis.residuals`), a draw is

    z ~ N(0, V),    x = x0 + R^-1 (sqrt(f) n - C z),    n ~ N(0, 1).

f is that of the model with its effects: the misfit of the same rods without them says nothing about its initial states.
The zeros are fixed unless the encoders are set to zero before each recording (`rezeroed`).
"""

import numpy as np

from dpr_lab.exports.ensemble.sampled import square_root
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import Estimate, moved
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.residuals import residual_statistics


def drawn_starts(problem: Problem, fit: Fit, rng: np.random.Generator) -> Estimate:
    """The fitted estimate with random initial states and zeros; not finite if the model cannot follow the readings.

    Args:
        problem: readings from which the states were fitted
        fit: fit of initial states, and of the zeros that are free
        rng: random numbers
    """
    inflation, linear = residual_statistics(problem, fit).inflation, fit.linear
    zeros = square_root(considered(fit, inflation)) @ rng.standard_normal(len(fit.free))
    noise = inflation**0.5 * rng.standard_normal(fit.estimate.initial.shape)
    steps = np.linalg.solve(linear.R, (noise - linear.initial_state_coefficients @ zeros)[:, :, None])[:, :, 0]
    return moved(fit.estimate, fit.free, zeros, steps)

"""Residuals of a fit relative to the noise, and the effective number of independent values."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem


@dataclass(frozen=True, slots=True)
class NoiseAssumptions:
    """Assumptions about the residuals of a fit."""

    level: tuple[float, float] = (0.3, 1.3)
    """Range of the variance ratio in which a deviation counts as an error of the noise floor, not as a gap."""
    most_correlated: float = 0.99
    """Maximum autocorrelation of neighbouring residuals.

    At a larger autocorrelation, a record of seconds would have an effective sample size of one.
    """
    wildest: float = 1e6
    """Residual of the readings in a segment that cannot be simulated, in standard deviations.

    It is the largest residual that is possible.
    """


ASSUMPTIONS = NoiseAssumptions()


@dataclass(frozen=True, slots=True)
class ResidualStatistics:
    """Statistics of the residuals of a fit, relative to the noise."""

    chi2: float
    dof: int
    """Degrees of freedom; 1 if there are as many parameters as readings, or more."""
    level: float
    """Variance of the rough part of the residual, in units of the noise that the fit assumed."""
    autocorrelation: float
    """Correlation of neighbouring residuals: the smooth fraction of their variance."""
    noise_correlation: float = 0.0
    """Correlation of the errors of neighbouring readings."""

    @property
    def excess(self) -> float:
        """Excess chi-square: chi2 above the noise."""
        return self.chi2 - self.level * self.dof

    @property
    def uncertainty(self) -> float:
        """Standard deviation of the excess chi-square for noise alone."""
        rho = self.noise_correlation
        return self.level * (self.dof * (1 + rho) / (1 - rho)) ** 0.5

    @property
    def independent_noise(self) -> float:
        """Variance of white noise with the same parameter covariance as the residuals, relative to the assumed noise.

        The value is level (1 + rho) / (1 - rho), where rho is the correlation of the errors of neighbouring readings.
        """
        return self.level * (1 + self.noise_correlation) / (1 - self.noise_correlation)

    @property
    def z(self) -> float:
        """Significance of the residual: its distance from the value expected for noise, in standard deviations."""
        return self.excess / self.uncertainty

    @property
    def inflation(self) -> float:
        """Variance inflation: n / n_eff of a first-order process times the residual variance."""
        rho = min(max(self.autocorrelation, 0.0), ASSUMPTIONS.most_correlated)
        return max(self.chi2 / self.dof, 1.0) * (1 + rho) / (1 - rho)

    @property
    def noise_ratio(self) -> float:
        """Ratio of the residual to the noise, both rms."""
        return float(np.sqrt(max(self.excess, 0.0) / (self.level * self.dof)))


def bounded_residual(problem: Problem, fit: Fit) -> Array:
    """Return the (samples, 2) whitened residual, limited to `wildest`.

    In a segment that cannot be simulated, the residual is `wildest`.
    """
    wildest = ASSUMPTIONS.wildest
    return np.clip(np.nan_to_num(problem.by_sample(fit.linear.residual), nan=wildest), -wildest, wildest)


def residual_statistics(problem: Problem, fit: Fit) -> ResidualStatistics:
    """Compute the statistics of a residual from its smooth and its rough part.

    Both parts are equal for white noise, and unequal if an effect is missing. Noise with the correlation rho between
    neighbouring readings is as rough as white noise of 1 - rho times its variance. The noise level is estimated from
    differences of neighbouring residuals (von Neumann). Therefore an error of the noise floor by a few per cent does
    not count as a gap. If a residual is rougher than the noise floor allows, this also counts as excess. The difference
    between chi2 and its rough part is the sum of products of neighbours. For white noise this sum has the variance dof.

    Source: J. von Neumann (1941), Distribution of the ratio of the mean square successive difference to the variance,
    Annals of Mathematical Statistics 12(4), 367-395.
    """
    r, rho = bounded_residual(problem, fit), problem.noise_correlation
    within = np.ones(len(r) - 1, dtype=bool)
    within[problem.segments.offsets[1:-1] - 1] = False
    read = problem.read
    rough = 0.5 * float(np.sum(np.diff(r, axis=0)[within] ** 2)) / np.count_nonzero(read[1:][within])
    mean = float(np.sum(r**2)) / np.count_nonzero(read)
    return ResidualStatistics(
        chi2=float(np.sum(r**2)),
        dof=max(problem.evidence - len(fit.free), 1),
        level=float(np.clip(rough / (1 - rho), *ASSUMPTIONS.level)),
        autocorrelation=1 - rough / mean if mean > 0 else 0.0,
        noise_correlation=rho,
    )

"""Statistics of the residuals of a fit, relative to the noise."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem


@dataclass(frozen=True, slots=True)
class NoiseAssumptions:
    """Assumptions about the residuals of a fit."""

    level: tuple[float, float] = (0.3, 1.3)
    """Range of the ratio of estimated to assumed noise variance that counts as an error of the noise floor, not as a
    gap."""
    most_correlated: float = 0.99
    """Maximum autocorrelation of neighbouring residuals.

    At a larger value, a record of a few seconds would have an effective sample size of one.
    """
    wildest: float = 1e6
    """Residual of the readings in a segment that cannot be simulated, in standard deviations.

    Larger residuals are clipped to this value.
    """


ASSUMPTIONS = NoiseAssumptions()


@dataclass(frozen=True, slots=True)
class ResidualStatistics:
    """Statistics of the residuals of a fit, relative to the noise."""

    chi2: float
    dof: int
    """Degrees of freedom; 1 if there are as many parameters as readings, or more."""
    level: float
    """Noise variance estimated from differences of neighbouring residuals, relative to the assumed noise variance."""
    autocorrelation: float
    """Correlation of neighbouring residuals."""
    noise_correlation: float = 0.0
    """Correlation of the errors of neighbouring readings."""

    @property
    def excess(self) -> float:
        """Excess chi-square: chi2 minus its expected value for noise alone."""
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
        """Variance inflation: n / n_eff of a first-order process, times the residual variance if this exceeds one."""
        rho = min(max(self.autocorrelation, 0.0), ASSUMPTIONS.most_correlated)
        return max(self.chi2 / self.dof, 1.0) * (1 + rho) / (1 - rho)

    @property
    def noise_ratio(self) -> float:
        """Ratio of the rms of the residual above the noise to the rms of the noise."""
        return float(np.sqrt(max(self.excess, 0.0) / (self.level * self.dof)))


def bounded_residual(problem: Problem, fit: Fit) -> Array:
    """Return the (samples, 2) whitened residual, limited to `wildest`.

    In a segment that cannot be simulated, the residual is `wildest`.
    """
    wildest = ASSUMPTIONS.wildest
    return np.clip(np.nan_to_num(problem.by_sample(fit.linear.residual), nan=wildest), -wildest, wildest)


def residual_statistics(problem: Problem, fit: Fit) -> ResidualStatistics:
    """Compute the statistics of a residual from its values and their differences.

    The noise level is estimated from differences of neighbouring residuals (von Neumann), because a missing effect
    changes the residual slowly. An error of the noise floor by a few per cent therefore does not count as a gap. If rho
    is the correlation of the errors of neighbouring readings, half the mean squared difference is 1 - rho times the
    variance of the noise. If the estimated level is outside `ASSUMPTIONS.level`, the difference counts as excess. For
    white noise, the excess has the variance dof.

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

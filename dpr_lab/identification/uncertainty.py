"""Estimate the uncertainty of fitted ratios under correlated residuals (docs/theory.md, equation 22)."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.errors import IdentificationError
from dpr_lab.fitting.estimate import ON_ELBOW, UNKNOWN_RATIOS, ratio_parameters
from dpr_lab.fitting.gauss_newton import RigPrior
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.identification.ratio_fit import RatioFit


@dataclass(frozen=True, slots=True)
class CovarianceSettings:
    """Settings of the covariance under correlated residuals."""

    block_s: float = 0.5
    """Length of the blocks of residuals that are treated as independent, s: half a swing of a 0.4 m rod."""
    misfit: float = 1.5
    """Reduced chi-square above which the model error, not the noise, dominates the uncertainty."""
    halves: float = 1.1
    """Factor that corrects the difference between the halves of the runs, which one linear step underestimates."""


SETTINGS = CovarianceSettings()


@dataclass(frozen=True, slots=True)
class RatioUncertainty:
    """Uncertainty of the unknowns that the runs determine.

    The unknowns are in the order of `dpr_lab.fitting.estimate.UNKNOWN_RATIOS`.
    """

    values: Array
    """(n,) fitted values of the unknowns."""
    information: Array
    """(n, n) Fisher information, with initial states eliminated."""
    covariance: Array
    """(n, n) covariance from blocks of residuals; zero for unknowns at their bound.

    Ratios that the runs do not determine are treated as known, as in a prediction of the same rods.
    """
    blocks: int
    """Number of blocks of residuals."""
    names: tuple[str, ...]
    """Names of the unknowns."""
    prior: Array
    """(n, n) information of the rig file on the unknowns."""
    assumed: Array
    """(n, n) additional covariance due to ratios that the runs do not determine and that come from the rig file."""
    unconstrained: Array
    """(n, 2) unconstrained estimate and standard deviation of each unknown at its bound; zero for all others.

    The unknowns inside their bounds are refitted.
    """

    @property
    def std(self) -> Array:
        """Standard deviations (n,) of the unknowns, including the contribution of undetermined ratios."""
        return np.sqrt(np.diag(self.covariance + self.assumed))

    @property
    def estimates(self) -> list[tuple[str, float, float]]:
        """Name, value and standard deviation of each unknown."""
        return list(zip(self.names, self.values.tolist(), self.std.tolist(), strict=True))

    @property
    def at_zero(self) -> tuple[str, ...]:
        """Names of the friction ratios fixed at zero because of a negative unconstrained estimate."""
        return tuple(name for name, value in zip(self.names, self.values, strict=False) if value <= 0)

    @property
    def cramer_rao_std(self) -> Array:
        """Cramér-Rao bounds (n,) of the standard deviations, with the prior.

        A bound is zero for an unknown that is fixed at zero.
        """
        std, free = np.zeros(len(self.values)), self.values > 0
        std[free] = [self.cramer_rao_with(place) for place in np.flatnonzero(free).tolist()]
        return std

    def cramer_rao_with(self, place: int) -> float:
        """Return the Cramér-Rao bound of the standard deviation of one unknown.

        The unknown is treated as free, even if it is fixed at zero.
        """
        released = np.flatnonzero((self.values > 0) | (np.arange(len(self.values)) == place))
        variance = np.diag(np.linalg.inv((self.information + self.prior)[np.ix_(released, released)]))
        return float(variance[np.searchsorted(released, place)] ** 0.5)

    @property
    def of_prior(self) -> Array:
        """(n,) ratio of each variance to its prior variance, 0 to 1.

        The runs add no information on an unknown whose ratio is near 1.
        """
        return np.minimum(np.diag(self.covariance) / np.diag(np.linalg.inv(self.prior)), 1.0)

    @property
    def of_runs(self) -> Array:
        """(n, n) covariance from the runs alone; at most 1e6 times the prior covariance.

        Coordinates are chosen in which the prior has unit covariance. A variance v from runs and prior together then
        corresponds to the variance v / (1 - v) from the runs alone.
        """
        root = np.linalg.cholesky(self.prior)
        share, directions = np.linalg.eigh(root.T @ self.covariance @ root)
        alone = share / (1.0 - np.clip(share, 0.0, 1.0 - 1e-6))
        back = np.linalg.solve(root.T, directions)
        return (back * alone) @ back.T

    def interval90(self, index: int) -> tuple[float, float]:
        """Compute the 90 % interval of one unknown by Student's t distribution.

        The degrees of freedom are the number of blocks minus the number of unknowns. If undetermined ratios of the rig
        file widen the interval, its lower end is at least zero. The interval of an unknown at its bound of zero is
        one-sided: it contains 90 % of the positive part of the distribution around the unconstrained estimate.
        """
        freedom = max(self.blocks - len(self.values), 1)
        if self.values[index] <= 0.0:
            estimate, std = self.unconstrained[index]
            beyond = max(0.1 * float(stdtr(freedom, estimate / std)), np.finfo(float).tiny)
            return 0.0, max(float(estimate - std * stdtrit(freedom, beyond)), 0.0)
        reach = float(stdtrit(freedom, 0.95)) * float(self.std[index])
        assumed = np.broadcast_to(self.assumed, self.covariance.shape)[index, index] > 0.0
        low = float(self.values[index]) - reach
        return max(low, 0.0) if assumed else low, float(self.values[index] + reach)


def refuse_undetermined(values: Array, covariance: Array, what: str) -> None:
    """Check that fitted values and their covariance are finite.

    `what` names the unknowns in the message.

    Raises:
        IdentificationError: a value is not finite, because the runs do not determine the unknowns.
    """
    if not (np.isfinite(values).all() and np.isfinite(covariance).all()):
        raise IdentificationError(
            f"these runs do not determine {what}: no finite uncertainty. Record larger and longer motions, and check"
            " zero, unit, sign and order of the angles"
        )


def uncertainty(ratio_fit: RatioFit) -> RatioUncertainty:
    """Estimate the uncertainty of a fit in which all unknowns are free.

    The covariance is computed from the Fisher information at the actual residual variance. It is increased if the
    scores of blocks of residuals scatter more than the information predicts. For white residuals, information and
    scatter agree, and the information is more accurate, because few blocks contain most of the information of a chaotic
    run. Correlated residuals increase the scatter of the blocks.

    A model error changes slowly along a run, so that blocks underestimate its scatter. If it dominates, the 90 %
    interval is therefore made at least as wide as the difference between the estimates from the first and second halves
    of the runs.

    Raises:
        LinAlgError: the recordings do not determine the unknowns.
        IdentificationError: the uncertainty is not finite.
    """
    A, e = ratio_fit.slopes, ratio_fit.fit.linear.e
    H = np.einsum("smi,smj->ij", A, A)
    scores, prior = _block_scores(ratio_fit.problem, A * e[:, :, None]), ratio_fit.prior_information
    free = ratio_fit.unknowns > 0
    bread, of_free = _covariance(ratio_fit, H, scores, free)
    covariance, assumed, unconstrained = np.zeros_like(H), np.zeros_like(H), np.zeros((len(free), 2))
    covariance[np.ix_(free, free)] = of_free
    assumed[np.ix_(free, free)] = _by_unseen(ratio_fit, A, bread, free)
    gradient = np.einsum("smi,sm->i", A, e) + _prior_gradient(ratio_fit)
    for place in np.flatnonzero(~free):  # the gradients of the other unknowns are zero
        released = free | (np.arange(len(free)) == place)
        index = np.count_nonzero(free[:place])
        bread, of_released = _covariance(ratio_fit, H, scores, released)
        unconstrained[place] = bread[index, index] * gradient[place], of_released[index, index] ** 0.5
    names = tuple(UNKNOWN_RATIOS[i] for i in ratio_fit.visible)
    refuse_undetermined(ratio_fit.unknowns, covariance, "the ratios")
    return RatioUncertainty(ratio_fit.unknowns, H, covariance, len(scores), names, prior, assumed, unconstrained)


def _covariance(ratio_fit: RatioFit, H: Array, scores: Array, free: Flags) -> tuple[Array, Array]:
    """Return the inverse information (free, free) of the free unknowns, and their covariance (free, free).

    The mean of the gradients is zero for all unknowns inside their bounds.

    Args:
        ratio_fit: the fit
        H: (n, n) information of the readings
        scores: (blocks, n) gradient of each block of residuals
        free: (n,) mask of the free unknowns
    """
    prior, weight = ratio_fit.prior_information, ratio_fit.noise_factor
    bread = np.asarray(np.linalg.inv((H + weight * prior)[np.ix_(free, free)]), dtype=np.float64)
    if not (np.diag(bread) > 0.0).all():
        raise np.linalg.LinAlgError("the information matrix is numerically singular")
    white = bread * ratio_fit.chi2_per_dof
    free_scores = scores[:, free] - scores[:, free].mean(axis=0)
    count = len(scores) / max(len(scores) - len(free), 1)
    variance = np.maximum(np.diag(white), np.diag(count * bread @ free_scores.T @ free_scores @ bread))
    if ratio_fit.chi2_per_dof > SETTINGS.misfit:
        difference = SETTINGS.halves * _halves_apart(ratio_fit)[free]
        variance = np.maximum(variance, (difference / 2 / ndtri(0.95)) ** 2)
    before = np.diag(np.linalg.inv(prior))[free] if prior.any() else np.inf
    variance = np.maximum(np.minimum(variance, before), np.diag(white))
    widen = np.sqrt(variance / np.diag(white))
    return bread, np.asarray(white * np.outer(widen, widen), dtype=np.float64)


def _prior_gradient(ratio_fit: RatioFit) -> Array:
    """Return the gradient (n,) of the rig file's prior, in the unit of chi2."""
    fit = ratio_fit.fit
    prior = RigPrior.at(ratio_fit.problem, fit.estimate, fit.free, fit.linear)
    gradient = prior.A.T @ prior.e
    return gradient[[i for i, parameter in enumerate(fit.free) if parameter.block == "ratios"]]


def _by_unseen(ratio_fit: RatioFit, A: Array, bread: Array, free: Flags) -> Array:
    """Return the covariance (free, free) due to the prior uncertainty of undetermined ratios.

    Source: consider covariance, S. F. Schmidt (1966), as in `dpr_lab.fitting.covariance`.
    """
    problem, estimate = ratio_fit.problem, ratio_fit.fit.estimate
    alone = any(setup.alone for setup in problem.segments.setups)
    ratios_and_b = (*range(len(RATIOS)), *([ON_ELBOW] if alone else []))
    unseen = [place for place in ratios_and_b if place not in ratio_fit.visible]
    if problem.prior is None or not unseen:
        return np.zeros_like(bread)
    slopes = linearise(problem, estimate, ratio_parameters(estimate, unseen)).A
    spread = slopes @ np.linalg.cholesky(problem.prior.covariance[np.ix_(unseen, unseen)])
    shifts = bread @ np.einsum("smi,smj->ij", A[:, :, free], spread)
    return shifts @ shifts.T


def _block_scores(problem: Problem, scores: Array) -> Array:
    """Return the (blocks, n) sums of the gradients over blocks of `block_s`.

    The blocks are the independent units of the covariance.
    """
    owner, t = problem.owner, problem.t
    first = problem.segments.offsets[owner]
    by_sample = scores.reshape(len(scores), -1, problem.axes, scores.shape[2]).sum(axis=2)[
        owner, np.arange(len(t)) - first
    ]
    block = ((t - t[first]) // SETTINGS.block_s).astype(int)
    edges = np.flatnonzero((np.diff(owner, prepend=-1) != 0) | (np.diff(block, prepend=-1) != 0))
    return np.add.reduceat(by_sample, edges, axis=0)


def _halves_apart(ratio_fit: RatioFit) -> Array:
    """Return the (n,) absolute differences between the Gauss-Newton steps of the two halves of the runs.

    A segment that contains the middle of its run is divided there, and each part has its own initial state.
    """
    problem, linear = ratio_fit.problem, ratio_fit.fit.linear
    owner, t, first = problem.owner, problem.t, problem.segments.offsets[:-1]
    run = problem.segments.run[owner]
    middle = np.array([(t[run == i].min() + t[run == i].max()) / 2 for i in range(run.max() + 1)])
    second = np.zeros((len(first), linear.e.shape[1] // problem.axes, problem.axes), dtype=np.bool_)
    second[owner, np.arange(len(t)) - first[owner]] = (t > middle[run])[:, None]
    columns, steps = np.concatenate([ratio_fit.slopes, linear.e[:, :, None]], axis=2), []
    for half in (~second, second):
        inside = half.reshape(*linear.e.shape, 1)
        states = linear.Q * inside
        alone = columns * inside
        alone -= states @ (np.linalg.pinv(states) @ alone)
        A, e = alone[:, :, :-1], alone[:, :, -1]
        information, gradient = np.einsum("smi,smj->ij", A, A), np.einsum("smi,sm->i", A, e)
        steps.append(np.linalg.pinv(information, hermitian=True) @ gradient)
    return np.abs(steps[1] - steps[0])

"""Prior of the rig file: normal distribution of ratios and b, and limits of effects.

The nine parameters have their best known values as means. The standard deviation of each is that of a uniform
distribution between its bounds, or the standard uncertainty of a measured value. A lower limit keeps the prior weak.
With J the derivative of the ratios, b and p/b with respect to the nine parameters, the prior covariance is

    P = J diag(std^2) J^T + F.

F widens the ratios of friction by a fixed damping ratio, because bounds of friction are guesses. The amplitude of an
effect has a normal prior about zero, with a third of its limit (`dpr_lab.effects.limits`) as standard deviation.

If the residuals exceed the noise, they are treated as noise of their size. The cost of a fit is therefore

    chi2 + w (v - mean)^T P^-1 (v - mean),    w = max(1, reduced chi2),

where v are the free unknowns and P is their marginal prior covariance.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.base import BASE, base_jacobian, ratio_jacobian, whole_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects.limits import amplitude_limits
from dpr_lab.effects.quantities import BaseParameters
from dpr_lab.fitting.estimate import (
    EFFECTS_BEGIN,
    FRICTION,
    ZERO_SIZE,
    Estimate,
    FreeParameter,
    unknown_ratios,
)
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.rig import PARAMETERS, Rig


@dataclass(frozen=True, slots=True)
class PriorStrength:
    """Strength of the prior that follows from the rig file."""

    floor: float = 0.05
    """Minimum relative standard deviation of a parameter.

    An incomplete model may need values that differ from the measured values.
    """
    damping: float = 0.3
    """Standard deviation of the damping ratio of a small swing, which widens the prior of the friction ratios."""
    amplitude: float = 1.0 / 3.0
    """Standard deviation of an amplitude relative to its limit."""
    absorbed: float = 2e-3
    """Minimum norm of a column after earlier columns are projected out, relative to its norm before.

    The initial states are projected out of both.
    """
    zeros: float = 10.0
    """Standard deviation of an encoder zero that changes before each run, in units of the typical size `ZERO_SIZE`."""


STRENGTH = PriorStrength()

_B = BASE.index("b")


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Prior information of the rig file on the unknowns."""

    mean: Array
    """(7,) prior means of the ratios, b and p/b."""
    covariance: Array
    """(7, 7) prior covariance of the ratios, b and p/b."""
    limits: Array
    """(SIZE,) maximum sizes of the amplitudes of effects."""

    def rows(self, estimate: Estimate, free: Sequence[FreeParameter]) -> tuple[Array, Array]:
        """Return the matrix A (n, free) and the vector e (n,) of the prior.

        The prior adds |e - A step|^2 to the cost of a step from the estimate.
        """
        A, e = np.zeros((len(free), len(free))), np.zeros(len(free))
        of_ratios = [i for i, parameter in enumerate(free) if parameter.block == "ratios"]
        if of_ratios:
            places = [free[i].place for i in of_ratios]
            root = _root(self, tuple(places))
            A[np.ix_(of_ratios, of_ratios)] = root
            e[of_ratios] = root @ (self.mean[places] - estimate.vector[places])
        for i, parameter in enumerate(free):
            if parameter.block != "ratios" and parameter.amplitude:
                std = self.std(parameter)
                A[i, i], e[i] = 1.0 / std, -parameter.read(estimate) / std
        return A, e

    def absorbed(
        self,
        space: ColumnSpace,
        estimate: Estimate,
        free: Sequence[FreeParameter],
        rows: tuple[Array, Array],
    ) -> Flags:
        """Return the (free,) mask of the amplitudes that the preceding unknowns absorb.

        The order of the unknowns is initial states, ratios, zeros of encoders, amplitudes. The information about an
        amplitude is what remains if all preceding unknowns are fitted, with their priors. The amplitude is absorbed if
        the recordings contain less information about it than its own prior.

        An amplitude of zero, whose effect is not in the model yet, is also absorbed if its column is almost zero after
        the preceding columns are projected out. This rule does not apply to other amplitudes, because a torque and the
        ratios may share only the unknown scale.

        Args:
            space: inner products of the derivatives, with initial states projected out
            estimate: estimate of the linearisation
            free: the free parameters
            rows: (n, free) A and (n,) e of the prior at the estimate: `rows` times the square root of w
        """
        amplitudes = np.array([p.block == "effects" and p.amplitude for p in free], dtype=np.bool_)
        if not amplitudes.any():
            return amplitudes
        order = sorted(range(len(free)), key=lambda i: free[i].block == "effects")
        A, e = rows
        with_prior, least = space.with_prior(A, e), np.where(amplitudes, np.diag(A) ** 2, 0.0)
        unseen = with_prior.unabsorbed(order) / with_prior.scale**2 - least < least
        new = np.array([p.read(estimate) == 0.0 for p in free], dtype=np.bool_)
        unseen |= new & (space.unabsorbed(order) <= STRENGTH.absorbed**2)
        return amplitudes & unseen

    def std(self, parameter: FreeParameter) -> float:
        """Return the prior standard deviation of one unknown."""
        if parameter.block == "ratios":
            return float(self.covariance[parameter.place, parameter.place] ** 0.5)
        if parameter.block == "zeros":
            return STRENGTH.zeros * ZERO_SIZE
        return float(STRENGTH.amplitude * self.limits[parameter.place - EFFECTS_BEGIN])


@lru_cache(maxsize=8)  # cached, because every step of a fit uses it
def _root(prior: Prior, places: tuple[int, ...]) -> Array:
    """Return the root W (n, n) of the inverse covariance of some unknowns: W^T W is the inverse covariance."""
    root = np.linalg.inv(np.linalg.cholesky(prior.covariance[np.ix_(places, places)]))
    return np.asarray(root, dtype=np.float64)


def prior_of(rig: Rig) -> Prior:
    """Return the prior of a rig file."""
    Z = rig.nominal
    whole = whole_parameters(Z, rig.L1, rig.g)
    mean = unknown_ratios(whole)
    std = np.maximum(parameter_std(rig), STRENGTH.floor * Z)
    J = unknown_jacobian(Z, rig) * std
    a, b, d, e1, c1, c2, _ = whole.tolist()
    e2 = d * rig.g / rig.L1
    covariance = J @ J.T
    critical = 2.0 * np.sqrt(np.array([(a + b + 2.0 * d) * (e1 + e2), b * e2])) / b
    covariance[FRICTION, FRICTION] += (STRENGTH.damping * critical) ** 2
    covariance[np.diag_indices_from(covariance)] *= (
        1.0 + 1e-6
    )  # avoids an exact relation of the ratios if some of the nine parameters are fixed
    limits = amplitude_limits(BaseParameters(a, b, d, e1, e2, c1, c2), rig_constants(rig))
    return Prior(mean, covariance, limits)


def parameter_std(rig: Rig) -> Array:
    """Return the (9,) prior standard deviation of each parameter.

    It follows from the measurement of the parameter, or from its bounds.
    """
    lower, upper = rig.bounds
    measured = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS])
    return np.where(rig.searched, (upper - lower) / np.sqrt(12), measured)


def unknown_jacobian(Z: Array, rig: Rig) -> Array:
    """Return the (7, 9) derivative of ratios, b and p/b with respect to the parameters."""
    b = base_jacobian(Z, rig.L1, rig.g)[_B]
    p = rig.L1**2 * np.eye(len(PARAMETERS))[PARAMETERS.index("m2")]
    *_, scale, on_elbow = unknown_ratios(whole_parameters(Z, rig.L1, rig.g))
    return np.vstack([ratio_jacobian(Z, rig.L1, rig.g), b, (p - on_elbow * b) / scale])

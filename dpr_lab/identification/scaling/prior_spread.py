"""Estimate the uncertainty of parameters that only the prior of the rig file determines.

The theory is in docs/theory.md, equation 56. Each of the nine parameters has a lognormal prior. Its median is the
measured value, or the nominal value without a measurement. The standard deviation of its logarithm is std / measured
for a measured value. Otherwise, it is that of a uniform distribution between the bounds, ln(upper / lower) / sqrt(12).
The ratios q of inertias and gravity, with the covariance C of their logarithms, then update this prior. For the inner
rod alone, q is e1/a of this rod. The update uses the logarithms z = ln Z of the parameters Z, with the prior mean z0
and covariance P0:

    K = P0 J^T (J P0 J^T + C)^-1,    z = z0 + K (ln q - ln q(z0)),    P = P0 - K J P0,    J = d ln q / d z

Ratios of friction are not used, because a missing effect changes them first. Ratios that are not positive are not used
either, because no positive masses have them. Masses, lengths and inertias are positive and enter as products. The
problem is therefore nearly linear in the logarithms, even for bounds that are a factor of ten apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, base_jacobian, base_parameters, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, alone_share, unknown_ratios
from dpr_lab.fitting.prior import unknown_jacobian
from dpr_lab.identification.model import EstimatedValue, ParameterValue
from dpr_lab.identification.scaling.scale import Interval90, Scale, lognormal90
from dpr_lab.rig import PARAMETERS, Rig


@dataclass(frozen=True, slots=True)
class PriorSettings:
    """Settings for updating the prior by the ratios."""

    ratio_std: float = 1e-3
    """Minimum relative standard deviation of the ratios; it is about the change due to a missing effect."""
    longest_step: float = 0.5
    """Maximum change of a logarithm in one iteration."""
    converged: float = 1e-9
    """Maximum change of a logarithm in the last iteration."""


SETTINGS = PriorSettings()

_A, _B, _E1 = (BASE.index(name) for name in ("a", "b", "e1"))


def relative_std(interval90: Interval90) -> float:
    """Return the relative standard deviation of a ratio from its 90 % interval, at least `SETTINGS.ratio_std`."""
    low, high = interval90
    return max(SETTINGS.ratio_std, (high - low) / max(NORMAL_Q90 * abs(low + high), 1e-9))


@dataclass(frozen=True, slots=True)
class Posterior:
    """Lognormal distribution of the nine parameters, given the ratios that recordings determine."""

    median: Array
    """(9,) most probable parameters."""
    covariance: Array
    """(9, 9) covariance of their logarithms."""
    rig: Rig
    """Rig file of the prior."""
    visible: Sequence[int] | None
    """Indices in `UNKNOWN_RATIOS` that the recordings determine; None: the five ratios."""
    alone: bool
    """Whether only the inner rod is mounted. The scale is then its inertia a."""
    share: float
    """Inertia of the scale over b: a/b of the inner rod alone, otherwise 1."""

    def determines(self, ratio: str) -> bool:
        """Check whether the recordings determine a ratio."""
        return ratio in RATIOS and (self.visible is None or RATIOS.index(ratio) in self.visible)

    def inertia(self) -> tuple[float, float]:
        """Return the median of the inertia of the scale, and the standard deviation of its logarithm."""
        return self._moments(_A if self.alone else _B, self.alone)

    def _moments(self, place: int, alone: bool) -> tuple[float, float]:
        value, slopes = _base(self.median, self.rig, alone)
        return float(value[place]), float(np.sqrt(slopes[place] @ self.covariance @ slopes[place]))

    def of_base(self, place: int, value: float, alone: bool) -> Interval90:
        """Return the 90 % interval of a base parameter, extended to the value in use."""
        lower, upper = (_base(edge, self.rig, alone)[0][place] for edge in _edges(self.rig))
        return _interval(*self._moments(place, alone), lower, upper, value)


def scale_of(b: ParameterValue, posterior: Posterior) -> Scale:
    """Return the scale of absolute sizes from the rig file, for a value of b and its source.

    For the inner rod alone, the interval is that of its inertia a, converted to b by the ratio.
    """
    share, alone = posterior.share, posterior.alone
    low, high = posterior.of_base(_A if alone else _B, share * b.value, alone)
    return Scale(
        b=b.value, interval90=(low / share, high / share), fixed_by="bound" if b.fixed_by == "bound" else "measured"
    )


def with_intervals(
    nine: Mapping[str, ParameterValue],
    base: Mapping[str, ParameterValue],
    ratios: Mapping[str, EstimatedValue],
    scale: Scale,
    posterior: Posterior,
) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
    """Add 90 % intervals to the nine rig parameters and to the base parameters.

    The intervals include the uncertainty of the scale.

    Args:
        nine: values of the nine rig parameters
        base: the six absolute base parameters
        ratios: ratios with their intervals
        scale: assumed scale of absolute values
        posterior: distribution of the parameters
    """
    loose = loose90(np.array([parameter.value for parameter in nine.values()]), scale.b, posterior)
    absolute = {}
    for place, name in enumerate(BASE):
        interval = _of_std(base[name])
        if interval is None and not posterior.alone and posterior.determines(f"{name}/b"):
            low, high = ratios[f"{name}/b"].interval90
            interval = scale.absolute90(base[name].value, (scale.b * low, scale.b * high))
        absolute[name] = interval or loose.get(name) or posterior.of_base(place, base[name].value, alone=False)
    if not posterior.alone:
        absolute["b"] = scale.interval90
    parameters = {
        name: parameter.model_copy(update={"interval90": _of_std(parameter) or absolute.get(name) or loose[name]})
        for name, parameter in nine.items()
    }
    return parameters, {name: base[name].model_copy(update={"interval90": absolute[name]}) for name in BASE}


def loose90(Z: Array, b: float, posterior: Posterior) -> dict[str, Interval90]:
    """Compute the 90 % intervals of the parameters that are determined only by bounds.

    Args:
        Z: (9,) values in use, which the intervals contain
        b: value of b in use, kg m^2
        posterior: distribution of the parameters
    """
    inertia, std = posterior.inertia()
    lower, upper = _edges(posterior.rig)
    intervals = {}
    for i, name in enumerate(PARAMETERS):
        if posterior.determines(f"{name}/b"):  # friction: its ratio to the inertia is determined, the inertia is not
            low, high = lognormal90(inertia / (b * posterior.share) * Z[i], std)
            intervals[name] = (float(min(low, Z[i])), float(max(high, Z[i])))
        else:
            log_std = posterior.covariance[i, i] ** 0.5
            intervals[name] = _interval(posterior.median[i], log_std, lower[i], upper[i], Z[i])
    return intervals


def _of_std(value: ParameterValue) -> Interval90 | None:
    """Return the normal 90 % interval of a value that has a standard deviation.

    The result is None for a value that only bounds determine.
    """
    if value.std is None:
        return None
    reach = NORMAL_Q90 * value.std
    return value.value - reach, value.value + reach


def _interval(median: float, log_std: float, lower: float, upper: float, value: float) -> Interval90:
    """Clip a lognormal 90 % interval to the bounds.

    The interval is then extended to the value in use.
    """
    low, high = lognormal90(median, log_std)
    return float(min(max(low, lower), value)), float(max(min(high, upper), value))


def _edges(rig: Rig) -> Array:
    """Return the bounds (2, 9) of the parameters, extended to measured 90 % intervals."""
    reach = NORMAL_Q90 * np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS]) * ~rig.searched
    return rig.bounds + np.outer([-1.0, 1.0], reach)


def _base(Z: Array, rig: Rig, alone: bool) -> tuple[Array, Array]:
    """Return the base parameters (6,) and the derivatives (6, 9) of their logarithms by the logarithms of Z (9,).

    Those of the inner rod alone do not contain the mass of the outer rod.
    """
    mounted = np.where(np.array(PARAMETERS) == "m2", 0.0, Z) if alone else Z
    base = base_parameters(mounted, rig.L1, rig.g)
    return base, base_jacobian(mounted, rig.L1, rig.g) * mounted / np.maximum(base, 1e-30)[:, None]


def posterior_of(
    unknown: Array,
    rig: Rig,
    visible: Sequence[int] | None = None,
    *,
    alone: bool = False,
    ratio_std: float = SETTINGS.ratio_std,
) -> Posterior:
    """Compute the distribution of the parameters, given all determined ratios except friction.

    The inner rod alone determines only the ratio e1/a.

    Args:
        unknown: (7,) ratios, b and p/b, of which only the ratios are used
        rig: measured values, nominal values and bounds
        visible: as in `Posterior`
        alone: as in `Posterior`
        ratio_std: relative standard deviation of the ratios, for example of e1/a
    """
    share = alone_share(unknown) if alone else 1.0
    determined = range(len(RATIOS)) if visible is None else visible
    places = [i for i in (*range(len(RATIOS)), ON_ELBOW) if i in determined and i not in FRICTION]
    estimated = unknown[places]
    if alone:
        gravity = unknown[RATIOS.index("e1/b")] - unknown[ON_ELBOW] * rig.g / rig.L1
        estimated = np.array([gravity / share])
    possible = estimated > 0.0
    lower, upper = rig.bounds
    relative = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS]) / rig.nominal
    P0 = np.diag(np.where(rig.searched, np.log(upper / lower) / np.sqrt(12), relative) ** 2)
    z0 = z = np.log(rig.nominal)
    P = P0
    for _ in range(30):
        Z = np.exp(z)
        if alone:
            base, slopes = _base(Z, rig, alone)
            q, J = base[[_E1]] / base[_A], slopes[[_E1]] - slopes[_A]
        else:
            q = unknown_ratios(whole_parameters(Z, rig.L1, rig.g))[places]
            J = unknown_jacobian(Z, rig)[places] * Z / q[:, None]
        q, J = q[possible], J[possible]
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + ratio_std**2 * np.eye(len(q)), hermitian=True)
        P = P0 - K @ J @ P0
        step = z0 + K @ (np.log(estimated[possible] / q) - J @ (z0 - z)) - z
        z = z + np.clip(step, -SETTINGS.longest_step, SETTINGS.longest_step)
        if np.max(np.abs(step)) < SETTINGS.converged:
            break
    return Posterior(np.exp(z), P, rig, visible, alone, share)

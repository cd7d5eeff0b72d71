"""Update the prior of the rig file by the unknowns that recordings determine (docs/theory.md, equations 47 and 56).

A free swing determines five numbers. The nine parameters therefore form a four-dimensional family of equally good
values, and their prior selects among them. Each parameter has a lognormal prior. Its median is the measured value, or
the nominal value without a measurement. The standard deviation of its logarithm is std / measured for a measured value.
Otherwise, it is that of a uniform distribution between the bounds, ln(upper / lower) / sqrt(12). The estimates q of the
recordings, with the covariance C of their logarithms, update the logarithms z = ln Z of the parameters Z, with the
prior mean z0 and covariance P0 (iterated extended Kalman update):

    K = P0 J^T (J P0 J^T + C)^-1,    z = z0 + K (ln q - ln q(z) - J (z0 - z)),    P = P0 - K J P0,    J = d ln q / d z

q are the ratios to b, and b if a known mass makes it identifiable. For a single body, q are ratios to its inertia: to a
for the inner rod alone, and to that of both rods for an elbow clamped in all recordings. The logarithm is used for two
reasons. Masses, lengths and inertias are positive. They enter as products, so the problem is nearly linear in the
logarithms even for bounds that are a factor of ten apart; a normal prior between such bounds would be centred far above
the nominal value in its logarithm, and would shift the scale of all absolute sizes.

The prior of a friction coefficient that is not measured has no influence, because effects that the model lacks change
friction first. Ratios that are not positive are not used, because no positive masses have them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.base import (
    BASE,
    RATIOS,
    base_from_ratios,
    base_jacobian,
    base_parameters,
    ratio_jacobian,
    whole_parameters,
)
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE, STRAIGHT, alone_share, unknown_ratios, with_scale
from dpr_lab.fitting.prior import parameter_std, unknown_jacobian
from dpr_lab.identification.model import EstimatedValue, ParameterValue
from dpr_lab.identification.scaling.scale import Interval90, Scale, lognormal90
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class PriorSettings:
    """Settings for updating the prior by the recordings."""

    friction_std: float = 10.0
    """Prior standard deviation of the logarithm of a friction coefficient that only the recordings determine."""
    longest_step: float = 0.5
    """Maximum change of a logarithm in one iteration."""
    converged: float = 1e-11
    """Maximum change of a logarithm in the last iteration."""


SETTINGS = PriorSettings()

UNREACHED = 1e-6
"""Maximum relative change of a parameter in the null space for which the parameter counts as determined.

The limit is far above rounding errors.
"""

_INNER, _COUPLING, _GRAVITY = (RATIOS.index(name) for name in ("a/b", "d/b", "e1/b"))
_B = BASE.index("b")
_OF_FRICTION = [PARAMETERS.index(RATIOS[i].partition("/")[0]) for i in FRICTION]


@dataclass(frozen=True, slots=True)
class Posterior:
    """Lognormal distribution of the nine parameters, given the unknowns that recordings determine."""

    median: Array
    """(9,) most probable parameters."""
    covariance: Array
    """(9, 9) covariance of the logarithms of the parameters."""
    rig: Rig
    """Rig file of the prior."""
    unknown: Array
    """(7,) ratios, b and p/b of the fit."""
    visible: tuple[int, ...]
    """Indices in `UNKNOWN_RATIOS` of the unknowns that the recordings determine."""
    errors: Array
    """(n, n) covariance of the logarithms of the unknowns in `visible`, from the recordings alone."""
    alone: bool
    """Whether only the inner rod is mounted."""
    clamped: float | None
    """Result of `clamped_cosine` for the recordings."""

    @property
    def share(self) -> float:
        """Ratio of the inertia of the scale to b, from the ratios of the fit; 1 for two free rods."""
        return float(self.as_observed(with_scale(self.unknown, 1.0))[0][SCALE])

    def determines(self, ratio: str) -> bool:
        """Check whether the recordings determine a ratio."""
        return ratio in RATIOS and RATIOS.index(ratio) in self.visible

    @property
    def b(self) -> float:
        """Most probable inertia b, kg m^2, from the inertia of the scale and the ratios of the fit."""
        return self.inertia()[0] / self.share

    def as_observed(self, unknown: Array) -> tuple[Array, Array]:
        """Return `as_observed` of unknowns (7,) for the mounted rods."""
        return as_observed(unknown, self.rig, self.alone, self.clamped)

    def inertia(self) -> tuple[float, float]:
        """Return the median of the inertia of the scale, and the standard deviation of its logarithm."""
        value, slopes = self._inertia(self.median)
        return value, float(np.sqrt(max(slopes @ self.covariance @ slopes, 0.0)))

    def scale(self, b: float | None = None) -> Scale:
        """Return the scale of absolute sizes for a value of b; default: the most probable b.

        The interval is extended to this value. For an elbow that is clamped in all runs, sizes have the interval of the
        inertia of the whole body, because they are known relative to it.
        """
        b, share = b or self.b, self.share
        lower, upper = (self._inertia(edge)[0] for edge in _edges(self.rig)) if self.clamped is None else (0.0, np.inf)
        low, high = _interval(*self.inertia(), lower, upper, share * b)
        loose = self._loose(self._inertia(self.median)[1][None])[0]
        of_body = low / share, high / share
        of_b = of_body if self.clamped is None else self._of_base(_B, b)
        sizes90 = None if self.clamped is None else of_body
        fixed_by = "data" if SCALE in self.visible else "bound" if loose else "measured"
        return Scale(b=b, interval90=of_b, fixed_by=fixed_by, sizes90=sizes90)

    def parameters(
        self, scale: Scale, ratios: Mapping[str, EstimatedValue]
    ) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
        """Return the nine rig parameters and the six base parameters at a scale, with their 90 % intervals.

        The nine parameters are the most probable ones with the inertia b in use. The base parameters are this b times
        the ratios of the fit. The intervals include the uncertainty of the scale.

        Args:
            scale: inertia b in use
            ratios: the five ratios with their intervals
        """
        Z, loose90 = self.values(scale.b), self.intervals(scale.b)
        _, slopes = _base(Z, self.rig)
        base = scale.b * base_from_ratios(self.unknown[: len(RATIOS)])  # an exported model must follow the fit
        absolute = {}
        for i, name in enumerate(BASE):
            value = float(base[i])
            of_body = self.clamped in (1.0, -1.0) and name == "e1"  # only the gravity of the whole body is determined
            determined = self.determines(f"{name}/b") and (not self.alone or value == 0.0) and not of_body
            if name == "b" and not self.alone and self.clamped is None:
                wide = scale.interval90
            elif determined:
                low, high = ratios[f"{name}/b"].interval90
                wide = scale.absolute90(value, (scale.b * low, scale.b * high))
            else:
                low, high = loose90.get(name) or self._of_base(i, value)
                wide = (min(low, value), max(high, value))  # the ratio that the fit assumed may be outside
            absolute[name] = self._value(value, slopes[i], wide)
        nine = {
            name: self._value(
                float(Z[i]), row, (absolute[name].interval90 if name in absolute else None) or loose90[name]
            )
            for i, (name, row) in enumerate(zip(PARAMETERS, np.eye(len(PARAMETERS)), strict=True))
        }
        for name, ratio in ratios.items():
            if scale.known and ratio.value == 0.0 and ratio.fixed_by == "data" and self.determines(name):
                update, friction = {"std": scale.b * ratio.std, "fixed_by": "data"}, name.partition("/")[0]
                absolute[friction] = absolute[friction].model_copy(update=update)
                nine[friction] = nine[friction].model_copy(update=update)
        for name in np.array(PARAMETERS)[~self.rig.searched].tolist():
            nine[name] = nine[name].model_copy(update={"fixed_by": "measured"})
        return nine, absolute

    def values(self, b: float) -> Array:
        """Return the most probable nine parameters (9,) with the ratios of the fit and a given inertia b."""
        unknown, visible = self.unknown.copy(), self.visible
        unknown[SCALE] = b
        assumed = [SCALE]
        if not self.alone:
            whole = set(range(len(RATIOS))) <= set(visible)
            assumed += [i for i in (*range(len(RATIOS)), *([] if whole else [ON_ELBOW])) if i not in visible]
        places = [i for i in visible if i != SCALE] + assumed
        C = np.zeros((len(places), len(places)))
        n = len(places) - len(assumed)
        of_ratios = [k for k, i in enumerate(visible) if i != SCALE]
        C[:n, :n] = self.errors[np.ix_(of_ratios, of_ratios)]
        values = self.as_observed(unknown)[0][places]
        Z, _ = _updated(values, C, places, self.rig, self.alone, self.clamped)
        for parameter, place in zip(_OF_FRICTION, FRICTION, strict=True):
            if place in places and unknown[place] <= 0.0:
                Z[parameter] = 0.0
        return Z

    def intervals(self, b: float) -> dict[str, Interval90]:
        """Compute the 90 % intervals of the nine parameters, extended to include their values at the inertia b in use.

        Only the interval of a friction coefficient that the recordings determine may exceed the bounds of the rig file.
        """
        Z, (lower, upper) = self.values(b), _edges(self.rig)
        spreads = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        intervals = {}
        for i, name in enumerate(PARAMETERS):
            edges = (0.0, np.inf) if self.determines(f"{name}/b") else (lower[i], upper[i])
            intervals[name] = _interval(self.median[i], spreads[i], *edges, Z[i])
        return intervals

    def _value(self, value: float, slopes: Array, wide: Interval90) -> ParameterValue:
        """Return a value with its interval, from the derivatives (9,) of its logarithm.

        The derivatives are those with respect to the logarithms of the parameters. The interval `wide` is used if only
        the bounds of the rig file determine the value, or for a friction of zero, which has no logarithm. The
        source of a friction of zero is set in `parameters`.
        """
        if value == 0.0 or self._loose(slopes[None])[0]:
            return ParameterValue(value=value, std=None, fixed_by="bound", interval90=wide)
        std = value * float(np.sqrt(max(slopes @ self.covariance @ slopes, 0.0)))
        reach = NORMAL_Q90 * std
        return ParameterValue(value=value, std=std, fixed_by="data", interval90=(value - reach, value + reach))

    def _loose(self, slopes: Array) -> Flags:
        """Check whether quantities depend on a direction that neither recordings nor measured values determine.

        `slopes` (n, 9) are the derivatives of their logarithms with respect to the logarithms of the parameters.
        """
        _, rows = observed(self.median, self.rig, self.visible, self.alone, self.clamped)
        free = self.rig.searched
        _, sizes, directions = np.linalg.svd(rows[:, free])
        null = directions[np.count_nonzero(sizes > 1e-9 * sizes.max(initial=0.0)) :].T
        return np.asarray((np.abs(slopes[:, free] @ null) > UNREACHED).any(axis=1))

    def _inertia(self, Z: Array) -> tuple[float, Array]:
        """Return the inertia of the scale, and the derivatives (9,) of its logarithm."""
        value, slopes = observed(Z, self.rig, [SCALE], self.alone, self.clamped)
        return float(value[0]), slopes[0]

    def _of_base(self, place: int, value: float) -> Interval90:
        """Return the 90 % interval of a base parameter, extended to include its value in the model."""
        lower, upper = (_base(edge, self.rig)[0][place] for edge in _edges(self.rig))
        medians, slopes = _base(self.median, self.rig)
        std = float(np.sqrt(max(slopes[place] @ self.covariance @ slopes[place], 0.0)))
        return _interval(float(medians[place]), std, lower, upper, value)


def posterior_of(
    unknown: Array,
    rig: Rig,
    visible: Sequence[int] | None = None,
    covariance: Array | None = None,
    *,
    alone: bool = False,
    clamped: float | None = None,
) -> Posterior:
    """Compute the distribution of the parameters, given the unknowns that recordings determine (equation 47).

    The module docstring states the equation and the reasons for a lognormal distribution.

    Args:
        unknown: (7,) ratios, b and p/b of a fit
        rig: measured values, nominal values and bounds
        visible: indices in `UNKNOWN_RATIOS` of the unknowns that the recordings determine; None: all that the
            mounting determines
        covariance: (n, n) covariance of these unknowns; None: zero
        alone: whether only the inner rod is mounted; its ratios to a are then used
        clamped: value of `clamped_cosine`; the ratios to the inertia of the whole body are used unless it is None
    """
    of_body = (_GRAVITY, FRICTION[0]) if alone or clamped in (1.0, -1.0) else (_COUPLING, _GRAVITY, FRICTION[0])
    of_rods = of_body if alone or clamped is not None else range(len(RATIOS))
    places = list(of_rods if visible is None else visible)
    values, slopes = as_observed(unknown, rig, alone, clamped)
    values, slopes = values[places], slopes[np.ix_(places, places)]
    errors = np.zeros((len(places), len(places)))
    if covariance is not None:
        per = np.maximum(np.abs(values), 1e-12)
        errors = slopes @ covariance @ slopes.T / np.outer(per, per)
    median, P = _updated(values, errors, places, rig, alone, clamped)
    return Posterior(median, P, rig, unknown, tuple(places), errors, alone, clamped)


def clamped_cosine(setups: Iterable[Setup]) -> float | None:
    """Return the cosine of the elbow's angle if the elbow is clamped in all runs.

    It is exactly 1 or -1 for aligned rods, and 0 for several angles, which determine ratios to a + b. It is None if the
    elbow is free in some runs, or if a rod is not mounted.
    """
    runs = list(setups)
    if not runs or any(run.mounting != "clamped" or run.inner is not None for run in runs):
        return None
    angles = {run.elbow for run in runs}
    cosine = math.cos(angles.pop()) if len(angles) == 1 else 0.0
    return float(round(cosine)) if 1.0 - cosine**2 <= STRAIGHT**2 else cosine


def as_observed(unknown: Array, rig: Rig, alone: bool, clamped: float | None = None) -> tuple[Array, Array]:
    """Return the unknowns (7,) as recordings of the mounted rods determine them.

    For a single body, d/b, e1/b and c1/b become ratios to its inertia I about joint 1, and b becomes I. For the inner
    rod alone, I = a - p and e1 is that of this rod. For an elbow clamped at delta, I = a + b + 2 d cos(delta). If the
    rods are aligned, e1 becomes the gravity of the whole body, e1 + cos(delta) d g / L1.

    Returns:
        the quantities, and their derivatives (7, 7) with respect to the unknowns
    """
    values, slopes = unknown.copy(), np.eye(len(unknown))
    if not alone and clamped is None:
        return values, slopes
    cosine, per_length = clamped or 0.0, rig.g / rig.L1
    if alone:
        share, of_share = alone_share(unknown), slopes[_INNER] - slopes[ON_ELBOW]
        carried, factor = ON_ELBOW, -per_length
    else:
        share = unknown[_INNER] + 1.0 + 2.0 * cosine * unknown[_COUPLING]
        of_share = slopes[_INNER] + 2.0 * cosine * slopes[_COUPLING]
        carried, factor = _COUPLING, cosine * per_length if abs(cosine) == 1.0 else 0.0
    values[_GRAVITY] += factor * unknown[carried]
    slopes[_GRAVITY, carried] = factor
    of_body = [_COUPLING, _GRAVITY, FRICTION[0]]
    values[of_body] /= share
    slopes[of_body] = (slopes[of_body] - np.outer(values[of_body], of_share)) / share
    values[SCALE] *= share
    slopes[SCALE] = share * slopes[SCALE] + unknown[SCALE] * of_share
    return values, slopes


def observed(Z: Array, rig: Rig, places: Sequence[int], alone: bool, clamped: float | None) -> tuple[Array, Array]:
    """Return the quantities of `as_observed` with the indices `places`, for parameters Z (9,).

    Returns:
        the quantities (n,), and the derivatives (n, 9) of their logarithms with respect to the logarithms of Z
    """
    values, slopes = as_observed(unknown_ratios(whole_parameters(Z, rig.L1, rig.g)), rig, alone, clamped)
    of_parameters, values = (slopes @ unknown_jacobian(Z, rig))[list(places)], values[list(places)]
    return values, of_parameters * Z / np.maximum(np.abs(values), 1e-30)[:, None]


def _updated(
    values: Array, errors: Array, places: Sequence[int], rig: Rig, alone: bool, clamped: float | None
) -> tuple[Array, Array]:
    """Update the prior of the rig file by the quantities of `as_observed` (equation 47).

    Args:
        values: (n,) quantities
        errors: (n, n) covariance of their logarithms
        places: indices in `UNKNOWN_RATIOS` of the quantities
        rig: measured values, nominal values and bounds
        alone: whether only the inner rod is mounted
        clamped: value of `clamped_cosine`

    Returns:
        (9,) median of the parameters, and (9, 9) covariance of their logarithms
    """
    lower, upper = rig.bounds
    relative = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS]) / rig.nominal
    std = np.where(rig.searched, np.log(upper / lower) / np.sqrt(12), relative)
    for parameter, place in zip(_OF_FRICTION, FRICTION, strict=True):
        if place in places and rig.searched[parameter]:
            std[parameter] = SETTINGS.friction_std
    possible = values > 0.0
    values, C, chosen = values[possible], errors[np.ix_(possible, possible)], np.array(places, dtype=int)[possible]
    z0 = z = np.log(rig.nominal)
    P0 = P = np.diag(std**2)
    for _ in range(60):
        q, J = observed(np.exp(z), rig, chosen.tolist(), alone, clamped)
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + C, hermitian=True)
        P = P0 - K @ J @ P0
        # the gravity of folded rods may change its sign and then has no logarithm: linear until the sign is correct
        change = np.where(q > 0.0, np.log(values / np.abs(q)), (values - q) / np.abs(q))
        step = z0 + K @ (change - J @ (z0 - z)) - z
        z = z + np.clip(step, -SETTINGS.longest_step, SETTINGS.longest_step)
        if np.max(np.abs(step)) < SETTINGS.converged:
            break
    return np.exp(z), P


def _interval(median: float, log_std: float, lower: float, upper: float, value: float) -> Interval90:
    """Clip a lognormal 90 % interval to the bounds, then extend it to include a value."""
    low, high = lognormal90(median, log_std)
    return float(min(max(low, lower), value)), float(max(min(high, upper), value))


def _edges(rig: Rig) -> Array:
    """Return the bounds (2, 9) of the parameters, extended to measured 90 % intervals."""
    reach = NORMAL_Q90 * np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS]) * ~rig.searched
    return rig.bounds + np.outer([-1.0, 1.0], reach)


def _base(Z: Array, rig: Rig) -> tuple[Array, Array]:
    """Return the base parameters (6,) and the derivatives (6, 9) of their logarithms with respect to those of Z."""
    base = base_parameters(Z, rig.L1, rig.g)
    return base, base_jacobian(Z, rig.L1, rig.g) * Z / np.maximum(base, 1e-30)[:, None]


def prior_ratio_std(rig: Rig) -> list[float]:
    """Compute the standard deviations (5,) of the ratios that follow from the rig file alone."""
    J = ratio_jacobian(rig.nominal, rig.L1, rig.g) * parameter_std(rig)
    return np.sqrt(np.sum(J**2, axis=1)).tolist()

"""Estimate the uncertainty of parameters that only the prior of the rig file determines.

The theory is in docs/theory.md, equation 56. Each of the nine parameters has a lognormal prior. Its median is the
measured value, or the nominal value without a measurement. The standard deviation of its logarithm is std / measured
for a measured value. Otherwise, it is that of a uniform distribution between the bounds, ln(upper / lower) / sqrt(12).
The ratios q of inertias and gravity, with the covariance C of their logarithms, then update this prior. The update uses
the logarithms z = ln Z of the parameters Z, with the prior mean z0 and covariance P0:

    K = P0 J^T (J P0 J^T + C)^-1,    z = z0 + K (ln q - ln q(z0)),    P = P0 - K J P0,    J = d ln q / d z

Ratios of friction are not used, because a missing effect changes them first. Masses, lengths and inertias are positive
and enter as products. The problem is therefore nearly linear in the logarithms, even for bounds that are a factor of
ten apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, base_jacobian, base_parameters, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE, unknown_ratios
from dpr_lab.fitting.prior import unknown_jacobian
from dpr_lab.identification.model import EstimatedValue, ParameterValue
from dpr_lab.identification.scaling.scale import Interval90, Scale, lognormal90
from dpr_lab.rig import PARAMETERS, Rig


@dataclass(frozen=True, slots=True)
class PriorSettings:
    """Settings for updating the prior by the ratios."""

    ratio_std: float = 1e-3
    """Relative standard deviation of the ratios; it is about the change due to a missing effect."""
    longest_step: float = 0.5
    """Maximum change of a logarithm in one iteration."""
    converged: float = 1e-9
    """Maximum change of a logarithm in the last iteration."""


SETTINGS = PriorSettings()

_B = BASE.index("b")


def scale_of(b: ParameterValue, unknown: Array, rig: Rig, visible: Sequence[int] | None = None) -> Scale:
    """Compute the scale of absolute sizes from the rig file.

    Args:
        b: value of b in use, and its source
        unknown: (7,) ratios, b and p/b, of which only the ratios are used
        rig: measured values, nominal values and bounds
        visible: indices in `UNKNOWN_RATIOS` that the recordings determine; default: the five ratios
    """
    Z, P = _posterior(unknown, rig, visible)
    base = base_parameters(Z, rig.L1, rig.g)[_B]
    slopes = base_jacobian(Z, rig.L1, rig.g)[_B] * Z / base
    std = float(np.sqrt(slopes @ P @ slopes))
    lower, upper = (float(base_parameters(edge, rig.L1, rig.g)[_B]) for edge in _edges(rig))
    interval = _interval(float(base), std, lower, upper, b.value)
    return Scale(b=b.value, interval90=interval, fixed_by="bound" if b.fixed_by == "bound" else "measured")


def with_intervals(
    nine: Mapping[str, ParameterValue],
    base: Mapping[str, ParameterValue],
    ratios: Mapping[str, EstimatedValue],
    scale: Scale,
    unknown: Array,
    rig: Rig,
    visible: Sequence[int] | None = None,
) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
    """Add 90 % intervals to the nine rig parameters and to the base parameters.

    The intervals include the uncertainty of the scale.

    Args:
        nine: values of the nine rig parameters
        base: the six absolute base parameters
        ratios: ratios with their intervals
        scale: assumed scale of absolute values
        unknown: (7,) ratios, b and p/b
        rig: measured values, nominal values and bounds
        visible: as in `scale_of`
    """
    absolute = {"b": base["b"].model_copy(update={"interval90": scale.interval90})}
    for name in BASE:
        if name != "b":
            ends = (scale.b * ratios[f"{name}/b"].interval90[0], scale.b * ratios[f"{name}/b"].interval90[1])
            interval = _of_std(base[name]) or scale.absolute90(base[name].value, ends)
            absolute[name] = base[name].model_copy(update={"interval90": interval})
    loose = loose90(np.array([parameter.value for parameter in nine.values()]), unknown, rig, visible)
    parameters = {
        name: parameter.model_copy(
            update={"interval90": _of_std(parameter) or (absolute.get(name) or parameter).interval90 or loose[name]}
        )
        for name, parameter in nine.items()
    }
    return parameters, {name: absolute[name] for name in BASE}


def loose90(Z: Array, unknown: Array, rig: Rig, visible: Sequence[int] | None = None) -> dict[str, Interval90]:
    """Compute the 90 % intervals of the parameters that are determined only by bounds.

    Args:
        Z: (9,) values in use, which the intervals contain
        unknown: (7,) ratios, b and p/b
        rig: measured values, nominal values and bounds
        visible: as in `scale_of`
    """
    median, P = _posterior(unknown, rig, visible)
    lower, upper = _edges(rig)
    b = base_parameters(median, rig.L1, rig.g)[_B]
    slopes = base_jacobian(median, rig.L1, rig.g)[_B] * median / b
    scale_std = np.sqrt(slopes @ P @ slopes)
    intervals = {}
    for i, name in enumerate(PARAMETERS):
        if name in BASE:  # friction: its ratio to b is determined, but b is not
            low, high = lognormal90(float(b / unknown[SCALE] * Z[i]), float(scale_std))
            intervals[name] = (float(min(low, Z[i])), float(max(high, Z[i])))
        else:
            intervals[name] = _interval(median[i], P[i, i] ** 0.5, lower[i], upper[i], Z[i])
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


def _posterior(unknown: Array, rig: Rig, visible: Sequence[int] | None) -> tuple[Array, Array]:
    """Compute the most probable parameters (9,) and the covariance (9, 9) of their logarithms.

    All ratios except friction are given.
    """
    determined = range(len(RATIOS)) if visible is None else visible
    places = [i for i in (*range(len(RATIOS)), ON_ELBOW) if i in determined and i not in FRICTION]
    lower, upper = rig.bounds
    relative = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS]) / rig.nominal
    P0 = np.diag(np.where(rig.searched, np.log(upper / lower) / np.sqrt(12), relative) ** 2)
    z0 = z = np.log(rig.nominal)
    P = P0
    for _ in range(30):
        Z = np.exp(z)
        q = unknown_ratios(whole_parameters(Z, rig.L1, rig.g))[places]
        J = unknown_jacobian(Z, rig)[places] * Z / q[:, None]
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + SETTINGS.ratio_std**2 * np.eye(len(places)), hermitian=True)
        P = P0 - K @ J @ P0
        step = z0 + K @ (np.log(unknown[places] / q) - J @ (z0 - z)) - z
        z = z + np.clip(step, -SETTINGS.longest_step, SETTINGS.longest_step)
        if np.max(np.abs(step)) < SETTINGS.converged:
            break
    return np.exp(z), P

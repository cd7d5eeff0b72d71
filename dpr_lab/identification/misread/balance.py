r"""Energy test: whether angles and times of a table can be a free swing of the rig.

With the base parameters a, b, d, e1 and the viscous coefficients c1, c2 (docs/theory.md) the energy

    E = a w1^2 / 2 + b w2^2 / 2 + d cos(th1 - th2) w1 w2 + e1 cos(th1) + (d g / L1) cos(th2)

changes by viscous friction, dE = -(c1 w1^2 + c2 (w2 - w1)^2) dt; known torques add tau1 w1 + tau2 (w2 - w1). All
coefficients enter linearly. A least-squares fit within bounds about the rig file's values has a small residual if
angles and times are interpreted correctly, and a large one otherwise. It needs neither an initial state nor a
simulation.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.fitting.projection import RIDGE, bounded_solution
from dpr_lab.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EnergySettings:
    """Settings of the energy test."""

    looked_at_s: float = 10.0
    """Examined duration of a table, s; a wrong interpretation is wrong from the start."""
    looked_at: int = 2000
    """Minimum number of rows, because the unit of time may be wrong."""
    fewest: int = 30
    """Minimum number of samples for a judgement."""
    instants: int = 1500
    """Maximum number of samples at which the energy is compared."""
    window: tuple[int, int] = (7, 51)
    """Minimum and maximum number of samples of the local cubic polynomials for velocities."""
    window_share: float = 1 / 16
    """Length of these polynomials relative to the period of the faster oscillation; also suitable for a rod that
    turns five times as fast.
    """
    slack: float = 3.0
    """Factor by which a base parameter may differ from the value of the rig file."""
    zeros: int = 18
    """Number of zeros per turn that are tried for each rod."""
    refined: int = 5
    """Number of pairs of zeros that are refined, the best first."""
    zero_rows: int = 800
    """Number of rows used in the search for zeros."""
    friction: float = 100.0
    """Factor by which a viscous coefficient, which is poorly known, may exceed the value of the rig file."""


ENERGY = EnergySettings()


@dataclass(frozen=True, slots=True)
class EnergyFit:
    """Energy balance of one interpretation of a table."""

    residual: float
    """Rms error of the energy balance, relative to the exchanged potential energy."""
    time_scale: float
    """Factor for the times that balances the exchange of kinetic and potential energy, 1 if correct; nan without
    exchange.
    """
    kinetic_scale: float
    """The same from the magnitudes of both energies, also for driven rods; accurate to a factor of about ten."""


def periods(rig: Rig) -> tuple[float, float]:
    """Periods of the two small oscillations about hanging with the values of the rig file, longer first, s."""
    a, b, d, e1, *_ = base_parameters(rig.nominal, rig.L1, rig.g).tolist()
    squares = np.linalg.eigvals(np.linalg.solve([[a, d], [d, b]], np.diag([e1, d * rig.g / rig.L1])))
    return tuple(sorted((2 * np.pi / np.sqrt(np.abs(squares))).tolist(), reverse=True))  # type: ignore[return-value]


def energy_fit(
    t: Array, rods: Array, torques: Array | None, rig: Rig, settings: EnergySettings = ENERGY
) -> EnergyFit | None:
    """Energy balance of one interpretation of a table; None if the motion is too small.

    Args:
        t: (n,) s
        rods: (n, 2) absolute angles, rad
        torques: (n, 2) known torques of the joints, N m; None for a free swing
        rig: the recorded rig
        settings: settings of the test
    """
    moving = _motion(t, rods, rig, settings)
    return None if moving is None else _balance(moving, torques, rig, settings)


def energy_zeros(t: Array, rods: Array, rig: Rig, settings: EnergySettings = ENERGY) -> tuple[float, float] | None:
    """Angles to add to both rods, within a turn, so that a free swing conserves its energy best; None without motion.

    Args:
        t: (n,) s
        rods: (n, 2) absolute angles, rad
        rig: the recorded rig
        settings: settings of the test
    """
    from scipy.optimize import minimize

    every = max(1, len(rods) // settings.zero_rows)
    moving = _motion(t[::every], rods[::every], rig, settings)
    if moving is None:
        return None

    def residual(added: Array) -> float:
        fit = _balance(replace(moving, rods=moving.rods + added), None, rig, settings)
        return np.inf if fit is None else fit.residual

    steps = np.arange(settings.zeros) * 2 * np.pi / settings.zeros
    starts = sorted((np.array(pair) for pair in product(steps, steps)), key=residual)[: settings.refined]
    best = min((minimize(residual, start, method="Nelder-Mead") for start in starts), key=lambda one: one.fun)
    inner, outer = np.remainder(best.x + np.pi, 2 * np.pi) - np.pi
    return float(inner), float(outer)


@dataclass(frozen=True, slots=True)
class _Motion:
    """Motion of the rods at the centres of windows."""

    near: NDArray[np.intp]
    """(k,) rows."""
    t: Array
    """(k,) s."""
    rods: Array
    """(k, 2) rad."""
    omega: Array
    """(k, 2) rad/s."""


def _motion(t: Array, rods: Array, rig: Rig, settings: EnergySettings) -> _Motion | None:
    with np.errstate(all="ignore"):
        try:
            moving = _velocities(t, rods, periods(rig)[1] * settings.window_share, settings)
        except np.linalg.LinAlgError:  # instants so uneven that they are numerically equal
            return None
    return None if moving is None or not all(np.isfinite(part).all() for part in moving) else _Motion(*moving)


def _balance(moving: _Motion, torques: Array | None, rig: Rig, settings: EnergySettings) -> EnergyFit | None:
    near, t, rods, omega = moving.near, moving.t, moving.rods, moving.omega
    base = base_parameters(rig.nominal, rig.L1, rig.g)
    a, b, d, e1, c1, c2 = base.tolist()
    (th1, th2), (w1, w2) = rods.T, omega.T
    kinetic = np.array([a * w1**2 / 2, b * w2**2 / 2, d * np.cos(th1 - th2) * w1 * w2])
    potential = np.array([e1 * np.cos(th1), d * rig.g / rig.L1 * np.cos(th2)])
    gained = [_integral(t, c1 * w1**2), _integral(t, c2 * (w2 - w1) ** 2)]
    if torques is not None:
        gained.append(-_integral(t, (torques[near] * np.column_stack([w1, w2 - w1])).sum(axis=1)))
    size = float(np.std(potential.sum(axis=0)))
    if not size > 0:
        return None
    columns = np.column_stack([kinetic[0], kinetic[1], kinetic[2] + potential[1], *gained])
    columns, target = columns - columns.mean(axis=0), potential[0].mean() - potential[0]
    residual = _bounded(columns / size, target / size, settings)
    scale = _time_scale(kinetic.sum(axis=0), potential.sum(axis=0))
    return EnergyFit(residual, scale, float(np.sqrt(np.mean(kinetic.sum(axis=0)) / size)))


def _bounded(columns: Array, target: Array, settings: EnergySettings) -> float:
    """Rms residual of a fit within the bounds, columns scaled by the values of the rig file."""
    driven = columns.shape[1] - 5
    least = [1 / settings.slack] * 3 + [0.0] * 2 + [1 / settings.slack] * driven
    most = [settings.slack] * 3 + [settings.friction] * 2 + [settings.slack] * driven
    H = columns.T @ columns
    x = bounded_solution(H + RIDGE * np.trace(H) * np.eye(len(H)), columns.T @ target, np.array(least), np.array(most))
    return float(np.sqrt(np.mean((columns @ x - target) ** 2)))


def _velocities(
    t: Array, rods: Array, length_s: float, settings: EnergySettings
) -> tuple[NDArray[np.intp], Array, Array, Array] | None:
    """Rows, times, angles and velocities at the centres of windows of about this length."""
    from numpy.lib.stride_tricks import sliding_window_view

    rows = max(settings.looked_at, int(np.searchsorted(t, t[0] + settings.looked_at_s)))
    t, rods = t[:rows], rods[:rows]
    if len(t) < settings.fewest:
        return None
    window = int(np.clip(length_s / float(np.median(np.diff(t))), *settings.window)) // 2 * 2 + 1
    every = -(-len(t) // settings.instants)
    if len(t) < settings.fewest + window:
        return None
    times, angles = (sliding_window_view(x, window, axis=0)[::every] for x in (t, rods))
    since = times - times.mean(axis=1, keepdims=True)
    reach = np.abs(since).max(axis=1)
    powers = (since / reach[:, None])[:, :, None] ** np.arange(4)
    across = powers.transpose(0, 2, 1)
    cubic = np.linalg.solve(across @ powers, across @ angles.transpose(0, 2, 1))
    near = np.arange(window // 2, len(t) - window // 2)[::every]
    return near, times.mean(axis=1), cubic[:, 0], cubic[:, 1] / reach[:, None]


def _integral(t: Array, power: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (power[1:] + power[:-1]) / 2)])


def _time_scale(kinetic: Array, potential: Array) -> float:
    """Factor of the times for which the sum of kinetic and potential energy decreases slowly; nan if there is none."""
    line = np.vander(np.linspace(-1, 1, len(kinetic)), 2)
    k, v = (x - line @ np.linalg.lstsq(line, x, rcond=None)[0] for x in (kinetic, potential))
    exchanged = -float(k @ v)
    return float(np.sqrt((k @ k) / exchanged)) if exchanged > 0 else np.nan

"""Energy balance of a table, which tests whether the table describes a free swing.

The energy of the rods is a function of the base parameters a, b, d, e1 (docs/theory.md):

    E = a w1^2 / 2 + b w2^2 / 2 + d cos(th1 - th2) w1 w2 + e1 cos(th1) + (d g / L1) cos(th2)

where th is an absolute angle and w = dth/dt. Viscous friction (c1, c2) and Coulomb friction (f1, f2) change it by

    dE = -(c1 w1^2 + c2 (w2 - w1)^2 + f1 |w1| + f2 |w2 - w1|) dt.

Air drag, whose power is proportional to |w|^3, may replace viscous friction (`residual_near`).

Known torques add the power tau1 w1 + tau2 (w2 - w1). Coulomb friction is included, because otherwise an error of the
zeros would compensate for its energy loss. All coefficients enter linearly and are fitted by least squares within
bounds around the values of the rig file. The residual is small if angles and times are interpreted correctly, and large
otherwise. The test needs neither an initial state nor a simulation. A single rod is represented by two equal halves
with the same angle (`dpr_lab.dynamics.base`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, without_turns
from dpr_lab.dynamics.base import base_of_run, whole_parameters
from dpr_lab.fitting.uncompiled import RIDGE, Loops, bounded_solution
from dpr_lab.identification.misread.local_motion import LocalMotion, LocalMotionSettings, local_motion, shows_a_period
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class EnergySettings:
    """Settings of the energy test."""

    motion: LocalMotionSettings = field(default=LocalMotionSettings(degree=3, window_share=1 / 16, window=(7, 51)))
    """Local polynomials for the velocities, with windows that are short enough for rods of five times the usual speed.
    """
    smooth: LocalMotionSettings = field(default=LocalMotionSettings(degree=3, window_share=1 / 4, window=(7, 201)))
    """Longer windows for noisy readings at usual speeds.

    The noise of a speed decreases with the power 1.5 of the window.
    """
    slack: float = 3.0
    """Maximum factor by which a fitted base parameter exceeds its value in the rig file, or is smaller."""
    zeros: int = 18
    """Number of zeros per turn that are tested for each rod."""
    refined: int = 5
    """Maximum number of local minima that are refined, lowest first."""
    zero_step_rad: float = 0.1
    """First step of the refinement of the zeros, rad."""
    zero_rows: int = 800
    """Number of rows of the table that are used in the search for zeros."""
    friction: float = 100.0
    """Maximum ratio of a viscous coefficient to its value in the rig file, which may be inaccurate."""
    dry: float = 0.5
    """Maximum Coulomb friction torque, relative to the gravity torque of the rods."""
    zero_error_rad: float = 0.1
    """Maximum zero error that may be a property of the rig, rad.

    Coulomb friction can hold a rod away from the vertical by this angle. A camera can also be tilted by this angle.
    """
    unexplained: tuple[float, float] = (0.3, 0.8)
    """Maximum residual of the balance without another force, for free and for driven swings.

    The Coulomb friction of geared drives on real rigs dissipates up to half of the exchanged energy.
    """
    exchanged: float = 0.9
    """Minimum correlation of kinetic and potential energy, after trend and friction are projected out.

    Above it, the time scale follows from both energies.
    """
    paces: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0, 0.5, 0.25, 0.125)
    """Tested speeds of a stored video, relative to its stated frame rate."""
    much_better: float = 0.6
    """Maximum ratio of the residual at another speed to the residual at the stated speed.

    Below this ratio, the other speed is probably right.
    """


ENERGY = EnergySettings()

Law = Literal["viscous", "drag"]
"""Law of the friction that increases with speed: in proportion to the speed (viscous) or to its square (drag)."""


@dataclass(frozen=True, slots=True)
class EnergyFit:
    """Energy balance of one interpretation of a table."""

    residual: float
    """Rms error of the energy balance, relative to the exchanged potential energy."""
    time_scale: float
    """Time scale factor at which kinetic and potential energy balance; 1 if the times are correct, nan if unknown."""
    kinetic_scale: float
    """Time scale factor from the sizes of both energies, accurate to a factor of ten.

    It is also valid for driven rods.
    """


def mounted_base(rig: Rig, Z: ArrayLike) -> Array:
    """Convert parameters (..., 9) to base parameters (..., 6) of the mounted rods."""
    whole = whole_parameters(Z, rig.L1, rig.g)
    return base_of_run(whole, Setup(mounting=rig.rods.mounting), rig.L1, rig.g)


def periods(rig: Rig) -> tuple[float, float]:
    """Return the periods of both small oscillations about the hanging position, longer first, s.

    They are computed from the rig file. For one degree of freedom, both periods are equal. A clamped elbow is assumed
    to be straight.
    """
    a, b, d, e1, *_ = mounted_base(rig, rig.nominal).tolist()
    e2 = d * rig.g / rig.L1
    if rig.rods.mounting != "both":
        period = 2 * np.pi * float(np.sqrt((a + b + 2 * d) / (e1 + e2)))
        return period, period
    squares = np.linalg.eigvals(np.linalg.solve([[a, d], [d, b]], np.diag([e1, e2])))
    return tuple(sorted((2 * np.pi / np.sqrt(np.abs(squares))).tolist(), reverse=True))  # type: ignore[return-value]


def energy_fit(t: Array, rods: Array, torques: Array | None, rig: Rig) -> EnergyFit | None:
    """Compute the energy balance of an interpretation, or None if the motion is too small.

    Args:
        t: (n,) s
        rods: (n, 2) absolute angles, rad
        torques: (n, 2) known torques of the joints, N m; None for a free swing
        rig: the recorded rig
    """
    terms = _terms_of_table(t, rods, torques, rig)
    if terms is None:
        return None
    kinetic, potential = terms[[0, 1, 2]].sum(axis=0), terms[[4, 6]].sum(axis=0)
    residual, size = _residual(np.cov(terms, bias=True), np.zeros(2)), float(potential.std())
    if not (np.isfinite(residual) and size > 0):
        return None
    losses = terms[8:] if torques is None else terms[:0]
    scale = _time_scale(kinetic, potential, losses) if shows_a_period(rods) else np.nan
    return EnergyFit(residual, scale, float(np.sqrt(kinetic.mean() / size)))


def energy_zeros(t: Array, rods: Array, rig: Rig, *, nearest: bool = False) -> tuple[float, float] | None:
    """Find the corrections of the zeros of both rods that give the best energy balance, rad.

    Their sizes are less than one turn. The result is None if the motion is too small.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        rig: the recorded rig
        nearest: whether to search only from corrections of zero
    """
    stride = max(1, len(rods) // ENERGY.zero_rows)
    terms = _terms_of_table(t[::stride], rods[::stride], None, rig)
    if terms is None:
        return None
    return best_zeros(partial(_residual, np.cov(terms, bias=True)), rig, nearest=nearest)


def residual_near(
    t: Array,
    rods: Array,
    torques: Array | None,
    rig: Rig,
    zero_error_rad: float = ENERGY.zero_error_rad,
    loops: Loops | None = None,
    *,
    limit: float | None = None,
) -> float:
    """Compute the residual of `energy_fit` after a small correction of the zeros.

    The result is infinite if the motion is too small. An error delta of a zero changes the potential energy of a small
    swing of amplitude A by the fraction delta / A. Both zeros are therefore moved towards the zeros with the smallest
    residual, by at most `zero_error_rad`. The residual is computed with short and with long windows. The smaller
    residual is returned, so that the noise of the readings has little influence. If it exceeds `limit`, air drag is
    tried in place of viscous friction; None: the limit for evidence of another force.

    `loops` is the compiled form of the bounded least squares; None: plain Python.
    """
    least, limit = math.inf, ENERGY.unexplained[torques is not None] if limit is None else limit
    for law in get_args(Law):
        for covariance in _balances(t, rods, torques, rig, law):
            residual = partial(_residual, covariance, loops=loops)
            added = best_zeros(residual, rig, nearest=True)
            least = min(least, residual(np.clip(added, -zero_error_rad, zero_error_rad)))
        if least <= limit:
            break
    return least


def other_pace(t: Array, rods: Array, rig: Rig) -> float:
    """Find the factor by which a free swing was faster than its stated times.

    The result is 1 unless another factor clearly improves the energy balance. The factor exceeds 1 for a slow-motion
    video, in which the camera recorded more frames per second than the video plays.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        rig: the recorded rig
    """
    balances = {pace: _balances(t / pace, rods, None, rig) for pace in ENERGY.paces}
    residuals = {
        pace: min((_residual(covariance, np.zeros(2)) for covariance in of_pace), default=math.inf)
        for pace, of_pace in balances.items()
    }
    best = min(residuals, key=lambda pace: residuals[pace])
    return best if residuals[best] < ENERGY.much_better * residuals[1.0] else 1.0


def best_zeros(residual: Callable[[Array], float], rig: Rig, *, nearest: bool = False) -> tuple[float, float]:
    """Find the two angles whose addition to the rod angles minimises a residual.

    The angles are less than one turn. Both angles are equal for one degree of freedom. The local minima on a grid of
    both angles are refined. Grid points with a lower neighbour are excluded, because a search from them would end in
    the same minimum as one from this neighbour.

    Args:
        residual: residual of a balance as a function of the (2,) added angles, rad
        rig: the recorded rig
        nearest: whether to search only from added angles of zero
    """
    from scipy.ndimage import minimum_filter
    from scipy.optimize import minimize

    joints = 2 if rig.rods.mounting == "both" else 1

    def of_joints(added: Array) -> float:
        return residual(np.broadcast_to(added, 2))

    steps = np.zeros(1) if nearest else np.arange(ENERGY.zeros) * 2 * np.pi / ENERGY.zeros
    grid = np.reshape([of_joints(np.array(zeros)) for zeros in product(steps, repeat=joints)], (len(steps),) * joints)
    minima = np.argwhere(grid == minimum_filter(grid, size=3, mode="wrap"))
    starts = steps[sorted(minima, key=lambda place: grid[tuple(place)])[: ENERGY.refined]]
    simplex = ENERGY.zero_step_rad * np.eye(joints + 1, joints)
    searches = (
        minimize(of_joints, start, method="Nelder-Mead", options={"initial_simplex": start + simplex})
        for start in starts
    )
    best = min(searches, key=lambda result: result.fun)
    inner, outer = np.broadcast_to(without_turns(best.x), 2).tolist()
    return inner, outer


def _balances(t: Array, rods: Array, torques: Array | None, rig: Rig, law: Law = "viscous") -> list[Array]:
    """Return the (m, m) covariance of the terms of the balance, with short and with long windows.

    A motion that is too small is omitted.
    """
    balances = (_terms_of_table(t, rods, torques, rig, motion, law) for motion in (ENERGY.motion, ENERGY.smooth))
    return [np.cov(terms, bias=True) for terms in balances if terms is not None]


def _terms_of_table(
    t: Array,
    rods: Array,
    torques: Array | None,
    rig: Rig,
    motion: LocalMotionSettings | None = None,
    law: Law = "viscous",
) -> Array | None:
    """Return the (m, k) terms of the balance of a table, or None if the motion is too small."""
    moving = local_motion(t, rods, periods(rig)[1], motion or ENERGY.motion)
    return None if moving is None else balance_terms(moving, torques, rig, law)


def balance_terms(moving: LocalMotion, torques: Array | None, rig: Rig, law: Law = "viscous") -> Array:
    """Return the terms (m, k) of the balance, J.

    They are computed with the values of the rig file. The terms are, in this order:

    - the kinetic energy of each rod
    - d w1 w2, multiplied by the cosine and by the sine of th1 - th2
    - e1, multiplied by the cosine and by the sine of th1; e2, multiplied by the cosine and by the sine of th2
    - the four energy losses
    - if the torques are known, their work with a negative sign
    """
    t, (th1, th2), (w1, w2) = moving.t, moving.rods.T, moving.omega.T
    a, b, d, e1, c1, c2 = mounted_base(rig, rig.nominal).tolist()
    e2, mixed = d * rig.g / rig.L1, d * w1 * w2
    weight = e1 + e2
    speeds, natural = np.abs([w1, w2 - w1]), 2 * np.pi / periods(rig)[0]
    losses = [c1 * speeds[0] ** 2, c2 * speeds[1] ** 2, *(weight * speeds)]
    if law == "drag":  # at most the gravity torque at the speed of a small swing with an amplitude of 1 rad
        losses[:2] = weight / (ENERGY.friction * natural**2) * speeds**3
    work = [] if torques is None else [-(torques[moving.near] * np.column_stack([w1, w2 - w1])).sum(axis=1)]
    return np.array(
        [
            a * w1**2 / 2,
            b * w2**2 / 2,
            *(mixed * np.cos(th1 - th2), mixed * np.sin(th1 - th2)),
            *(e1 * np.cos(th1), e1 * np.sin(th1)),
            *(e2 * np.cos(th2), e2 * np.sin(th2)),
            *(_integral(t, power) for power in (*losses, *work)),
        ]
    )


def _residual(covariance: Array, added: Array, loops: Loops | None = None) -> float:
    """Return the rms error of `fit_balance`."""
    return fit_balance(covariance, added, loops)[0]


def fit_balance(covariance: Array, added: Array, loops: Loops | None = None) -> tuple[float, Array]:
    """Fit the coefficients within bounds; return the rms error of the balance and the coefficients (7 or 8,).

    The error is relative to the potential energy. It is infinite if the potential energy does not change. If an
    angle is shifted, its cosine and sine become linear combinations of the original ones. The covariance of the
    original terms is therefore sufficient.

    Args:
        covariance: (m, m) covariance of `balance_terms`
        added: (2,) angles added to both rods, rad
        loops: compiled form of the bounded least squares; None: plain Python
    """
    inner, outer = added.tolist()
    driven = len(covariance) - 12
    columns, target, potential = np.zeros((len(covariance), 7 + driven)), *np.zeros((2, len(covariance)))
    columns[[0, 1], [0, 1]] = 1.0
    columns[2:4, 2] = math.cos(inner - outer), -math.sin(inner - outer)
    columns[6:8, 2] = potential[6:8] = math.cos(outer), -math.sin(outer)
    columns[8:, 3:] = np.eye(4 + driven)
    target[4:6] = -math.cos(inner), math.sin(inner)
    potential -= target
    size = float(potential @ covariance @ potential)
    if not size > 0:
        return np.inf, np.ones(7 + driven)
    H, gradient = (columns.T @ covariance @ x / size for x in (columns, target))
    x = coefficients(H, gradient, *coefficient_bounds(ENERGY.dry, driven), loops)
    square = float(target @ covariance @ target) / size + x @ H @ x - 2 * x @ gradient
    return math.sqrt(max(square, 0.0)), x


def coefficient_bounds(dry: float, driven: int) -> tuple[Array, Array]:
    """Return lower and upper bounds (7 or 8,) of the coefficients of a balance, relative to the rig file.

    The order is a, b, d, viscous friction (2), Coulomb friction (2), and known torques.

    Args:
        dry: maximum coefficient of Coulomb friction
        driven: 1 if the torques are known, otherwise 0
    """
    least = [1 / ENERGY.slack] * 3 + [0.0] * 4 + [1 / ENERGY.slack] * driven
    most = [ENERGY.slack] * 3 + [ENERGY.friction] * 2 + [dry] * 2 + [ENERGY.slack] * driven
    return np.array(least), np.array(most)


def coefficients(H: Array, gradient: Array, least: Array, most: Array, loops: Loops | None = None) -> Array:
    """Fit coefficients (n,) within bounds; a weak ridge keeps the normal equations regular."""
    return bounded_solution(H + RIDGE * np.trace(H) * np.eye(len(H)), gradient, least, most, loops)


def _integral(t: Array, power: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.diff(t) * (power[1:] + power[:-1]) / 2)])


def _time_scale(kinetic: Array, potential: Array, losses: Array) -> float:
    """Find the time scale factor s at which the total energy is conserved.

    With this factor, K / s^2 + V + x L + trend is constant, where x are unknown coefficients. The trend and the
    frictional losses L are projected out of K and V; then K and V are compared. The result is nan if hardly any energy
    is exchanged between K and V, for example because the losses are similar to K or V.

    Args:
        kinetic: (n,) K
        potential: (n,) V
        losses: (m, n) L, work of friction
    """
    line = np.column_stack([np.vander(np.linspace(-1, 1, len(kinetic)), 2), losses.T])
    size = np.maximum(np.abs(line).max(axis=0), np.finfo(float).tiny)
    kinetic_part, potential_part = (
        x - line / size @ np.linalg.lstsq(line / size, x, rcond=None)[0] for x in (kinetic, potential)
    )
    exchanged = -float(kinetic_part @ potential_part)
    correlated = exchanged > ENERGY.exchanged * float(
        np.sqrt((kinetic_part @ kinetic_part) * (potential_part @ potential_part))
    )
    return float(np.sqrt((kinetic_part @ kinetic_part) / exchanged)) if correlated else np.nan

"""One swing, by the classical Runge-Kutta rule at arbitrary instants."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.arm import CLAMPED, MODES, Arm, arm_accelerations, arm_constants
from dpr_lab.dynamics.schedule import MAX_STEP, steps_between
from dpr_lab.effects import SIZE, effect_torques
from dpr_lab.kernels import njit

_RODS = [1, 2, 4, 5]


def simulate(
    base: ArrayLike,
    L1: float,
    g: float,
    state: ArrayLike,
    t: ArrayLike,
    max_step: float = MAX_STEP,
    effects: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """A free swing with the arm clamped, equation (1).

    Args:
        base: (6,) base parameters a, b, d, e1, c1, c2, SI; any common scale without effects
        L1: length of the inner rod, m
        g: gravity, m/s^2
        state: (4,) theta1, theta2, omega1, omega2 at t[0], rad and rad/s
        t: (n,) increasing instants, s
        max_step: longest Runge-Kutta step, s; each interval is cut into equal ones
        effects: (SIZE,) vector of `dpr_lab.effects`, SI; none: all off

    Returns:
        (n, 4) states at `t`; nan from where the swing is no longer finite

    Raises:
        ValueError: wrong shapes, or instants that do not increase.
    """
    a, b, d, e1, c1, c2 = _vector(base, 6, "base")
    constants = np.array([a, b, d, e1, d * g / L1, c1, c2, 0.0, 0.0, 0.0, 0.0])
    full = np.zeros(6)
    full[_RODS] = _vector(state, 4, "state")
    return _integrate(constants, CLAMPED, full, t, max_step, effects, 0.0)[:, _RODS]


def simulate_arm(
    Z: ArrayLike,
    frame: tuple[float, float, float],
    arm: Arm,
    state: ArrayLike,
    t: ArrayLike,
    max_step: float = MAX_STEP,
    effects: ArrayLike | None = None,
    drive: ArrayLike = 0.0,
) -> NDArray[np.float64]:
    """A swing of the whole rig with the arm clamped, free or driven.

    Args:
        Z: (9,) parameters in the order of `dpr_lab.rig.PARAMETERS`, SI
        frame: L0 (m), L1 (m), g (m/s^2)
        arm: J0 (kg m^2), c0 (N m s/rad), k0 (N m/rad) and mode; a clamped arm stays where it is, at rest
        state: (6,) theta0, theta1, theta2, omega0, omega1, omega2 at t[0], rad and rad/s
        t: (n,) increasing instants, s
        max_step: longest Runge-Kutta step, s
        effects: (SIZE,) vector of `dpr_lab.effects`, SI; none: all off
        drive: (n,) or one number, held from each instant to the next: torque on a free arm, N m, or acceleration of a
            driven one, rad/s^2

    Returns:
        (n, 6) states at `t`; nan from where the swing is no longer finite

    Raises:
        ValueError: wrong shapes, an unknown mode, or instants that do not increase.
    """
    if arm.mode not in MODES:
        raise ValueError(f"arm mode must be one of {', '.join(MODES)}, not {arm.mode!r}")
    constants = arm_constants(_vector(Z, 9, "Z"), frame, arm)
    mode = MODES.index(arm.mode)
    start = _vector(state, 6, "state")
    if mode == CLAMPED:
        start[3] = 0.0
    return _integrate(constants, mode, start, t, max_step, effects, drive)


def _vector(values: ArrayLike, size: int, name: str) -> NDArray[np.float64]:
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), not {vector.shape}")
    return vector


def _integrate(
    constants: NDArray[np.float64],
    mode: int,
    state: NDArray[np.float64],
    t: ArrayLike,
    max_step: float,
    effects: ArrayLike | None,
    drive: ArrayLike,
) -> NDArray[np.float64]:
    step, count = steps_between(t, max_step)
    vector = np.zeros(SIZE) if effects is None else _vector(effects, SIZE, "effects")
    drives = np.broadcast_to(np.asarray(drive, dtype=np.float64), step.shape).copy()
    return _swing(constants, mode, vector, state, step, count, drives)


@njit
def _swing(
    constants: NDArray[np.float64],
    mode: int,
    effects: NDArray[np.float64],
    start: NDArray[np.float64],
    step: NDArray[np.float64],
    count: NDArray[np.int64],
    drives: NDArray[np.float64],
) -> NDArray[np.float64]:
    states = np.full((len(step), 6), np.nan)
    state, slopes = start.copy(), np.zeros((4, 6))
    for i in range(len(step)):
        for _ in range(count[i]):
            _runge_kutta(constants, mode, effects, drives[i - 1], step[i], state, slopes)
        if not np.isfinite(state).all():
            break
        states[i] = state
    return states


@njit
def _runge_kutta(
    constants: NDArray[np.float64],
    mode: int,
    effects: NDArray[np.float64],
    drive: float,
    step: float,
    state: NDArray[np.float64],
    slopes: NDArray[np.float64],
) -> None:
    half = 0.5 * step
    _slope(constants, mode, effects, drive, state, 0.0, slopes[0], slopes[0])
    _slope(constants, mode, effects, drive, state, half, slopes[0], slopes[1])
    _slope(constants, mode, effects, drive, state, half, slopes[1], slopes[2])
    _slope(constants, mode, effects, drive, state, step, slopes[2], slopes[3])
    for j in range(6):
        state[j] += step / 6.0 * (slopes[0, j] + 2.0 * (slopes[1, j] + slopes[2, j]) + slopes[3, j])


@njit
def _slope(
    constants: NDArray[np.float64],
    mode: int,
    effects: NDArray[np.float64],
    drive: float,
    state: NDArray[np.float64],
    ahead: float,
    along: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> None:
    """Derivative at state + ahead * along, into `slope`."""
    theta0, theta1, theta2, omega0, omega1, omega2 = state + ahead * along
    tau1, tau2 = effect_torques(theta1, theta2, omega1, omega2, effects)
    alphas = arm_accelerations(theta0, theta1, theta2, omega0, omega1, omega2, constants, mode, drive, tau1, tau2)
    slope[0], slope[1], slope[2] = omega0, omega1, omega2
    slope[3], slope[4], slope[5] = alphas

"""Simulate one swing by the classical Runge-Kutta method, at arbitrary times."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.arm import CLAMPED, FREE, MODES, ArmParameters, mounted, with_gravity
from dpr_lab.dynamics.moving_arm.geared_motor import AnyState, GearedState, stepped_with_gear
from dpr_lab.dynamics.rig_constants import UNKNOWN
from dpr_lab.dynamics.schedule import MAX_STEP, steps_between
from dpr_lab.dynamics.step import RigModel, RigState, model_with, stepped
from dpr_lab.effects import EFFECTS, SIZE, named_params
from dpr_lab.effects.effect_kernels import AT_RELEASE, STEPPED
from dpr_lab.effects.quantities import HELD_ARM, RigConstants
from dpr_lab.kernels import njit, subroutine
from dpr_lab.rig import MASSES, PARAMETERS

_RODS = [1, 2, 4, 5]


def simulate(
    base: ArrayLike,
    L1: float,
    g: float,
    state: ArrayLike,
    t: ArrayLike,
    max_step: float = MAX_STEP,
    effects: ArrayLike | None = None,
    constants: RigConstants | None = None,
) -> Array:
    """Simulate a free swing with the arm clamped, equation (1).

    Args:
        base: (6,) base parameters a, b, d, e1, c1, c2, SI; any common scale without effects
        L1: length of the inner rod, m
        g: gravity, m/s^2
        state: (4,) theta1, theta2, omega1, omega2 at t[0], rad and rad/s
        t: (n,) increasing times, s
        max_step: longest Runge-Kutta step, s; each interval is divided into equal steps
        effects: (SIZE,) vector of `dpr_lab.effects`, SI; None: all off. Encoder effects change only the readings,
            not the states.
        constants: measured constants of the rig; None: an effect that needs more than L1 and g gives nan

    Returns:
        (n, 4) states at `t`; nan after the swing becomes non-finite

    Raises:
        ValueError: an array has another shape, or the times do not increase.
    """
    parameters = with_gravity(_vector(base, 6, "base"), L1, g)
    params = _effects(effects)
    model = model_with(parameters, (constants or UNKNOWN)._replace(L1=L1, g=g), HELD_ARM, params)
    full = np.zeros(6)
    full[_RODS] = _vector(state, 4, "state")
    mode = FREE if model.required.arm else CLAMPED
    return integrate(model, mode, at_release(full), t, max_step)[:, _RODS]


def rig_model(
    Z: ArrayLike,
    frame: tuple[float, float, float],
    arm: ArmParameters,
    effects: ArrayLike | None,
    constants: RigConstants | None = None,
) -> tuple[RigModel, int]:
    """Return the model of the whole rig for `integrate`, and the mode of its arm.

    Args:
        Z: (9,) parameters in the order of `dpr_lab.rig.PARAMETERS`, SI
        frame: L0 (m), L1 (m), g (m/s^2)
        arm: J0 (kg m^2), c0 (N m s/rad), k0 (N m/rad) and mode
        effects: (SIZE,) vector of `dpr_lab.effects`, SI; None: all off
        constants: measured constants of the rig; None: the lengths of `frame` and the masses of Z

    Raises:
        ValueError: an array has another shape, the mode is unknown, or an active effect requires a clamped arm and the
            arm is not clamped.
    """
    if arm.mode not in MODES:
        raise ValueError(f"arm mode must be one of {', '.join(MODES)}, not {arm.mode!r}")
    values = _vector(Z, 9, "Z")
    if constants is None:
        m1, m2, mb = values[[PARAMETERS.index(name) for name in MASSES]].tolist()
        constants = UNKNOWN._replace(m1=m1, m2=m2, mb=mb)
    L0, L1, g = frame
    base, held = mounted(values, frame, arm)
    model = model_with(base, constants._replace(L0=L0, L1=L1, g=g), held, _effects(effects))
    held = any(EFFECTS[name].stage == "arm" for name in named_params(model.params))
    if not held:
        return model, MODES.index(arm.mode)
    if arm.mode != "clamped":
        (effect,) = (name for name, effect in EFFECTS.items() if effect.stage == "arm")
        raise ValueError(f"the effect {effect} replaces the clamp of a clamped arm, but this arm is {arm.mode}")
    return model, FREE


def at_release(state: Sequence[float] | Array) -> RigState:
    """Create the state at the release from (6,) angles and speeds, rad and rad/s.

    The internal states are those of a rig at rest.
    """
    return RigState._make([*map(float, state), tuple(AT_RELEASE[list(STEPPED)].tolist())])


def as_state(values: Sequence[float] | Array) -> AnyState:
    """Convert one row of the result of `integrate` to a state."""
    numbers, internal = tuple(map(float, values)), 6 + len(STEPPED)
    fields = [*numbers[:6], numbers[6:internal], *numbers[internal:]]
    return GearedState._make(fields) if len(numbers) > internal else RigState._make(fields)


def motors_of(states: Array) -> Array:
    """Return the (n, 3) states of the motor behind backlash, from the result of `integrate`.

    The columns are the angle of the motor, rad, its speed, rad/s, and the impulse that the gear must still transmit, N
    m s.
    """
    first = 6 + len(STEPPED)
    return states[:, first : first + 3]


def as_row(state: AnyState) -> Array:
    """Convert a state to the form of a row in the result of `integrate`."""
    return np.array([*state[:6], *state.internal, *state[7:]])


def _vector(values: ArrayLike, size: int, name: str) -> Array:
    vector = np.array(values, dtype=np.float64)
    if vector.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), not {vector.shape}")
    return vector


def _effects(effects: ArrayLike | None) -> Array:
    return np.zeros(SIZE) if effects is None else _vector(effects, SIZE, "effects")


def integrate(
    model: RigModel,
    mode: int,
    start: AnyState,
    t: ArrayLike,
    max_step: float = MAX_STEP,
    drive: ArrayLike = 0.0,
) -> Array:
    """Simulate a swing from a complete state, so that several calls can continue it.

    Args:
        model: rig with its effects
        mode: CLAMPED, FREE or DRIVEN
        start: state at t[0]
        t: (n,) increasing times since the release, s
        max_step: longest Runge-Kutta step, s
        drive: (n,) or scalar, constant from each instant to the next: torque on a free arm, N m, or acceleration of a
            driven one, rad/s^2

    Returns:
        (n, 6 + internal) states in the order of `RigState`; with five more columns in the order of `GearedState` if the
        arm's gear has backlash; nan after the swing becomes non-finite

    Raises:
        ValueError: the times do not increase.
    """
    step, count = steps_between(t, max_step)
    drives = np.broadcast_to(np.asarray(drive, dtype=np.float64), step.shape).copy()
    t = np.asarray(t, dtype=np.float64)
    if isinstance(start, RigState):
        if not (mode == FREE and model.required.play0):
            return _swing(model, mode, start, t, step, count, drives)
        start = GearedState(*start, start.theta0, start.omega0, 0.0, 0.0, 0.0)
    model = model._replace(required=model.required._replace(drive0=False))
    states = np.full((len(t), len(as_row(start))), np.nan)
    _geared_swing(model, mode, start, t, step, count, drives, states)
    return states


@njit
def _swing(
    model: RigModel,
    mode: int,
    start: RigState,
    t: Array,
    step: Array,
    count: Integers,
    drives: Array,
) -> Array:
    states = np.full((len(step), 6 + len(start.internal)), np.nan)
    x = start
    for i in range(len(step)):
        for k in range(count[i]):
            x = stepped(t[i - 1] + k * step[i], x, step[i], model, mode, drives[i - 1])
        _write(x, states[i])
        if not np.isfinite(states[i]).all():
            states[i] = np.nan
            break
    return states


@njit
def _geared_swing(
    model: RigModel,
    mode: int,
    start: GearedState,
    t: Array,
    step: Array,
    count: Integers,
    drives: Array,
    states: Array,
) -> None:
    x = start
    for i in range(len(step)):
        for k in range(count[i]):
            x = stepped_with_gear(t[i - 1] + k * step[i], x, step[i], model, mode, drives[i - 1])
        _write(x, states[i])
        motor = 6 + len(x.internal)
        states[i, motor], states[i, motor + 1] = x.motor_angle, x.motor_speed
        states[i, motor + 2], states[i, motor + 3], states[i, motor + 4] = x.owed, x.behind, x.bonded
        if not np.isfinite(states[i]).all():
            states[i] = np.nan
            break


@subroutine
def _write(x: AnyState, row: Array) -> None:
    row[0], row[1], row[2] = x.theta0, x.theta1, x.theta2
    row[3], row[4], row[5] = x.omega0, x.omega1, x.omega2
    for k, value in enumerate(x.internal):
        row[6 + k] = value

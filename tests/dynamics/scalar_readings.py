"""The readings of one candidate, segment by segment and step by step: the scalar steps of the simulator, no lanes.

An independent second path for the tests of `dpr_lab.dynamics.prediction`; they share the kernels of effects alone.
"""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import CLAMPED, FREE, with_gravity
from dpr_lab.dynamics.base import base_of_run
from dpr_lab.dynamics.encoder_errors import apply_encoder_errors, read_at
from dpr_lab.dynamics.prediction import INTERNAL, segment_start
from dpr_lab.dynamics.rig_constants import constants_of_run
from dpr_lab.dynamics.step import RigModel, RigState, advanced, model_with
from dpr_lab.effects.effect_kernels import (
    ARM,
    AT_RELEASE,
    LAG1,
    LAG2,
    STEPPED,
    held_angle,
    held_angle1,
    internal_after,
    internal_sliding,
)
from dpr_lab.effects.fold import compiled
from dpr_lab.effects.mounted import effects_of_run
from dpr_lab.effects.quantities import HELD_ARM
from dpr_lab.kernels import njit

_SUBSTEPS = 4
_stepped_of = compiled(["def folded(internal):", f"    return ({', '.join(f'internal[{i}]' for i in STEPPED)},)"], {})


def read_segments(base, params, constants, segments, initial, internal=None):
    """Compute readings (N, 3) of both joints and of the arm, rad, and internal states (S, k) at the starts of the
    segments."""
    angles, internal_starts = np.empty((len(segments.t), 3)), np.empty((len(segments), len(INTERNAL)))
    params = np.broadcast_to(params, (len(segments.setups), params.shape[-1]))
    after = np.zeros(len(INTERNAL))
    for s, run in enumerate(segments.run):
        setup = segments.setups[run]
        heavy = with_gravity(base_of_run(base, setup, constants.L1, constants.g), constants.L1, constants.g)
        model = model_with(
            heavy, constants_of_run(constants, setup), HELD_ARM, effects_of_run(params[run], setup).copy()
        )
        i, j = segments.offsets[s : s + 2]
        if s in segments.chains:
            after = _begins(initial[s], segment_start(segments.t[i]))
        given = np.full(len(INTERNAL), np.nan) if internal is None else internal[s]
        internal_starts[s] = np.where(np.isnan(given), after, given)
        until = segments.t[min(j, len(segments.t) - 1)]
        _segment(
            segments.t[i:j], run, until, initial[s], internal_starts[s], after, model, segments.step[s], angles[i:j]
        )
    return angles, internal_starts


@njit
def _begins(start: NDArray[np.float64], now: float) -> NDArray[np.float64]:
    internal = AT_RELEASE.copy()
    if now > 0.0:
        _put(internal_sliding(0.0, start[2], start[3] - start[2]), internal)
    return internal


@njit
def _put(stepped_states: tuple[float, ...], internal: NDArray[np.float64]) -> None:
    for k, value in enumerate(stepped_states):
        internal[STEPPED[k]] = value


@njit
def hermite(u: float, h: float, y0: float, v0: float, y1: float, v1: float) -> float:
    """Evaluate the cubic through y0, y1 with the slopes v0, v1 over a step h, at the fraction u of the step."""
    w = 1.0 - u
    return w * w * ((1.0 + 2.0 * u) * y0 + u * h * v0) + u * u * ((3.0 - 2.0 * u) * y1 - w * h * v1)


@njit
def angle1(u: float, h: float, x: RigState, y: RigState) -> float:
    """Angle theta1 at the fraction u of the step from x to y, rad."""
    return hermite(u, h, x.theta1, x.omega1, y.theta1, y.omega1)


@njit
def angle2(u: float, h: float, x: RigState, y: RigState, relative2: float) -> float:
    """Angle of joint 2 as read by its encoder, at the fraction u of the step from x to y, rad."""
    outer = hermite(u, h, x.theta2, x.omega2, y.theta2, y.omega2)
    return outer - relative2 * angle1(u, h, x, y)


@njit
def _segment(
    t: NDArray[np.float64],
    run: int,
    until: float,
    start: NDArray[np.float64],
    internal: NDArray[np.float64],
    after: NDArray[np.float64],
    model: RigModel,
    h: float,
    angles: NDArray[np.float64],
) -> None:
    """Read one segment into `angles` (n, 3), and its internal states where the next one starts into `after`."""
    n, relative2 = len(t), model.constants.relative2
    now, (last1, last2) = segment_start(read_at(t[0], model)[0]), read_at(t[n - 1], model)
    longest = now + 2.0 * (t[n - 1] - t[0]) + 1.0
    if not (last1 < longest and last2 < longest):  # or not a number: a clock that no rig has
        angles[:], after[:] = np.nan, np.nan
        return
    handed = min(segment_start(read_at(until, model)[0]), last1)
    fresh = _stepped_of(AT_RELEASE)
    x = RigState(internal[ARM], start[0], start[1], internal[ARM + 1], start[2], start[3], _stepped_of(internal))
    hold = x.theta2 - relative2 * x.theta1 + internal[LAG2]
    hold1 = x.theta1 + internal[LAG1]
    next1, next2, step, events, until = 0, 0, h, 0, now + h
    while next1 < n or next2 < n:
        released = now > -0.5 * step
        mode = FREE if model.required.arm and released else CLAMPED
        y, h, whole = advanced(now, x, until - now, events, model, mode, 0.0)
        events = 0 if whole else events + 1
        if h == 0.0:
            x = y
            continue
        next1, hold1 = _read_joint1(next1, hold1, t, now, h, x, y, model, angles)
        next2, hold = _read_joint2(next2, hold, t, now, h, x, y, model, angles)
        if not released:
            hold, hold1 = angle2(1.0, h, x, y, relative2), y.theta1
            y = RigState(y.theta0, y.theta1, y.theta2, y.omega0, y.omega1, y.omega2, fresh)
        if now < handed and handed <= now + h:
            lags = hold1 - y.theta1 if model.required.play1 else 0.0, hold - angle2(1.0, h, x, y, relative2)
            _hand_over((handed - now) / h, h, x, y, lags, model, after)
        now = until if whole else now + h
        until = until + step if whole else until
        x = y
    apply_encoder_errors(angles, t, run, model)


@njit
def _read_joint1(
    first: int,
    hold: float,
    t: NDArray[np.float64],
    now: float,
    h: float,
    x: RigState,
    y: RigState,
    model: RigModel,
    angles: NDArray[np.float64],
) -> tuple[int, float]:
    """Read joint 1 and the arm from sample `first` on, as far as the step from x to y goes.

    Returns:
        the next sample, and the angle that encoder 1 holds at the end of the step
    """
    k, passed, loose = first, 0.0, model.required.play1
    while k < len(t):
        u = (read_at(t[k], model)[0] - now) / h
        if u > 1.0:
            break
        angles[k, 0] = angle1(u, h, x, y)
        angles[k, 2] = hermite(u, h, x.theta0, x.omega0, y.theta0, y.omega0)
        if loose:
            hold = _dragged1(hold, passed, u, h, x, y, model)
            passed, angles[k, 0] = u, hold
        k += 1
    return k, _dragged1(hold, passed, 1.0, h, x, y, model) if loose else hold


@njit
def _dragged1(hold: float, since: float, to: float, h: float, x: RigState, y: RigState, model: RigModel) -> float:
    """The angle that encoder 1 holds at the share `to` of a step, from that at the share `since`, rad."""
    for k in range(1, _SUBSTEPS):
        u = k / _SUBSTEPS
        if since < u and u < to:
            hold = held_angle1(angle1(u, h, x, y), hold, model.params, model.active)
    return held_angle1(angle1(to, h, x, y), hold, model.params, model.active)


@njit
def _read_joint2(
    first: int,
    hold: float,
    t: NDArray[np.float64],
    now: float,
    h: float,
    x: RigState,
    y: RigState,
    model: RigModel,
    angles: NDArray[np.float64],
) -> tuple[int, float]:
    """Read joint 2 likewise; the next sample, and the angle that its encoder holds at the end of the step."""
    k, passed, loose = first, 0.0, model.required.play
    while k < len(t):
        u = (read_at(t[k], model)[1] - now) / h
        if u > 1.0:
            break
        angles[k, 1] = angle2(u, h, x, y, model.constants.relative2)
        if loose:
            hold = _dragged(hold, passed, u, h, x, y, model)
            passed, angles[k, 1] = u, hold
        k += 1
    return k, _dragged(hold, passed, 1.0, h, x, y, model) if loose else hold


@njit
def _dragged(hold: float, since: float, to: float, h: float, x: RigState, y: RigState, model: RigModel) -> float:
    """The angle that encoder 2 holds at the share `to` of a step, from that at the share `since`, rad."""
    relative2 = model.constants.relative2
    for k in range(1, _SUBSTEPS):
        u = k / _SUBSTEPS
        if since < u and u < to:
            hold = held_angle(angle2(u, h, x, y, relative2), hold, model.params, model.active)
    return held_angle(angle2(to, h, x, y, relative2), hold, model.params, model.active)


@njit
def _hand_over(
    u: float,
    h: float,
    x: RigState,
    y: RigState,
    lags: tuple[float, float],
    model: RigModel,
    after: NDArray[np.float64],
) -> None:
    """Internal states at the fraction u of the step from x to y.

    Angles held by encoders are those of the step's end.
    """
    displacement1, displacement2 = u * (y.theta1 - x.theta1), u * (y.theta2 - x.theta2 - y.theta1 + x.theta1)
    _put(internal_after(x.internal, 0.0, displacement1, displacement2, model.params, model.active), after)
    after[LAG1], after[LAG2] = lags
    after[ARM] = hermite(u, h, x.theta0, x.omega0, y.theta0, y.omega0)
    after[ARM + 1] = x.omega0 + u * (y.omega0 - x.omega0)

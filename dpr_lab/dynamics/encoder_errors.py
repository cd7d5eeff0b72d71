"""Convert joint angles to encoder readings: timing, backlash and encoder errors."""

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.segments import Segments
from dpr_lab.dynamics.step import RigModel
from dpr_lab.effects.effect_kernels import (
    active_effects,
    arm_delay,
    arm_encoder_error,
    encoder_errors,
    held_angle,
    held_angle1,
    reading_shifts,
)
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.kernels import njit, subroutine


@njit
def read_at(t: float, model: RigModel) -> tuple[float, float]:
    """Return the sampling times of joints 1 and 2, s, at the device time t, s."""
    shift1, shift2 = reading_shifts(t, model.params, model.active)
    return t + shift1, t + shift2


@njit
def arm_lateness(model: RigModel) -> float:
    """Return the delay of the arm's reading relative to that of joint 1, s."""
    return arm_delay(0.0, model.params, model.active)


@subroutine
def add_errors(
    angles: Array,
    t: Array,
    first: int,
    stop: int,
    run: int,
    constants: RigConstants,
    params: Array,
    active: Flags,
) -> None:
    """Add the encoder errors to the rows `first` to `stop` - 1 of angles (N, 2 or 3), in place.

    See `apply_encoder_errors` for the columns and the times.
    """
    for k in range(first, stop):
        angle1, angle2 = angles[k, 0], angles[k, 1]
        error1, error2 = encoder_errors(angle1, angle2, t[k], run, constants, params, active)
        angles[k, 0], angles[k, 1] = angle1 + error1, angle2 + error2
        if angles.shape[1] > 2:
            angles[k, 2] += arm_encoder_error(angles[k, 2], t[k], run, constants, params, active)


@njit
def apply_encoder_errors(angles: Array, t: Array, run: int, model: RigModel) -> None:
    """Add the encoder errors to (n, 2) or (n, 3) angles, in place.

    Args:
        angles: joint 1 absolute, joint 2 as read by its encoder, and optionally the arm, rad
        t: (n,) device time since the release, s
        run: number of the release, from 0
        model: rig and effects; only encoder errors are used
    """
    add_errors(angles, t, 0, len(t), run, model.constants, model.params, model.active)


def with_encoder_errors(angles: Array, params: ArrayLike, constants: RigConstants, segments: Segments) -> Array:
    """Apply n sets of encoder errors to the same simulated angles.

    Args:
        angles: (N, axes) joint 1 absolute, joint 2 as read by its encoder, and the arm if it moves, rad
        params: (n, SIZE) effects; only encoder errors are used
        constants: constants of the rig
        segments: times of the readings

    Returns:
        (n, N, axes) readings, rad
    """
    rows = np.array(params, dtype=np.float64, order="C")
    read = np.repeat(angles[None], len(rows), axis=0)
    _add_errors(read, segments.t, segments.offsets, segments.run, constants, rows, active_effects(rows))
    return read


@njit(allocates=False)
def _add_errors(
    read: Array,
    t: Array,
    offsets: Integers,
    run: Integers,
    constants: RigConstants,
    params: Array,
    active: Flags,
) -> None:
    for c in range(len(params)):
        for s in range(len(run)):
            add_errors(read[c], t, offsets[s], offsets[s + 1], run[s], constants, params[c], active[c])


@njit
def held_along(angles: Array, hold: Array, model: RigModel) -> Array:
    """Compute the angles at the encoders of the rods, which follow their joints with backlash.

    Args:
        angles: (n, 2) joint 1 absolute and joint 2 as read by its encoder, rad
        hold: (2,) angles at the encoders before the first row, rad
        model: rig and effects; only the backlash of the encoders is used

    Returns:
        (n, 2) angles at the encoders, rad
    """
    held = np.empty(angles.shape)
    hold1, hold2 = hold
    for k in range(len(angles)):
        hold1 = held_angle1(angles[k, 0], hold1, model.params, model.active)
        hold2 = held_angle(angles[k, 1], hold2, model.params, model.active)
        held[k, 0], held[k, 1] = hold1, hold2
    return held

"""From the angles of the joints to those that their encoders read: timing, play and distortion."""

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.step import Model
from dpr_lab.effects.folded import held, misread, plays, shifts, switched
from dpr_lab.effects.quantities import Known
from dpr_lab.kernels import njit


@njit
def read_at(t: float, model: Model) -> tuple[float, float]:
    """Instants, s since the release, at which joints 1 and 2 had the angles that are read as those of device time t."""
    shift1, shift2 = shifts(t, model.vector, model.on)
    return t + shift1, t + shift2


@njit
def distort(
    angles: NDArray[np.float64],
    t: NDArray[np.float64],
    run: int,
    known: Known,
    vector: NDArray[np.float64],
    on: NDArray[np.bool_],
) -> None:
    """Add to (n, >= 2) angles of joints 1 and 2 what their encoders misread, in place.

    Args:
        angles: joint 1 absolute, joint 2 as its encoder has it, rad
        t: (n,) device time since the release, s
        run: number of the release, from 0
        known: the rig
        vector: (SIZE,) effects, of which those of encoders count
        on: (effects,) which of them are on
    """
    for k in range(len(t)):
        added1, added2 = misread(angles[k, 0], angles[k, 1], t[k], run, known, vector, on)
        angles[k, 0] += added1
        angles[k, 1] += added2


@njit(parallel=True)
def misread_batch(
    angles: NDArray[np.float64],
    t: NDArray[np.float64],
    offsets: NDArray[np.int64],
    run: NDArray[np.int64],
    known: Known,
    vectors: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(n, N, 2) what the encoders make of the same angles under many effects; nothing is integrated for it.

    Args:
        angles: (N, 2) joint 1 absolute, joint 2 as its encoder has it, rad
        t: (N,) device time since the release, s
        offsets: (S + 1,) where segments begin among them
        run: (S,) number of the release of each, from 0
        known: the rig
        vectors: (n, SIZE) effects, of which those of encoders count
    """
    read = np.empty((len(vectors), len(t), 2))
    for c in numba.prange(len(vectors)):
        read[c], on = angles, switched(vectors[c])
        for s in range(len(run)):
            own = slice(offsets[s], offsets[s + 1])
            distort(read[c, own], t[own], run[s], known, vectors[c], on)
    return read


@njit
def has_play(model: Model) -> bool:
    """Whether the encoder of joint 2 has play."""
    return plays(model.on)


@njit
def held_along(angles: NDArray[np.float64], hold: float, model: Model) -> NDArray[np.float64]:
    """(n,) angles that the encoder of joint 2 holds while its joint goes through `angles`, from `hold` on, rad."""
    seen = np.empty(len(angles))
    for k in range(len(angles)):
        hold = held(angles[k], hold, model.vector)
        seen[k] = hold
    return seen

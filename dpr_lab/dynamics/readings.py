r"""What the encoders of a rig with effects read along segments with free start states: the model of the fits.

A segment starts `PAD` before its first sample, so that a late or fast clock never reads before it; the first of a run
at the release itself, where that is near (`started`). It is integrated by
classical Runge-Kutta steps of equal length; the angles at the instants of reading lie on the cubic through the states
at either end of a step.

Some effects remember: presliding, the play of an encoder, an arm on a spring. Their state (`MEMORY`) at the start of a
segment is that in which the segment before it, of the same run, passed this instant. Until the release all three are
fresh: joints that do not grip, an encoder amid its play, an arm that is held. A run that starts later starts with
joints that slide.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.arm import CLAMPED, FREE
from dpr_lab.dynamics.base import BASE, added_base
from dpr_lab.dynamics.known import carrying
from dpr_lab.dynamics.sensors import distort, has_play, read_at
from dpr_lab.dynamics.step import Model, State, model_of, stepped
from dpr_lab.effects import SIZE
from dpr_lab.effects.folded import grips, held
from dpr_lab.effects.quantities import SMOOTHING, Known, Mount, Rods
from dpr_lab.kernels import njit
from dpr_lab.rig import AddedMass

PAD = 0.02
"""How long before its first sample a segment starts, s: longer than any latency worth fitting."""

NEAR_RELEASE = 0.04
"""A segment that would start less than this after the release starts with it, where what remembers is fresh, s."""

STEP = 2.5e-3
"""Runge-Kutta step, s. From any pose of the paper's rig it errs by less than 1e-6 rad over a segment of 0.5 s."""

MEMORY = ("grip1", "grip2", "lag", "theta0", "omega0")
"""Order of a memory: presliding of both joints (-1 to 1), angle held by encoder 2 less its joint's (rad), arm (SI)."""

_SUBSTEPS = 4  # places within a step at which the play of an encoder looks for a turning point
_HELD = Mount(1.0, 0.0, 0.0, 0.0)
_FROM_RUN = np.nan  # a memory to be taken over from the segment before


@dataclass(frozen=True, slots=True)
class Pieces:
    """Segments end to end, in the order of runs and of time; segment s owns the samples offsets[s] to offsets[s+1]."""

    t: NDArray[np.float64]
    """(N,) device time of each sample since the release of its run, s."""
    offsets: NDArray[np.int64]
    """(S + 1,) where the segments begin among the samples."""
    run: NDArray[np.int64]
    """(S,) index of the run that each segment was cut from."""
    chains: NDArray[np.int64]
    """(runs + 1,) where the runs begin among the segments."""
    added: tuple[AddedMass | None, ...]
    """Mass clamped on in each run, by the run's index."""
    step: float
    """Runge-Kutta step, s."""

    def __len__(self) -> int:
        return len(self.run)


def pieces(
    times: Sequence[ArrayLike], run: ArrayLike, added: Sequence[AddedMass | None] = (), step: float = STEP
) -> Pieces:
    """Segments from the instants of each.

    Args:
        times: for each segment (n,) increasing device times since the release, s
        run: (S,) index of the run that each segment was cut from; in order, and within a run in order of time
        added: mass clamped on in each run, by the run's index; none where it is shorter
        step: Runge-Kutta step, s

    Raises:
        ValueError: no segment, instants that do not increase, or segments out of order.
    """
    arrays = [np.asarray(t, dtype=np.float64) for t in times]
    indices = np.asarray(run, dtype=np.int64)
    if not arrays or indices.shape != (len(arrays),):
        raise ValueError(f"there must be at least one segment, and one run index for each: {len(arrays)} segments")
    if not all(t.ndim == 1 and len(t) and np.isfinite(t).all() and (np.diff(t) > 0).all() for t in arrays):
        raise ValueError("each segment needs finite, strictly increasing instants")
    firsts = np.array([t[0] for t in arrays])
    if (np.diff(indices) < 0).any() or (np.diff(firsts)[np.diff(indices) == 0] <= 0).any():
        raise ValueError("segments must be in the order of runs, and of time within a run")
    chains = np.concatenate([[0], np.flatnonzero(np.diff(indices)) + 1, [len(arrays)]])
    runs = int(indices[-1]) + 1
    carried = (*added, *[None] * (runs - len(added)))
    offsets = np.cumsum([0, *(len(t) for t in arrays)])
    return Pieces(np.concatenate(arrays), offsets, indices, chains.astype(np.int64), carried, step)


def readings(
    base: ArrayLike,
    vector: ArrayLike,
    known: Known,
    pieces: Pieces,
    starts: ArrayLike,
    memory: ArrayLike | None = None,
    arm: bool = False,
) -> NDArray[np.float64]:
    """What the encoders read, for one candidate; arguments as for `readings_batch`, without its first axis.

    Returns:
        (N, 2) theta1 and the angle of joint 2 as its encoder has it, rad; with `arm` a third column, theta0
    """
    base, vector, starts = (np.asarray(values, dtype=np.float64)[None] for values in (base, vector, starts))
    return readings_batch(base, vector, known, pieces, starts, memory, arm)[0]


def readings_batch(
    bases: ArrayLike,
    vectors: ArrayLike,
    known: Known,
    pieces: Pieces,
    starts: ArrayLike,
    memory: ArrayLike | None = None,
    arm: bool = False,
) -> NDArray[np.float64]:
    """What the encoders read, for many candidates in parallel: forward differences of all columns take one call.

    Args:
        bases: (n, 6) base parameters a, b, d, e1, c1, c2 without any mass clamped on, SI
        vectors: (n, SIZE) effects, SI; or (n, runs, SIZE) where they differ between runs
        known: the rig, `dpr_lab.dynamics.known.known_of`
        pieces: the segments
        starts: (n, S, 4) theta1, theta2, omega1, omega2 where each segment starts (`started`), rad and rad/s
        memory: (S, 5) or (n, S, 5) state of the effects that remember (`MEMORY`) at each segment's start, where it is
            not nan; none: all taken over from segment to segment. A derivative by the start states alone needs it
            held still, `memories` of the point of expansion.
        arm: whether the arm's angle is wanted

    Returns:
        (n, N, 2) theta1 and the angle of joint 2 as its encoder has it (relative or absolute), rad; with `arm`
        (n, N, 3), the third theta0. Not finite from where a candidate is not.

    Raises:
        ValueError: shapes that do not fit.
    """
    angles, _ = _all(bases, vectors, known, pieces, starts, memory)
    return angles if arm else angles[..., :2]


def memories(
    base: ArrayLike, vector: ArrayLike, known: Known, pieces: Pieces, starts: ArrayLike
) -> NDArray[np.float64]:
    """(S, 5) state of the effects that remember at each segment's start; arguments as for `readings`."""
    base, vector, starts = (np.asarray(values, dtype=np.float64)[None] for values in (base, vector, starts))
    return _all(base, vector, known, pieces, starts, None)[1][0]


def _all(
    bases: ArrayLike, vectors: ArrayLike, known: Known, pieces: Pieces, starts: ArrayLike, memory: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    bases, vectors, starts = (np.asarray(values, dtype=np.float64) for values in (bases, vectors, starts))
    n, runs, segments = len(bases), len(pieces.added), len(pieces)
    if vectors.ndim == 2:
        vectors = vectors[:, None]
    memory = np.asarray(_FROM_RUN if memory is None else memory, dtype=np.float64)
    loads = np.array([added_base(added, known.L1, known.g) for added in pieces.added])
    masses = np.array([[heavy.m1, heavy.m2] for heavy in (carrying(known, added) for added in pieces.added)])
    return _read(
        _shaped(bases, (n, len(BASE)), "bases"),
        _shaped(vectors, (n, runs, SIZE), "vectors"),
        known,
        pieces.t,
        pieces.offsets,
        pieces.run,
        pieces.chains,
        loads,
        masses,
        _shaped(starts, (n, segments, 4), "starts"),
        _shaped(memory, (n, segments, len(MEMORY)), "memory"),
        pieces.step,
    )


def _shaped(values: NDArray[np.float64], shape: tuple[int, ...], name: str) -> NDArray[np.float64]:
    try:
        return np.ascontiguousarray(np.broadcast_to(values, shape))
    except ValueError:
        raise ValueError(f"{name} must have shape {shape}, not {values.shape}") from None


@njit(parallel=True)
def _read(
    bases: NDArray[np.float64],
    vectors: NDArray[np.float64],
    known: Known,
    t: NDArray[np.float64],
    offsets: NDArray[np.int64],
    run: NDArray[np.int64],
    chains: NDArray[np.int64],
    loads: NDArray[np.float64],
    masses: NDArray[np.float64],
    starts: NDArray[np.float64],
    memory: NDArray[np.float64],
    step: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    angles = np.empty((len(bases), len(t), 3))
    begun = np.empty((len(bases), len(run), 5))
    count = len(chains) - 1
    for item in numba.prange(len(bases) * count):
        c, chain = item // count, item % count
        r = int(run[chains[chain]])
        heavy = Known(
            known.L0, known.L1, known.L2, known.g, masses[r, 0], masses[r, 1], known.mb,
            known.counts_per_rev1, known.counts_per_rev2, known.relative2,
        )  # fmt: skip
        base = bases[c] + loads[r]
        rods = Rods(base[0], base[1], base[2], base[3], base[2] * known.g / known.L1, base[4], base[5])
        model = model_of(rods, heavy, _HELD, vectors[c, r])
        before = _begins(starts[c, chains[chain]], started(float(t[offsets[chains[chain]]])))
        for s in range(chains[chain], chains[chain + 1]):
            for i in range(5):
                begun[c, s, i] = before[i] if np.isnan(memory[c, s, i]) else memory[c, s, i]
            until = float(t[min(offsets[s + 1], len(t) - 1)])
            own = slice(offsets[s], offsets[s + 1])
            _segment(t[own], r, until, starts[c, s], begun[c, s], before, model, step, angles[c, own])
    return angles, begun


@njit
def started(first: float) -> float:
    """When a segment starts whose first reading is taken `first` seconds after the release, s."""
    start = first - PAD
    return 0.0 if 0.0 < start and start < NEAR_RELEASE else start


@njit
def _begins(start: NDArray[np.float64], now: float) -> NDArray[np.float64]:
    memory = np.zeros(5)
    if now > 0.0:
        memory[0] = math.tanh(start[2] / SMOOTHING)
        memory[1] = math.tanh((start[3] - start[2]) / SMOOTHING)
    return memory


@njit
def hermite(u: float, h: float, y0: float, v0: float, y1: float, v1: float) -> float:
    """The cubic through y0, y1 with slopes v0, v1 over a step of h, at the share u of it."""
    w = 1.0 - u
    return w * w * ((1.0 + 2.0 * u) * y0 + u * h * v0) + u * u * ((3.0 - 2.0 * u) * y1 - w * h * v1)


@njit
def angle1(u: float, h: float, x: State, y: State) -> float:
    """theta1 at the share u of the step from x to y, rad."""
    return hermite(u, h, x.theta1, x.omega1, y.theta1, y.omega1)


@njit
def angle2(u: float, h: float, x: State, y: State, relative2: float) -> float:
    """Angle of joint 2 as its encoder has it, at the share u of the step from x to y, rad."""
    outer = hermite(u, h, x.theta2, x.omega2, y.theta2, y.omega2)
    return outer - relative2 * angle1(u, h, x, y)


@njit
def _segment(
    t: NDArray[np.float64],
    run: int,
    until: float,
    start: NDArray[np.float64],
    memory: NDArray[np.float64],
    after: NDArray[np.float64],
    model: Model,
    h: float,
    angles: NDArray[np.float64],
) -> None:
    """Read one segment into `angles` (n, 3), and its memory where the next one starts into `after`."""
    n, relative2 = len(t), model.known.relative2
    now, (last1, last2) = started(read_at(t[0], model)[0]), read_at(t[n - 1], model)
    longest = now + 2.0 * (t[n - 1] - t[0]) + 1.0
    if not (last1 < longest and last2 < longest):  # or not a number: a clock that no rig has
        angles[:], after[:] = np.nan, np.nan
        return
    handed = min(started(read_at(until, model)[0]), last1)
    x = State(memory[3], start[0], start[1], memory[4], start[2], start[3], memory[0], memory[1])
    hold = x.theta2 - relative2 * x.theta1 + memory[2]
    next1, next2 = 0, 0
    while next1 < n or next2 < n:
        released = now > -0.5 * h
        y = stepped(now, x, h, model, FREE if model.gives and released else CLAMPED, 0.0)
        next1 = _read_joint1(next1, t, now, h, x, y, model, angles)
        next2, hold = _read_joint2(next2, hold, t, now, h, x, y, model, angles)
        if not released:
            hold = angle2(1.0, h, x, y, relative2)
            y = State(y.theta0, y.theta1, y.theta2, y.omega0, y.omega1, y.omega2, 0.0, 0.0)
        if now < handed and handed <= now + h:
            _hand_over((handed - now) / h, h, x, y, hold - angle2(1.0, h, x, y, relative2), model, after)
        now += h
        x = y
    distort(angles, t, run, model.known, model.vector, model.on)


@njit(inline="always")
def _read_joint1(
    first: int,
    t: NDArray[np.float64],
    now: float,
    h: float,
    x: State,
    y: State,
    model: Model,
    angles: NDArray[np.float64],
) -> int:
    """Read joint 1 and the arm from sample `first` on, as far as the step from x to y goes; the next sample."""
    for k in range(first, len(t)):
        u = (read_at(t[k], model)[0] - now) / h
        if u > 1.0:
            return k
        angles[k, 0] = angle1(u, h, x, y)
        angles[k, 2] = hermite(u, h, x.theta0, x.omega0, y.theta0, y.omega0)
    return len(t)


@njit(inline="always")
def _read_joint2(
    first: int,
    hold: float,
    t: NDArray[np.float64],
    now: float,
    h: float,
    x: State,
    y: State,
    model: Model,
    angles: NDArray[np.float64],
) -> tuple[int, float]:
    """Read joint 2 likewise; the next sample, and the angle that its encoder holds at the end of the step."""
    k, passed, loose = first, 0.0, has_play(model)
    while k < len(t):
        u = (read_at(t[k], model)[1] - now) / h
        if u > 1.0:
            break
        angles[k, 1] = angle2(u, h, x, y, model.known.relative2)
        if loose:
            hold = _dragged(hold, passed, u, h, x, y, model)
            passed, angles[k, 1] = u, hold
        k += 1
    return k, _dragged(hold, passed, 1.0, h, x, y, model) if loose else hold


@njit
def _dragged(hold: float, since: float, to: float, h: float, x: State, y: State, model: Model) -> float:
    """The angle that encoder 2 holds at the share `to` of a step, from that at the share `since`, rad."""
    relative2 = model.known.relative2
    for k in range(1, _SUBSTEPS):
        u = k / _SUBSTEPS
        if since < u and u < to:
            hold = held(angle2(u, h, x, y, relative2), hold, model.vector)
    return held(angle2(to, h, x, y, relative2), hold, model.vector)


@njit
def _hand_over(u: float, h: float, x: State, y: State, lag: float, model: Model, after: NDArray[np.float64]) -> None:
    """The memory at the share u of the step from x to y; what the encoder holds is that of the step's end."""
    slip1, slip2 = u * (y.theta1 - x.theta1), u * (y.theta2 - x.theta2 - y.theta1 + x.theta1)
    after[0], after[1] = grips(x.grip1, x.grip2, slip1, slip2, model.vector, model.on)
    after[2] = lag
    after[3] = hermite(u, h, x.theta0, x.omega0, y.theta0, y.omega0)
    after[4] = x.omega0 + u * (y.omega0 - x.omega0)

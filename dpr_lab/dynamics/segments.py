"""Division of the samples of all runs into segments.

Each segment has an initial state (theta1, theta2, omega1, omega2) of its own. A fit estimates these states, which are
therefore not part of `Segments`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.setup import BOTH, Setup

STEP = 2.5e-3
"""Longest Runge-Kutta step of the fits, s. From any pose of the paper's rig its error is below 1e-6 rad over 0.5 s."""


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """Segments of all runs in order of time.

    Segment s contains the samples offsets[s] to offsets[s + 1] - 1.
    """

    t: Array
    """(N,) time of each sample since the release of its run, s."""
    offsets: Integers
    """(S + 1,) index of the first sample of each segment, then N."""
    run: Integers
    """(S,) index of the run to which each segment belongs."""
    setups: tuple[Setup, ...]
    """Mounting and inputs of each run, by the index of the run."""
    step: Array
    """(S,) longest Runge-Kutta step of each segment, s."""

    def __len__(self) -> int:
        return len(self.run)

    @property
    def arm_moves(self) -> bool:
        """Whether the arm of any run is free or driven."""
        return any(setup.arm_moves for setup in self.setups)

    @property
    def states(self) -> int:
        """Number of state components: 4, or 6 with theta0 and omega0 of a moving arm."""
        return 6 if self.arm_moves else 4

    @property
    def initial_values(self) -> Integers:
        """(S,) number of free initial values of each segment."""
        return np.array([setup.initial_values for setup in self.setups], dtype=np.int64)[self.run]

    @property
    def held(self) -> Flags:
        """(S,) mask of the segments in which the parts on joint 1 turn as one body."""
        return np.array([setup.held for setup in self.setups], dtype=np.bool_)[self.run]

    @property
    def pushes(self) -> Array:
        """(samples, 4) mean known inputs since the previous sample, with zero for free swings.

        The columns are the torques on theta1 and theta2, N m, and the acceleration, rad/s^2, and squared speed,
        rad^2/s^2, of an arm with prescribed motion.
        """
        return _pushes(self).copy()

    @property
    def owner(self) -> Integers:
        """(samples,) index of the segment of each sample."""
        return _owner(self)

    def turning_as_one(self, initial: Array) -> Array:
        """Make initial states consistent with rods that turn as one body.

        Both rods get equal speeds. The halves of a single rod also get equal angles, because the torque on a moving arm
        depends on both angles.

        Args:
            initial: (..., S, 4) initial states, rad and rad/s
        """
        if self.held.any():
            alone = np.array([setup.alone for setup in self.setups])[self.run]
            initial = initial.copy()
            initial[..., self.held, 3] = initial[..., self.held, 2]
            initial[..., alone, 1] = initial[..., alone, 0]
        return initial

    @property
    def chains(self) -> Integers:
        """(runs + 1,) first segment of each run, then the number of segments."""
        return np.concatenate([[0], np.flatnonzero(np.diff(self.run)) + 1, [len(self)]]).astype(np.int64)

    def samples_of(self, indices: Integers) -> Integers:
        """Return the indices of the samples of some segments, in sequence."""
        return np.concatenate([np.arange(*self.offsets[s : s + 2]) for s in indices])

    def chosen(self, indices: Integers) -> "Segments":
        """Return some of the segments, given by their ascending indices."""
        offsets = np.concatenate([[0], np.cumsum(np.diff(self.offsets)[indices])])
        return Segments(self.t[self.samples_of(indices)], offsets, self.run[indices], self.setups, self.step[indices])


@lru_cache(maxsize=8)  # cached, because every step of a fit uses it
def _pushes(layout: Segments) -> Array:
    means = np.zeros((len(layout.t), 4))
    if all(setup.free for setup in layout.setups):
        return means
    first = np.zeros(len(layout.t), dtype=np.bool_)
    first[layout.offsets[:-1]] = True
    for chain, until in pairwise(layout.chains):
        samples, setup = slice(layout.offsets[chain], layout.offsets[until]), layout.setups[layout.run[chain]]
        if setup.torques is not None:
            means[samples, :2] = setup.torques.mean_before(layout.t[samples], first[samples])
        if setup.arm is not None:
            means[samples, 2:] = setup.arm.mean_before(layout.t[samples], first[samples])
    return means


@lru_cache(maxsize=8)
def _owner(layout: Segments) -> Integers:
    return np.repeat(np.arange(len(layout)), np.diff(layout.offsets))


def segments(
    times: Sequence[ArrayLike],
    run: ArrayLike | None = None,
    setups: Sequence[Setup] = (),
    step: ArrayLike = STEP,
) -> Segments:
    """Create segments from the times of their samples.

    Args:
        times: for each segment (n,) increasing times since the release, s
        run: (S,) index of the run of each segment; in order, and within a run in order of time; None: one run
        setups: mounting and inputs of each run by its index; a missing entry stands for free swings of both rods
        step: longest Runge-Kutta step, s, for all segments or (S,) for each

    Raises:
        ValueError: there is no segment, times do not increase, segments are not in order, or a step is not positive.
    """
    arrays = [np.asarray(t, dtype=np.float64) for t in times]
    indices = np.zeros(len(arrays), dtype=np.int64) if run is None else np.array(run, dtype=np.int64)
    if not arrays or indices.shape != (len(arrays),):
        raise ValueError(f"there must be at least one segment, and one run index for each: {len(arrays)} segments")
    offsets = np.cumsum([0, *(t.size for t in arrays)])
    if any(t.ndim != 1 for t in arrays) or not (np.diff(offsets) > 0).all():
        raise ValueError("each segment needs finite, strictly increasing times")
    instants = np.concatenate(arrays)
    later = instants[1:] > instants[:-1]
    later[offsets[1:-1] - 1] = True
    if not (np.isfinite(instants).all() and later.all()):
        raise ValueError("each segment needs finite, strictly increasing times")
    firsts = np.array([t[0] for t in arrays])
    if (np.diff(indices) < 0).any() or (np.diff(firsts)[np.diff(indices) == 0] <= 0).any():
        raise ValueError("segments must be in the order of runs, and of time within a run")
    steps = np.array(np.broadcast_to(np.asarray(step, dtype=np.float64), len(arrays)))
    if not (steps > 0).all():
        raise ValueError(f"a step must be positive, not {steps.min()}")
    runs = int(indices[-1]) + 1
    known = (*setups, *[BOTH] * (runs - len(setups)))
    return Segments(instants, offsets, indices, known, steps)


def initial_states(states: ArrayLike, segments: Segments) -> Array:
    """Convert initial states to (segments, 4) theta1, theta2, omega1, omega2, rad and rad/s.

    Raises:
        ValueError: the array has another shape.
    """
    states = np.array(states, dtype=np.float64, order="C")
    if states.shape != (len(segments), 4):
        raise ValueError(f"initial states must have shape ({len(segments)}, 4), not {states.shape}")
    return states

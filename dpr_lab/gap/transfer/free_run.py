"""Free runs: simulations of whole recordings from fitted initial states.

The initial state is fitted to the first readings only.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import without_events
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import Recordings


@dataclass(frozen=True, slots=True)
class FreeRunSettings:
    """Settings of the free runs."""

    settle_s: float = 0.3
    """Time after the first reading up to which readings determine the initial state, s."""
    length_s: float = 2.6
    """Length of the comparison from the first reading, s; later, chaos dominates."""
    iterations: int = 30


FREE_RUN = FreeRunSettings()


@dataclass(frozen=True, slots=True)
class FreeRunError:
    """Error of a free run as a function of time."""

    t: Array
    """(n,) time since the first reading, s."""
    squares: Array
    """(n,) squared error, mean over the joints, rad^2."""

    @property
    def rms_rad(self) -> float:
        """Root mean square over all times, rad."""
        return float(np.sqrt(np.mean(self.squares)))

    def followed_s(self, limit_rad: float) -> float:
        """Return the time up to which the cumulative rms error stays below a limit, s.

        The time is 0 if the error exceeds the limit from the beginning.
        """
        running = np.sqrt(np.cumsum(self.squares) / np.arange(1, len(self.t) + 1))
        below = np.logical_and.accumulate(running < limit_rad)
        return float(self.t[below][-1]) if below.any() else 0.0

    def until(self, end_s: float) -> "FreeRunError":
        """Return the part of the error up to a given time."""
        return FreeRunError(self.t[self.t <= end_s], self.squares[self.t <= end_s])


@dataclass(frozen=True)
class FreeRuns:
    """Free runs of one model along a set of recordings."""

    items: tuple[Record, ...]
    """Recordings, each from its first segment that can be simulated. Earlier readings before a gap may be too few."""
    problem: Problem
    """Problem with the compared readings, one segment for each recording."""
    start: Estimate
    """Estimate with an initial state, and optionally encoder zeros, for each recording."""

    @cached_property
    def predicted(self) -> Array:
        """(samples, 2) predicted readings, rad."""
        return self.problem.predict(self.start)

    @property
    def rows(self) -> list[slice]:
        """Slices of the samples, one for each recording."""
        return [slice(i, j) for i, j in pairwise(self.problem.segments.offsets)]

    @property
    def errors(self) -> dict[str, FreeRunError]:
        """Errors by run, after the readings that determine the initial state.

        Shorter runs are omitted.
        """
        error, t = self.problem.measured - self.predicted, self.problem.t
        by_run = {}
        for record, samples in zip(self.items, self.rows, strict=True):
            since_start, read = t[samples] - t[samples.start], self.problem.read[samples].any(axis=0)
            compared = since_start >= FREE_RUN.settle_s
            if compared.any():
                squares = np.mean(error[samples][compared][:, read] ** 2, axis=1)
                by_run[record.run.name] = FreeRunError(since_start[compared], squares)
        return by_run

    @property
    def errors_rad(self) -> dict[str, float]:
        """Rms error by run, rad, without runs that cannot be simulated to their end."""
        rms = {name: error.rms_rad for name, error in self.errors.items()}
        return {name: value for name, value in rms.items() if np.isfinite(value)}


def free_runs(recordings: Recordings, estimate: Estimate, length_s: float = FREE_RUN.length_s) -> FreeRuns:
    """Simulate a model freely along each recording.

    Args:
        recordings: the recordings; at least `MIN_SAMPLES` readings of each determine its initial state
        estimate: ratios and effects for the simulation
        length_s: length of the comparison from the first reading, s
    """
    items = tuple(
        record.only(slice(cut(record.t, np.inf, record.breaks)[0].start, None)) for record in recordings.records
    )
    own_starts = [_own_start(recordings, record, estimate) for record in items]
    compared = []
    for record in items:
        until = min(record.t[0] + length_s, *record.kicks[record.kicks > record.t[0]], np.inf)
        within = record.t <= until
        within[:MIN_SAMPLES] = True
        compared.append(replace(record.only(within), breaks=np.zeros(0)))
    problem, _ = (
        replace(recordings, ratios=None).only(compared).cut(np.inf)
    )  # nothing is fitted here, so the noise has no influence
    starts = np.concatenate([start.initial[:1] for start in own_starts])
    return FreeRuns(
        items, problem, estimate.changed(initial=starts, zeros=np.concatenate([start.zeros for start in own_starts]))
    )


def _own_start(recordings: Recordings, record: Record, estimate: Estimate) -> Estimate:
    """Fit the initial state of one recording to its first readings.

    The result is the estimate for this recording alone.
    """
    estimate = estimate.changed(params=without_events(estimate.params))
    head = record.t - record.t[0] < FREE_RUN.settle_s
    head[:MIN_SAMPLES] = True
    short = record.only(head)
    problem, initial = recordings.only([short]).cut(max(FREE_RUN.settle_s, float(np.ptp(short.t))))
    zeros = own_zeros(recordings.only([record]), estimate, FREE_RUN.iterations)
    fixed = replace(problem, rezeroed=False)
    return descend(fixed, estimate.changed(initial=initial, zeros=zeros), (), iterations=FREE_RUN.iterations).estimate


def own_zeros(recordings: Recordings, estimate: Estimate, iterations: int) -> Array:
    """Fit (runs, 2) encoder zeros to whole runs if they are set before each run.

    Otherwise the result is an array of shape (0, 2).
    """
    if not recordings.rig.encoders.rezeroed:
        return np.zeros((0, 2))
    problem, initial = recordings.cut(recordings.working_length)
    start = estimate.changed(initial=initial, zeros=np.zeros((0, 2)))
    return descend(problem, start, (), iterations=iterations).estimate.zeros

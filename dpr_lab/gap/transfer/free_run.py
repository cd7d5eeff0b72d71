"""A model that runs free along a recording: a start state fitted to its first readings, nothing after."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import without_events
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeRunSettings:
    """Settings of the free runs."""

    settle_s: float = 0.3
    """What the start state is fitted to."""
    length_s: float = 2.6
    """From the beginning to where the free run is compared: chaos takes over later."""
    iterations: int = 30


FREE_RUN = FreeRunSettings()


@dataclass(frozen=True)
class FreeRuns:
    """Recordings as one model runs along them."""

    items: tuple[Record, ...]
    """Each from where it can be followed: before a break there may be too few readings for a start state."""
    problem: Problem
    """What is compared, a segment of each."""
    begun: Estimate
    """The model with a start state of each, and with the zeros of encoders that are zeroed before each run."""

    @cached_property
    def predicted(self) -> Array:
        """(samples, 2) what the model says of the readings, rad."""
        return self.problem.predict(self.begun)

    @property
    def rows(self) -> list[slice]:
        """Slices of the samples of each recording."""
        return [slice(i, j) for i, j in pairwise(self.problem.segments.offsets)]

    @property
    def errors_rad(self) -> dict[str, float]:
        """Run -> root mean square error after the readings that its initial state was fitted to, rad.

        Without a run that ends there, or that the model cannot follow to its end.
        """
        error, t = self.problem.measured - self.predicted, self.problem.t
        unseen = [error[own][t[own] - t[own.start] >= FREE_RUN.settle_s] for own in self.rows]
        read = [1 if item.run.setup.alone else 2 for item in self.items]
        rms = {
            item.run.name: float(np.sqrt(np.mean(of_run[:, :n] ** 2))) if len(of_run) else np.nan
            for item, of_run, n in zip(self.items, unseen, read, strict=True)
        }
        return {name: value for name, value in rms.items() if np.isfinite(value)}


def free_runs(recordings: Recordings, at: Estimate) -> FreeRuns:
    """Simulate a model freely for each recording.

    Args:
        recordings: the recordings; where the first readings of one are few, `MIN_SAMPLES` of them are fitted
        at: ratios and effects to simulate with
    """
    items = tuple(item.only(slice(cut(item.t, np.inf, item.breaks)[0].start, None)) for item in recordings.records)
    begun = [_begun(recordings, item, at) for item in items]
    compared = []
    for item in items:
        within = item.t - item.t[0] <= FREE_RUN.length_s
        within[:MIN_SAMPLES] = True
        compared.append(replace(item.only(within), breaks=np.zeros(0)))
    whole, _ = replace(recordings, ratios=None).only(compared).cut(np.inf)  # nothing is fitted: noise has no weight
    starts = np.concatenate([one.initial[:1] for one in begun])
    return FreeRuns(items, whole, at.changed(initial=starts, zeros=np.concatenate([one.zeros for one in begun])))


def _begun(recordings: Recordings, item: Record, at: Estimate) -> Estimate:
    """The model with the start state that the first readings of a recording show; by itself it is the first run."""
    at = at.changed(params=without_events(at.params))
    head = item.t - item.t[0] < FREE_RUN.settle_s
    head[:MIN_SAMPLES] = True
    short = item.only(head)
    problem, initial = recordings.only([short]).cut(max(FREE_RUN.settle_s, float(np.ptp(short.t))))
    zeros = own_zeros(recordings.only([item]), at, FREE_RUN.iterations)
    fixed = replace(problem, rezeroed=False)
    return descend(fixed, at.changed(initial=initial, zeros=zeros), (), iterations=FREE_RUN.iterations).estimate


def own_zeros(recordings: Recordings, at: Estimate, iterations: int) -> Array:
    """(runs, 2) zeros of encoders that are zeroed before each run, fitted to the whole run; (0, 2) where they stay."""
    if not recordings.rig.encoders.rezeroed:
        return np.zeros((0, 2))
    problem, initial = recordings.cut(LENGTHS.working)
    begun = at.changed(initial=initial, zeros=np.zeros((0, 2)))
    return descend(problem, begun, (), iterations=iterations).estimate.zeros

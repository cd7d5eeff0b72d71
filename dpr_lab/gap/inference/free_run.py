"""A model that runs free along a recording: a start state fitted to its first readings, nothing after."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.data.record import Record
from dpr_lab.gap.data.recordings import LENGTHS, Recordings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeRunSettings:
    """How a model runs free."""

    settle_s: float = 0.3
    """What the start state is fitted to."""
    length_s: float = 2.6
    """From the beginning to where the free run is compared: chaos takes over later."""
    iterations: int = 30


FREE_RUN = FreeRunSettings()


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a model says of one recording."""

    item: Record
    """From where it can be followed: before a break there may be too few readings for a start state."""
    problem: Problem
    """What is compared, as one segment."""
    begun: Estimate
    """The model with the start state, and with the zeros of this run where they are put anew."""

    @property
    def since(self) -> Array:
        """(n,) since the first reading, s."""
        return self.problem.t - self.problem.t[0]


def run_freely(recordings: Recordings, item: Record, at: Estimate, settings: FreeRunSettings = FREE_RUN) -> Forecast:
    """Let a model run along a recording.

    Args:
        recordings: whose rig it is
        item: the recording; where its first readings are few, `MIN_SAMPLES` of them are fitted
        at: ratios and effects to simulate with
        settings: what is fitted and compared
    """
    item = item.only(slice(cut(item.t, np.inf, item.breaks)[0].start, None))
    since = item.t - item.t[0]
    head = since < settings.settle_s
    head[:MIN_SAMPLES] = True
    short = item.only(head)
    problem, initial = recordings.only([short]).cut(max(settings.settle_s, float(np.ptp(short.t))))
    zeros = own_zeros(recordings.only([item]), at, settings.iterations)
    fixed = replace(problem, rezeroed=False)
    begun = fit(fixed, replace(at, initial=initial, zeros=zeros), (), iterations=settings.iterations).estimate
    compared = replace(item.only(since <= settings.length_s), breaks=np.zeros(0))
    whole, _ = recordings.only([compared]).cut(np.inf)
    return Forecast(item, whole, replace(begun, initial=begun.initial[:1]))


def free_run_errors(recordings: Recordings, at: Estimate) -> dict[str, float]:
    """Run -> rms error of its free run after the readings that the start state was fitted to, rad."""
    return {item.run.name: _error(run_freely(recordings, item, at)) for item in recordings.records}


def own_zeros(recordings: Recordings, at: Estimate, iterations: int) -> Array:
    """(runs, 2) zeros of recordings that were put anew before each, by the whole of each; (0, 2) where they stay."""
    if not recordings.rig.encoders.rezeroed:
        return np.zeros((0, 2))
    problem, initial = recordings.cut(LENGTHS.working)
    begun = replace(at, initial=initial, zeros=np.zeros((0, 2)))
    return descend(problem, begun, (), iterations=iterations).estimate.zeros


def _error(run: Forecast) -> float:
    unseen = run.since >= FREE_RUN.settle_s
    read = 1 if run.item.run.setup.alone else 2
    error = run.problem.measured - run.problem.predict(run.begun)
    return float(np.sqrt(np.mean(error[unseen, :read] ** 2)))

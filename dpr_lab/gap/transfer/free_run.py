"""Free runs: simulations of whole recordings from fitted initial states.

`FreeSwing` contains the sensitivities of a free run. Let J0 be the Jacobian of the predicted readings r with respect to
the initial state, and W the inverse of the noise. The initial state is fitted to the first readings, with the index h.
A change dr of the predicted readings therefore also changes the initial state, so that

    dr - J0 (J0_h^T W^2 J0_h)^-1 J0_h^T W^2 dr_h

remains. `refitted_changes` returns this remaining change.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import without_events
from dpr_lab.fitting.cut import MIN_SAMPLES, cut
from dpr_lab.fitting.estimate import Estimate, FreeParameter
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.linearise import slow_starts
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class FreeRunSettings:
    """Settings of the free runs."""

    settle_s: float = 0.3
    """Time after the first reading up to which readings determine the initial state, s."""
    length_s: float = 2.6
    """End of the comparison, s after the first reading; later, chaos dominates."""
    iterations: int = 30
    """Maximum number of iterations of the fit of the initial state."""
    lost_rad: float = 0.1
    """Standard deviation of an angle, due to the uncertain initial state, at the predictability horizon, rad."""


FREE_RUN = FreeRunSettings()


@dataclass(frozen=True, slots=True)
class FreeRunError:
    """Error of a free run as a function of time, after the readings that determine the initial state."""

    t: Array
    """(n,) time since the first reading, s."""
    squares: Array
    """(n,) squared error, mean over the joints, rad^2."""

    @property
    def rms_rad(self) -> float:
        """Root mean square over all times, rad."""
        return float(np.sqrt(np.mean(self.squares)))

    def followed_s(self, limit_rad: float) -> float:
        """Return the time up to which the rms error from the beginning stays below a limit, s.

        The time is 0 if the first error exceeds the limit.
        """
        running = np.sqrt(np.cumsum(self.squares) / np.arange(1, len(self.t) + 1))
        below = np.logical_and.accumulate(running < limit_rad)
        return float(self.t[below][-1]) if below.any() else 0.0

    def until(self, end_s: float) -> "FreeRunError":
        """Return the error truncated at a given time."""
        return FreeRunError(self.t[self.t <= end_s], self.squares[self.t <= end_s])


@dataclass(frozen=True, slots=True)
class FreeSwing:
    """Free run of a model along a recording, with its sensitivities."""

    record: Record
    t: Array
    """(n,) time since the first reading, s."""
    measured: Array
    """(n, 2) readings of the joints, rad."""
    weight: Array
    """(n, 2) inverse standard deviation of the noise, 1/rad; zero where a reading is missing."""
    predicted: Array
    """(n, 2) predicted readings, rad."""
    by_values: Array
    """(n, 2, free) Jacobian of the readings with respect to the fitted values."""
    by_start: Array
    """(n, 2, 4) Jacobian of the readings with respect to the initial state; (n, 3, 6) with an arm that moves."""
    setup: Setup
    """Mounted rods and motion of the arm."""

    @property
    def head(self) -> Flags:
        """(n,) mask of the readings to which the initial state was fitted."""
        return self.t < FREE_RUN.settle_s

    @property
    def compared(self) -> Flags:
        """(n, 2) mask of the readings that can be compared: those after the head that are not missing."""
        return (self.weight > 0) & ~self.head[:, None]

    @property
    def _normal(self) -> tuple[Array, Array]:
        """Normal matrix (4, 4) of the initial state, and weighted Jacobian (rows, 4); 6 columns if the arm moves."""
        A = (self.weight[:, :, None] * self.by_start)[self.head].reshape(-1, self.by_start.shape[2])
        slow = np.diag(slow_starts(self.setup, A.shape[1]))
        return A.T @ A + slow.T @ slow, A

    def refitted_changes(self, change: Array) -> Array:
        """Return the (n, 2, k) changes of the readings after a refit of the initial state."""
        normal, A = self._normal
        rows = (self.weight[:, :, None] * change)[self.head].reshape(len(A), -1)
        return change - self.by_start @ (_inverse(normal) @ (A.T @ rows))

    def start_variance(self) -> Array:
        """Return the (n, 2) prediction variance due to noise of the first readings, rad^2."""
        inner = _inverse(self._normal[0])
        return np.einsum("nij,jk,nik->ni", self.by_start, inner, self.by_start)


def _inverse(normal: Array) -> Array:
    """Return the pseudoinverse of a (4, 4) or (6, 6) normal matrix, computed with scaled columns."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), np.finfo(np.float64).tiny))
    return scale[:, None] * np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * scale


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """Free runs of one model along a set of recordings."""

    records: tuple[Record, ...]
    """Recordings, each from the beginning of its first segment. Readings before a gap that are too few are left out."""
    problem: Problem
    """Problem with the compared readings, one segment for each recording."""
    start: Estimate
    """Estimate with the initial state and, if they are set before each run, the encoder zeros of each recording."""
    free: tuple[FreeParameter, ...] = ()
    """Fitted values, with respect to which the sensitivities are computed."""

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

        Runs without later readings are omitted.
        """
        error, t = self.problem.measured - self.predicted, self.problem.t
        by_run = {}
        for record, samples in zip(self.records, self.rows, strict=True):
            since_start, read = t[samples] - t[samples.start], self.problem.read[samples].any(axis=0)
            compared = since_start >= FREE_RUN.settle_s
            if compared.any():
                squares = np.mean(error[samples][compared][:, read] ** 2, axis=1)
                by_run[record.run.name] = FreeRunError(since_start[compared], squares)
        return by_run

    @property
    def errors_rad(self) -> dict[str, float]:
        """Rms error by run, rad, without runs whose simulation fails."""
        rms = {name: error.rms_rad for name, error in self.errors.items()}
        return {name: value for name, value in rms.items() if np.isfinite(value)}

    @cached_property
    def swings(self) -> list[FreeSwing]:
        """Free run of each recording, with its sensitivities to the fitted values and to the initial state."""
        free, problem = self.free, self.problem
        t, states = problem.t, problem.segments.states
        # the derivatives with respect to encoder zeros are zero, because the zeros of these runs are treated as known
        slopes = np.zeros((len(t), problem.axes, len(free) + states))
        moves = [i for i, parameter in enumerate(free) if parameter.block != "zeros"]
        of_values = problem.slopes(self.start, [free[i] for i in moves])
        slopes[:, :, [*moves, *range(len(free), len(free) + states)]] = of_values
        slopes = np.nan_to_num(slopes)
        parts = (problem.measured, problem.weight, self.predicted, slopes[:, :, :-states], slopes[:, :, -states:])
        return [
            FreeSwing(record, t[rows] - t[rows.start], *(values[rows] for values in parts), setup=setup)
            for record, setup, rows in zip(self.records, problem.segments.setups, self.rows, strict=True)
        ]

    def expected_errors(self, noise: float) -> dict[str, FreeRunError]:
        """Return the errors that the noise of the first readings is expected to cause, in the form of `errors`.

        `noise` is a factor on the variance of a reading, for the level and the correlation of the noise.
        """
        expected = {}
        for swing in self.swings:
            read, after = swing.weight.any(axis=0), ~swing.head
            if after.any():
                squares = noise * np.mean(swing.start_variance()[after][:, read], axis=1)
                expected[swing.record.run.name] = FreeRunError(swing.t[after], squares)
        return expected

    def changes_with(self, change: Callable[[Problem], Problem]) -> list[Array]:
        """Simulate a changed problem; return the (n, 2) change of the predicted readings of each run, rad."""
        change_of_all = np.nan_to_num(change(self.problem).predict(self.start) - self.predicted)
        return [change_of_all[rows] for rows in self.rows]


def free_runs(
    recordings: Recordings,
    estimate: Estimate,
    length_s: float = FREE_RUN.length_s,
    free: tuple[FreeParameter, ...] = (),
) -> FreeRuns:
    """Simulate a model freely along each recording.

    Args:
        recordings: the recordings; at least `MIN_SAMPLES` readings of each determine its initial state
        estimate: ratios and effects for the simulation
        length_s: end of the comparison, s after the first reading; a disturbance ends it earlier
        free: fitted values with respect to which sensitivities are computed
    """
    cuts = (cut(record.t, np.inf, record.breaks)[0] for record in recordings.records)
    records = tuple(record.only(slice(part.start, None)) for record, part in zip(recordings.records, cuts, strict=True))
    starts = [_own_start(recordings, record, estimate) for record in records]
    compared = []
    for record in records:
        until = min(record.t[0] + length_s, *record.kicks[record.kicks > record.t[0]], np.inf)
        within = record.t <= until
        within[:MIN_SAMPLES] = True
        compared.append(replace(record.only(within), breaks=np.zeros(0)))
    # nothing is fitted here, so the noise has no influence
    problem, initial = replace(recordings, ratios=None).only(compared).cut(np.inf)
    for state, start in zip(initial, starts, strict=True):
        state[: start.initial.shape[1]] = start.initial[0]  # a clamped arm keeps its angle
    zeros = np.concatenate([start.zeros for start in starts])
    return FreeRuns(records, problem, estimate.changed(initial=initial, zeros=zeros), free)


def _own_start(recordings: Recordings, record: Record, estimate: Estimate) -> Estimate:
    """Return the estimate for one recording alone, with the initial state fitted to its first readings."""
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


def horizon(swing: FreeSwing) -> float | None:
    """Return the predictability horizon of a free run, s; None if the run ends before it.

    At this time the uncertain initial state causes the error `FreeRunSettings.lost_rad`.
    """
    lost = np.flatnonzero((swing.start_variance() * (swing.weight > 0)).max(axis=1) > FREE_RUN.lost_rad**2)
    lost = lost[~swing.head[lost]]
    return float(swing.t[lost[0]]) if len(lost) else None


def growth_rate(swing: FreeSwing, until: float) -> float:
    """Return the largest mean growth rate of an initial angle error until the time `until`, 1/s.

    Source: largest singular value of the tangent map over a finite time; E. N. Lorenz (1965), Tellus 17, 321-333.
    """
    last = int(np.searchsorted(swing.t, until, side="right")) - 1
    largest = float(np.linalg.norm(swing.by_start[last, :, :2], ord=2))
    return float(np.log(max(largest, 1e-12)) / max(float(swing.t[last]), 1e-12))

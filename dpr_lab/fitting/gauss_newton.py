"""Bounded, damped Gauss-Newton method for free parameters and initial states.

    minimise  sum over segments s, samples k  | w_sk (y_sk - predicted(t_sk; p, x_s)) |^2  +  prior of p

The prior is that of the rig file, `dpr_lab.fitting.prior`. An amplitude is fixed during a step if the recordings cannot
distinguish it from the base parameters, the zeros, the initial states or the preceding amplitudes.

An iteration (`iterate`) solves the projected normal equations of `dpr_lab.fitting.linearise` for the parameters; the
initial states follow from them. A step that does not reduce the cost is shortened. If the fit becomes worse only in
some segments, the steps of their initial states are reduced first. Otherwise a swing that passes near the upright
position would slow down the fit of all others. Each shorter step of the parameters again starts with full steps of the
initial states, which compensate for the change of the parameters. If no step length reduces the cost, the damping is
increased. If the predicted reduction is below the tolerance, only the full step is tried. If a step reduces the cost as
predicted, the Jacobian is frozen, so that the next iteration uses it again.

A fit without free parameters changes only the initial states, as for a held-out run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.fitting.estimate import Estimate, FreeParameter, moved
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace


class StopReason(Enum):
    """Reason why the iteration ended."""

    CONVERGED = "the cost no longer decreases, or no reduction is predicted"
    NO_DESCENT = "no step of any length or damping reduces the cost"
    LOST = "the model can follow no segment from these initial states"
    MAXIMUM_ITERATIONS = "the maximum number of iterations was reached"
    PRELIMINARY = "the residual far exceeds the noise, and a step reduces the cost by a small share only"
    BEATEN = "another fit of the same set is better, and the predicted reduction is not sufficient to reach it"


@dataclass(frozen=True, slots=True)
class GaussNewton:
    """Tolerances and step control of the iteration."""

    converged: float = 1e-4
    """Relative reduction of the cost by a full step at which the iteration ends.

    The corresponding change of the values is far smaller than their uncertainty due to noise.
    """
    linearity: float = 0.1
    """Maximum relative difference between actual and predicted reduction for which the Jacobian is frozen."""
    converged_frozen: float = 3e-6
    """Relative reduction of the cost at which the iteration ends with a frozen Jacobian.

    The limit is smaller than `converged`, because convergence is then linear.
    """
    amplitude_change: float = 0.2
    """Relative change of an amplitude beyond which the derivative of its effect's shape is recomputed at the end."""
    tries: int = 6
    """Number of step lengths before a step counts as failed; of 1817 steps in 15 diagnoses, three needed more."""
    shorten: float = 0.3
    """Factor on the length of a step that did not reduce the cost."""
    shorten_segment: float = 0.1
    """Factor on the initial-state steps of segments whose cost increases, if these are at most half of all segments."""
    least_damping: float = 1e-9
    """Initial damping, relative to columns of unit norm."""
    lower_damping: float = 0.1
    """Factor on the damping after a successful step."""
    raise_damping: float = 1e3
    """Factor on the damping after a failed step."""
    raised_damping: float = 1e-3
    """Smallest damping after a failed step. A damping of 1e-6 improved none of 28 fits of two driven rigs."""
    most_damping: float = 0.1
    """Largest damping that is tried; with more damping no step is expected to reduce the cost."""
    same_step: float = 1e-3
    """Relative difference from a failed step below which a step with more damping is not tried."""
    preliminary: float = 0.0
    """Relative reduction of the cost at which a fit far above the noise ends; 0: only `converged` ends the fit."""
    far: float = 20.0
    """Maximum chi2 per reading of a fit that counts as near the noise."""
    to_beat: float = np.inf
    """chi2 of the best fit so far.

    The iteration ends if even `exceeded` times the predicted reduction would not reach this value.
    """
    exceeded: float = 2.0
    """Largest expected ratio of the reduction by all further steps to that predicted for the next step."""
    race: bool = False
    """Whether `to_beat` is the chi2 of another fit of the same set.

    The iteration then also ends if a step fails while chi2 exceeds `to_beat`, or if `further` steps would not reach
    `to_beat`.
    """
    further: float = 8.0
    """Number of further steps in which a racing fit must reach `to_beat`.

    Each further step is assumed to reduce the cost as much as the better of the last two.
    """


GAUSS_NEWTON = GaussNewton()


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted estimate with its linearisation."""

    estimate: Estimate
    free: tuple[FreeParameter, ...]
    linear: Linearisation
    stop: StopReason
    iterations: int = 0
    prior: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, free) rows of the prior for the free parameters; empty if there is no prior."""
    absorbed: tuple[int, ...] = ()
    """Indices of the amplitudes that the preceding unknowns absorb (`Prior.absorbed`)."""

    @property
    def converged(self) -> bool:
        """Whether further iterations would not change the result."""
        return self.stop not in (StopReason.MAXIMUM_ITERATIONS, StopReason.PRELIMINARY, StopReason.BEATEN)

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return self.linear.chi2

    @property
    def values(self) -> Array:
        """(free,) fitted values of the free parameters."""
        return np.array([parameter.read(self.estimate) for parameter in self.free])

    @property
    def inside(self) -> list[int]:
        """Indices of the free parameters that are neither at their bounds nor absorbed."""
        return [
            i
            for i, parameter in enumerate(self.free)
            if parameter.lower < parameter.read(self.estimate) < parameter.upper and i not in self.absorbed
        ]


@dataclass(frozen=True, slots=True)
class Iteration:
    """State of the solver before or after an iteration."""

    estimate: Estimate
    predicted: Array | None
    """(samples, 2) readings at the estimate, rad; None if they were computed only for the linearisation."""
    chi2: float
    linear: Linearisation
    """Residuals and Jacobian of the last step."""
    linearised_at: Estimate
    """Estimate at which the Jacobian of `linear` was computed."""
    current: bool
    """Whether the residuals of `linear` are those of the estimate."""
    damping: float
    frozen_jacobian: bool = False
    """Whether the last step was linear enough to use the Jacobian again."""
    reduction: float = np.inf
    """Reduction of the cost by the last step; inf before the first step."""
    failed: Array | None = None
    """(free,) step from this estimate of which no length reduced the cost; None if there is no such step."""
    number: int = 0
    stop: StopReason | None = None


def fit(
    problem: Problem,
    start: Estimate,
    free: Sequence[FreeParameter],
    *,
    iterations: int = 12,
    predicted: Array | None = None,
    settings: GaussNewton = GAUSS_NEWTON,
) -> Fit:
    """Fit the free parameters and all initial states, and linearise at the result.

    Args:
        problem: measured readings, weights and model
        start: initial estimate; parameters that are not free keep its values
        free: free parameters in addition to the initial states
        iterations: maximum number of iterations
        predicted: (samples, 2) readings at `start`, if known
        settings: tolerances and step control
    """
    free = problem.all_free(free)
    end = descend(problem, start, free, iterations=iterations, predicted=predicted, settings=settings)
    assert end.stop is not None
    usable = end.stop is StopReason.BEATEN or not (
        end.stop is StopReason.MAXIMUM_ITERATIONS or _amplitude_changed(end, free, settings)
    )
    exact = end.current and end.linearised_at is end.estimate
    if exact or (end.current and usable):
        linear = end.linear
    else:
        shifted = end.linear.carried(problem, end.predicted) if usable and end.predicted is not None else None
        linear = shifted or linearise(problem, end.estimate, free, end.predicted)
    prior = RigPrior.at(problem, end.estimate, free, linear)
    absorbed = tuple(np.flatnonzero(prior.absorbed(ColumnSpace.of(*linear.flat))).tolist())
    return Fit(end.estimate, free, linear, end.stop, end.number, prior.A / prior.weight**0.5, absorbed)


@dataclass(frozen=True, slots=True)
class RigPrior:
    """Prior of the rig file as a term of the cost, |e - A step|^2."""

    problem: Problem
    estimate: Estimate
    free: tuple[FreeParameter, ...]
    A: Array
    """(n, free) one row per free parameter; no rows if there is no prior.

    `A @ step` is the step in standard deviations of the prior, times the square root of `weight`.
    """
    e: Array
    """(n,) difference between the mean of the prior and `estimate`, in the units of `A @ step`."""
    weight: float
    """Chi2 of a deviation by one standard deviation of the prior."""

    @classmethod
    def at(
        cls, problem: Problem, estimate: Estimate, free: tuple[FreeParameter, ...], linear: Linearisation
    ) -> "RigPrior":
        """Return the prior for steps from `estimate`, with the weight that the residual of `linear` implies."""
        if problem.prior is None or not free:
            return cls(problem, estimate, free, np.zeros((0, len(free))), np.zeros(0), 1.0)
        A, e = problem.prior.rows(estimate, free)
        weight = problem.prior_weight(linear.chi2_by_segment)
        return cls(problem, estimate, free, weight**0.5 * A, weight**0.5 * e, weight)

    def cost(self, step: Array) -> float:
        """Return the cost of the prior after a step."""
        return float(np.sum((self.e - self.A @ step) ** 2))

    def absorbed(self, space: ColumnSpace) -> Flags:
        """Return the (free,) mask of the amplitudes that the preceding unknowns absorb (`Prior.absorbed`)."""
        if self.problem.prior is None:
            return np.zeros(len(self.free), dtype=np.bool_)
        return self.problem.prior.absorbed(space, self.estimate, self.free, (self.A, self.e))


def _amplitude_changed(end: Iteration, free: Sequence[FreeParameter], settings: GaussNewton) -> bool:
    """Return whether an amplitude changed so much that frozen shape derivatives must be recomputed."""
    shaped = {parameter.effect for parameter in free if not parameter.amplitude}
    amplitudes = [parameter for parameter in free if parameter.amplitude and parameter.effect in shaped]
    pairs = [(parameter.read(end.linearised_at), parameter.read(end.estimate)) for parameter in amplitudes]
    return any(abs(new - old) > settings.amplitude_change * abs(old) for old, new in pairs)


def descend(
    problem: Problem,
    start: Estimate,
    free: Sequence[FreeParameter],
    *,
    iterations: int,
    first: Linearisation | None = None,
    predicted: Array | None = None,
    settings: GaussNewton = GAUSS_NEWTON,
) -> Iteration:
    """Iterate as `fit` does, but without the final linearisation.

    See `fit` for the arguments; `first` is the linearisation at `start`, if known.
    """
    start, free = problem.with_zeros(start), problem.all_free(free)
    linear = first or linearise(problem, start, free, predicted)
    state = Iteration(start, predicted, linear.chi2, linear, start, True, settings.least_damping)
    while state.stop is None and state.number < iterations:
        state = iterate(problem, free, state, settings)
    return state if state.stop else replace(state, stop=StopReason.MAXIMUM_ITERATIONS)


def iterate(problem: Problem, free: tuple[FreeParameter, ...], state: Iteration, settings: GaussNewton) -> Iteration:
    """Take one damped step, with a new or a frozen Jacobian."""
    state = replace(_linearised(problem, free, state), number=state.number + 1)
    if not np.isfinite(state.linear.chi2_by_segment).any():
        return replace(state, stop=StopReason.LOST)
    frozen = state.linearised_at is not state.estimate
    prior = RigPrior.at(problem, state.estimate, free, state.linear)
    step = _step(state, free, prior)
    at_start = prior.cost(np.zeros(len(free)))
    predicted_reduction = state.chi2 + at_start - state.linear.predicted_chi2(step) - prior.cost(step)
    if state.chi2 - settings.exceeded * predicted_reduction > settings.to_beat:
        return replace(state, stop=StopReason.BEATEN)
    tolerance = (min(settings.converged_frozen, settings.converged) if frozen else settings.converged) * state.chi2
    worthwhile = not (np.isfinite(state.chi2) and predicted_reduction <= tolerance)
    failed = state.failed is not None and np.allclose(step, state.failed, rtol=settings.same_step, atol=0.0)
    tries = 0 if failed else settings.tries if worthwhile else 1
    trial = _line_search(problem, free, state, step, prior, settings, tries)
    if trial is None and frozen and worthwhile:
        return _linearised(problem, free, replace(state, current=False, frozen_jacobian=False))
    if trial is None:
        damping = max(state.damping * settings.raise_damping, settings.raised_damping)
        stop = StopReason.NO_DESCENT if damping > settings.most_damping else None
        stop = StopReason.BEATEN if settings.race and state.chi2 > settings.to_beat else stop
        return replace(state, damping=damping, failed=step, stop=stop if worthwhile else StopReason.CONVERGED)
    estimate, predicted, chi2, at_end = trial
    reduction = state.chi2 + at_start - chi2 - at_end
    return replace(
        state,
        estimate=estimate,
        predicted=predicted,
        chi2=chi2,
        current=False,
        damping=max(state.damping * settings.lower_damping, settings.least_damping),
        reduction=reduction,
        failed=None,
        frozen_jacobian=abs(reduction - predicted_reduction) <= settings.linearity * predicted_reduction,
        stop=_end(problem, state, reduction, tolerance, settings),
    )


def _end(
    problem: Problem, before: Iteration, reduction: float, tolerance: float, settings: GaussNewton
) -> StopReason | None:
    """Return the reason to stop after a step from the state `before` that reduces the cost only slightly.

    The result is None if the iteration must continue. If the residual is far above the noise, a preliminary fit stops
    already at a larger reduction, because the model error exceeds any small reduction. If the simulation of a segment
    failed before the step, chi2 was infinite and the reduction has no meaning.
    """
    chi2 = before.chi2
    if not np.isfinite(chi2):
        return None
    if reduction <= tolerance:
        return StopReason.CONVERGED
    if settings.race and chi2 - reduction - settings.further * max(reduction, before.reduction) > settings.to_beat:
        return StopReason.BEATEN
    far = chi2 > settings.far * problem.evidence
    return StopReason.PRELIMINARY if far and reduction <= settings.preliminary * chi2 else None


def _linearised(problem: Problem, free: tuple[FreeParameter, ...], state: Iteration) -> Iteration:
    """Return the state with the residuals at its estimate.

    The Jacobian is computed at this estimate unless the frozen Jacobian is used again.
    """
    if state.current:
        return state
    if state.frozen_jacobian and state.predicted is not None:
        shifted = state.linear.carried(problem, state.predicted)
        if shifted is not None:
            return replace(state, linear=shifted, current=True)
    linear = linearise(problem, state.estimate, free, state.predicted)
    return replace(state, linear=linear, linearised_at=state.estimate, current=True)


def _step(state: Iteration, free: tuple[FreeParameter, ...], prior: RigPrior) -> Array:
    """Return the (free,) damped step within bounds, zero for absorbed amplitudes."""
    if not free:
        return np.zeros(0)
    space = ColumnSpace.of(*state.linear.flat)
    room = bounds(state.estimate, free)
    room[:, prior.absorbed(space)] = 0.0
    return space.with_prior(prior.A, prior.e).solution(room, state.damping)


def bounds(estimate: Estimate, free: Sequence[FreeParameter]) -> Array:
    """Return the (2, free) lower and upper bounds of a step from an estimate."""
    value = np.array([parameter.read(estimate) for parameter in free])
    return np.array([[parameter.lower for parameter in free], [parameter.upper for parameter in free]]) - value


def _line_search(
    problem: Problem,
    free: tuple[FreeParameter, ...],
    state: Iteration,
    step: Array,
    prior: RigPrior,
    settings: GaussNewton,
    tries: int,
) -> tuple[Estimate, Array, float, float] | None:
    """Find a step length that reduces the cost.

    Returns:
        the estimate after the step, its predicted readings, its chi2, and the cost of the prior; None if no step length
        reduces the cost
    """
    before = state.linear.chi2_by_segment
    followed = np.isfinite(before)
    initial_steps = state.linear.initial_steps(step)
    length, segment_length = 1.0, np.ones(len(before))
    at_start = prior.cost(np.zeros(len(free)))
    for attempt in range(tries):
        trial = moved(state.estimate, free, length * step, (length * segment_length)[:, None] * initial_steps)
        predicted = problem.predict(trial)
        after = problem.chi2_by_segment(predicted)
        at_end = prior.cost(length * step)
        if after[followed].sum() + at_end <= before[followed].sum() + at_start:
            return trial, predicted, float(after.sum()), at_end
        worse = ~(after <= before)
        if attempt % 2 or worse.mean() > 0.5:
            length *= settings.shorten
            segment_length[:] = 1.0
        else:
            segment_length[worse] *= settings.shorten_segment
    return None

"""Detection of jumps of the speeds of the rods, or of a reading.

A generalised likelihood ratio test detects a change within one segment. In a linearised segment, a change at the
instant t_k adds h to the later readings,

    kick        h = C(t) Phi(t_k)^-1 [0; M^-1] p     with the impulses p of joints 1 and 2
    step        h = 1 in one joint                   of a reading

Here M is the inertia matrix. Phi is the derivative of the state with respect to the initial state of the segment, and C
is the derivative of the readings with respect to this initial state. The initial state of the segment and torques that
are polynomials in time are projected out. An error of the model acts along the whole segment, so the projection removes
most of it. For the whitened and projected residual e and response h, the change reduces chi2 by its gain (h e)^2 / h^2.
Cumulative sums over the later readings give the gains at all instants.

Source: Willsky & Jones (1976), A generalized likelihood ratio approach to the detection and estimation of jumps in
linear systems, IEEE Trans. Autom. Control 21, 108-112.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Integers, neighbours
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.gap.damage.steps import STEPS, step_gains, sums_to_end


@dataclass(frozen=True, slots=True)
class JumpRules:
    """Limits of the detection of jumps."""

    gain: float = 50.0
    """Minimum gain of a jump.

    Over the 1e4 instants of three recordings, the largest gain of white noise is about 25.
    """
    outstanding_step: float = 3.0
    """Minimum ratio of the gain of a step to the largest gain elsewhere."""
    outstanding_kick: float = 8.0
    """Minimum ratio of the gain of a kick to the largest gain elsewhere.

    In trials with effects and without kicks, the ratio was at most 1.7, except with load-dependent friction (5.2),
    which acts mostly where a swing is fastest.
    """
    others: int = 6
    """Minimum number of other segments with which a jump is compared."""
    most: float = 0.1
    """Maximum number of jumps as a share of the number of segments; at least two jumps are always permitted."""
    kick_torques: int = 0
    """Degree of the polynomial torques that are projected out for the detection of kicks.

    A polynomial of higher degree than a constant could imitate a kick.
    """
    step_torques: int = 2
    """Degree of the polynomial torques that are projected out for the detection of steps; no torque imitates a step."""
    margin: int = 3
    """Number of readings at either end of a segment in which no jump is sought."""
    kick_s: float = 0.06
    """Maximum time between the middle of a kick and a step of the residual that the kick may cause, s."""
    near_s: float = 0.1
    """Maximum distance of a jump from another segment whose gain it may increase, s."""


JUMP = JumpRules()


@dataclass(frozen=True, slots=True)
class Jump:
    """Kick of the rods, or step of a reading, at one time."""

    gain: float
    """Reduction of chi2 by the jump."""
    run: int
    at: float
    """Instant of the jump, midway between two readings, s."""
    joint: int | None
    """Index of the joint whose reading steps; None for a kick."""
    size: tuple[float, ...]
    """Size of the jump: changes of the speeds of both rods by a kick, rad/s, or the step of the reading, rad."""
    span: tuple[float, float]
    """First and last instant of the segment that contains the jump, s."""


def outstanding(candidates: Sequence[Jump], ratio: float) -> list[Jump]:
    """Return the jumps whose gains far exceed the gains of all other segments.

    Args:
        candidates: best jump of each segment; segments may overlap
        ratio: minimum ratio of the gains
    """
    events: list[Jump] = []
    for jump in sorted(candidates, key=lambda jump: -jump.gain):
        first, last = jump.span[0] - JUMP.near_s, jump.span[1] + JUMP.near_s
        if not any(event.run == jump.run and first < event.at < last for event in events):
            events.append(jump)
    most = min(max(2, int(JUMP.most * len(events))), len(events) - JUMP.others)
    gains = [event.gain for event in events]
    counts = [k for k in range(1, most + 1) if gains[k - 1] > max(ratio * gains[k], JUMP.gain)]
    return events[: max(counts, default=0)]


def jumps_of_segments(problem: Problem, fitted: Fit) -> tuple[list[Jump], list[Jump]]:
    """Return the best kick and the best step of a reading in each segment.

    Constant torques are projected out for kicks, parabolic torques for steps. The joint of a step is None if a kick of
    finite duration, or a single wrong reading, explains the residual equally well.
    """
    reference = trajectory(problem, fitted.estimate, spacing=TRAJECTORY.coarse_s)
    with_constant = _Changes.of(problem, fitted, reference, JUMP.kick_torques)
    with_parabola = _Changes.of(problem, fitted, reference, JUMP.step_torques)
    kick_gain, impulses = with_constant.kicks()
    gains, sizes = np.stack([with_parabola.steps(joint) for joint in range(2)], axis=1)  # both (joints, samples)
    joints, step_gain = np.argmax(gains, axis=0).tolist(), np.max(gains, axis=0)
    beyond_kick = np.max([with_constant.steps(joint)[0] for joint in range(2)], axis=0) > _highest_near(
        problem.t, kick_gain
    )
    certain = beyond_kick & (step_gain > with_parabola.outliers())
    instants = problem.t - 0.5 * np.diff(problem.t, prepend=problem.t[0])
    kicks, steps, ends = list[Jump](), list[Jump](), pairwise(problem.segments.offsets.tolist())
    for run, (first, last) in zip(problem.segments.run.tolist(), ends, strict=True):
        span = float(problem.t[first]), float(problem.t[last - 1])
        i = first + int(np.argmax(kick_gain[first:last]))
        kicks.append(Jump(float(kick_gain[i]), run, float(instants[i]), None, _speeds(reference, i, impulses[i]), span))
        i = first + int(np.argmax(step_gain[first:last]))
        joint, size = joints[i] if certain[i] else None, (float(sizes[joints[i], i]),)
        steps.append(Jump(float(step_gain[i]), run, float(instants[i]), joint, size, span))
    return kicks, steps


def _highest_near(t: Array, values: Array) -> Array:
    """Return the (n,) maximum of the values within `JUMP.kick_s` of each instant."""
    return neighbours(values, int(JUMP.kick_s / max(float(np.median(np.diff(t))), 1e-6))).max(axis=1)


def _speeds(reference: Trajectory, sample: int, impulses: Array) -> tuple[float, ...]:
    """Convert impulses on theta1 and theta2, N m s, to changes of the speeds, rad/s."""
    i = round(float(reference.at[sample]))
    setup = reference.motion.run[i]
    a, b, d, *_ = reference.bases[setup]
    if reference.setups[setup].held:
        change = float(impulses.sum() / (a + b + 2 * d * np.cos(np.diff(reference.motion.theta[i])[0])))
        return change, change
    coupling = d * np.cos(reference.motion.theta[i, 0] - reference.motion.theta[i, 1])
    return tuple(np.linalg.solve([[a, coupling], [coupling, b]], impulses).tolist())


@dataclass(frozen=True, slots=True)
class _Changes:
    """Residuals of all samples, and the columns that are projected out of the residuals."""

    e: Array
    """(samples, 2) whitened and projected residual."""
    weight: Array
    """(samples, 2) weights of the readings, 1/rad."""
    Q: Array
    """(samples, 2, q) orthonormal columns of the initial state and of the polynomial torques."""
    out: Array
    """(samples, 2, 4) change of the weighted readings per change of the initial state."""
    into: Array
    """(samples, 4, 2) change of the initial state that is equivalent to a unit impulse just before the sample."""
    begins: Integers
    """(samples,) index of the first sample of the segment that contains the sample."""
    ends: Integers
    """(samples,) index of the first sample of the next segment."""

    @classmethod
    def of(cls, problem: Problem, fitted: Fit, reference: Trajectory, degree: int) -> "_Changes":
        """Project initial states and polynomial torques of a given degree out of the residuals of a fit."""
        owner, offsets = problem.owner, problem.segments.offsets
        residual = np.where(np.isfinite(fitted.linear.residual), fitted.linear.residual, 0.0)
        Q = np.concatenate([fitted.linear.Q, _of_torques(problem, fitted, reference, degree)], axis=2)
        e = residual - (Q @ (Q.transpose(0, 2, 1) @ residual[:, :, None]))[:, :, 0]
        by_row = Q.reshape(len(Q), -1, 2, Q.shape[2])[owner, np.arange(len(owner)) - offsets[owner]]
        before = np.maximum(np.ceil(reference.at).astype(np.int64) - 1, reference.edges[owner])
        return cls(
            e=problem.by_sample(e),
            weight=problem.weight,
            Q=by_row,
            out=reference.out * problem.weight[:, :, None],
            into=reference.into[before],
            begins=offsets[owner],
            ends=offsets[owner + 1],
        )

    def kicks(self) -> tuple[Array, Array]:
        """Compute the kick just before each sample that reduces chi2 most.

        Returns:
            (samples,) gain, and (samples, 2) impulses on theta1 and theta2, N m s
        """
        score = sums_to_end(np.einsum("nas,na->ns", self.out, self.e), self.ends)
        power = sums_to_end(np.einsum("nas,nar->nsr", self.out, self.out), self.ends)
        shared = sums_to_end(np.einsum("nas,naq->nsq", self.out, self.Q), self.ends)
        across = self.into.transpose(0, 2, 1)
        along = (across @ score[:, :, None])[:, :, 0]
        total, remaining = across @ power @ self.into, across @ (power - shared @ shared.transpose(0, 2, 1)) @ self.into
        sizes, axes = np.linalg.eigh(remaining)
        # By rounding, the trace of a kick without an effect on the readings may be negative.
        visible = sizes > np.maximum(STEPS.seen * np.trace(total, axis1=1, axis2=2)[:, None], 0.0)
        components = np.einsum("nij,ni->nj", axes, along)
        weights = np.where(visible, components / np.where(visible, sizes, 1.0), 0.0)
        return self._inside(np.sum(components * weights, axis=1)), np.einsum("nij,nj->ni", axes, weights)

    def steps(self, joint: int) -> tuple[Array, Array]:
        """Fit a step of the reading of one joint just before each sample.

        Returns:
            (samples,) gain, and (samples,) size, rad
        """
        gain, size = step_gains(self.weight[:, joint], self.e[:, joint], self.Q[:, joint], self.ends)
        return self._inside(gain), size

    def outliers(self) -> Array:
        """Return the (samples,) gain of a single wrong reading near each sample.

        The gain is the reduction of chi2 if the sample itself or one of its neighbours is left out.
        """
        remaining = 1.0 - np.sum(self.Q**2, axis=2)
        gain = np.max(self.e**2 / np.maximum(remaining, STEPS.seen), axis=1)
        return np.maximum(gain, np.maximum(np.roll(gain, 1), np.roll(gain, -1)))

    def _inside(self, gain: Array) -> Array:
        sample = np.arange(len(gain))
        return np.where((sample - self.begins >= JUMP.margin) & (self.ends - sample >= JUMP.margin), gain, 0.0)


def _of_torques(problem: Problem, fitted: Fit, reference: Trajectory, degree: int) -> Array:
    """Return an orthonormal basis (segments, m, k) of the responses of the readings to polynomial torques.

    The initial states are projected out of the responses.
    """
    t, edges = reference.motion.t, reference.edges
    begin, end = (np.repeat(t[places], np.diff(edges)) for places in (edges[:-1], edges[1:] - 1))
    powers = ((2 * t - begin - end) / (end - begin))[:, None] ** np.arange(degree + 1)
    torques = np.zeros((len(t), 2, 2 * (degree + 1)))
    torques[:, 0, : degree + 1] = torques[:, 1, degree + 1 :] = powers
    response, Q = reference.response(problem, torques), fitted.linear.Q
    response /= np.maximum(np.linalg.norm(response, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    response -= Q @ (Q.transpose(0, 2, 1) @ response)
    left, sizes, _ = np.linalg.svd(response, full_matrices=False)
    return left * (sizes > STEPS.seen)[:, None, :]

r"""Fisher information of planned releases on ratios and effects, for many releases at once.

A release is simulated at the present estimate and cut into the segments that a diagnosis fits. With A_s the whitened
slopes of segment s by ratios and amplitudes, its initial state projected out,

    H = sum over segments before the horizon of A_s^T A_s.

The horizon is the predictability of the planned swing: with Phi(t) the sensitivity of the state to the start pose and
s the standard deviation of the pose as a hand leaves it, it ends where s |Phi(t)| exceeds a limit. After that the swing
is another one than the one planned, and what it would show is not counted.

The slopes of all columns, releases and segments are one batch of lanes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.segments import segments
from dpr_lab.fitting.estimate import Estimate, FreeParameter
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods import followed
from dpr_lab.fitting.rods_with_effects import ENCODER_AMPLITUDES, RodsWithEffects
from dpr_lab.gap.screen.recordings import LENGTHS
from dpr_lab.planning.release import CandidateRelease

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SwingSettings:
    """How a planned release is simulated."""

    rate_hz: int = 50
    """Instants at which readings are compared; each stands for all that are taken until the next."""
    path_hz: int = 200
    """Instants of the swing from which speeds at the start of segments are differences."""
    step_s: float = 5e-3
    """Longest Runge-Kutta step; slopes take twice that."""
    horizon_hz: int = 20
    """Instants at which predictability is checked."""
    lost_rad: float = 0.5
    """Standard deviation of an angle from which the swing counts as another one than planned."""
    batch: int = 16
    """Releases at a time, to stay within memory."""


SWING = SwingSettings()


@dataclass(frozen=True, slots=True)
class PresentModel:
    """The rig as it is known now, and what is unknown of it."""

    estimate: Estimate
    """Ratios and effects; no segments."""
    columns: tuple[FreeParameter, ...]
    """The unknowns: ratios, b and p/b, then amplitudes of effects."""
    rods: RodsWithEffects
    noise: Array
    """(2,) standard deviation of the mean of one second of readings, rad sqrt(s)."""
    placement_rad: float
    """Standard deviation of a start pose."""
    rezeroed: bool = False
    """Whether the encoders are zeroed before each recording, so that each has zeros of its own."""


@dataclass(frozen=True, slots=True)
class Informed:
    """One release, and what it is expected to show."""

    release: CandidateRelease
    information: Array
    """(k, k) Fisher information of the unknowns."""
    horizon_s: float
    """Predictability horizon, at most its duration."""


def informed(
    releases: Sequence[CandidateRelease], model: PresentModel, durations: Sequence[float] = ()
) -> list[Informed]:
    """Simulate releases and compute their information.

    Args:
        releases: what could be recorded
        model: the present estimate
        durations: shorter durations that each release is rated at too, s

    Returns:
        each release, in order, at its own duration and at those that are shorter
    """
    rated = []
    for batch in _batches(releases):
        horizons, slopes = _horizons(batch, model), _slopes(batch, model)
        for release, horizon, A in zip(batch, horizons, slopes, strict=True):
            for duration in (release.duration_s, *(d for d in durations if d < release.duration_s)):
                seen = A[: max(1, round(duration / LENGTHS.working))].reshape(-1, A.shape[2])
                shorter = replace(release, duration_s=duration)
                rated.append(Informed(shorter, seen.T @ seen, float(min(horizon, duration))))
    return rated


def _batches(releases: Sequence[CandidateRelease]) -> Iterator[list[CandidateRelease]]:
    """Neighbours of one duration, some at a time."""
    for _, group in groupby(releases, key=lambda one: one.duration_s):
        alike = list(group)
        yield from (alike[i : i + SWING.batch] for i in range(0, len(alike), SWING.batch))


def simulated_states(batch: Sequence[CandidateRelease], model: PresentModel) -> Array:
    """(releases, n, 4) states at `path_hz` from the release on, effects included, rad and rad/s."""
    t = np.arange(1, round(batch[0].duration_s * SWING.path_hz) + 1) / SWING.path_hz
    whole = segments([t] * len(batch), range(len(batch)), [one.setup for one in batch], SWING.step_s)
    still = model.estimate.params.copy()
    still[ENCODER_AMPLITUDES] = 0.0
    starts = np.array([one.start for one in batch])
    joints = predict(model.estimate.whole, still, model.rods.constants, whole, starts)
    theta = np.concatenate([starts[:, None, :2], joints.reshape(len(batch), len(t), 2)], axis=1)
    theta[:, 1:, 1] += model.rods.constants.relative2 * theta[:, 1:, 0]
    omega = np.gradient(theta, 1 / SWING.path_hz, axis=1)
    omega[:, 0] = 0.0
    return np.concatenate([theta, omega], axis=2)


def laid_out(batch: Sequence[CandidateRelease], model: PresentModel) -> tuple[Problem, Array]:
    """Releases of one duration cut into segments, readings zero, and (segments, 4) states where those start.

    A segment starts `PAD`, one sample, before its first sample; the first one at the release.
    """
    path, rate = simulated_states(batch, model), SWING.rate_hz
    length, apart = round(LENGTHS.working * rate), SWING.path_hz // rate
    count = (path.shape[1] - 1) // apart // length
    instants = [(k * length + np.arange(1, length + 1)) / rate for k in range(count)]
    states = path[:, np.arange(count) * length * apart].reshape(-1, 4)
    run = np.repeat(np.arange(len(batch)), count)
    cut = segments(instants * len(batch), run, [one.setup for one in batch], SWING.step_s)
    weight = _weight(batch, model, count * length)
    return Problem(cut, np.zeros((len(cut.t), 2)), weight, model.rods), states


def _slopes(batch: Sequence[CandidateRelease], model: PresentModel) -> Array:
    """(releases, segments, m, k) whitened slopes of all columns, initial states and own zeros projected out."""
    problem, states = laid_out(batch, model)
    linear = linearise(problem, model.estimate.changed(initial=states), model.columns, predicted=problem.measured)
    A = linear.A.reshape(len(batch), -1, *linear.A.shape[1:])
    return _without_zeros(A, linear, problem, len(batch)) if model.rezeroed else A


def _weight(batch: Sequence[CandidateRelease], model: PresentModel, samples: int) -> Array:
    """(samples, 2) one over the noise of a reading; none of a joint that is not there."""
    read = np.array([[1.0, float(not one.setup.alone)] for one in batch])
    return np.repeat(read / (model.noise * np.sqrt(SWING.rate_hz)), samples, axis=0)


def _without_zeros(A: Array, linear: Linearisation, problem: Problem, releases: int) -> Array:
    """Jacobian with the zero errors of each release's encoders projected out."""
    shifts = np.broadcast_to(np.eye(2), (len(problem.t), 2, 2))
    zeros = linear.projected(problem.whitened(shifts)).reshape(releases, -1, 2)
    flat = A.reshape(releases, zeros.shape[1], -1)
    return np.stack(
        [own - z @ np.linalg.lstsq(z, own, rcond=1e-9)[0] for own, z in zip(flat, zeros, strict=True)]
    ).reshape(A.shape)


def _horizons(batch: Sequence[CandidateRelease], model: PresentModel) -> Array:
    """(releases,) until when the swing is the one planned, s."""
    t = np.arange(1, round(batch[0].duration_s * SWING.horizon_hz) + 1) / SWING.horizon_hz
    whole = segments([t] * len(batch), range(len(batch)), [one.setup for one in batch], SWING.step_s)
    starts = np.array([one.start for one in batch])
    _, slopes = followed(model.estimate.ratios, whole, starts, model.rods.constants, of=2)
    by_pose = slopes[:, :, len(RATIOS) : len(RATIOS) + 2].reshape(len(batch), len(t), 2, 2)
    spread = model.placement_rad * np.sqrt(np.sum(by_pose**2, axis=3)).max(axis=2)
    lost = ~(spread < SWING.lost_rad)
    return np.where(lost.any(axis=1), t[np.argmax(lost, axis=1)], batch[0].duration_s)

"""Fisher information of planned releases about ratios and effects.

A release is simulated with the current estimate. The simulated swing is cut into the segments that a diagnosis would
fit. Let A_s be the whitened Jacobian of segment s with respect to ratios and amplitudes. The initial state of the
segment is projected out of A_s. The information is

    H = sum over segments of A_s^T A_s / f,

where f is the variance inflation of a reading in the recorded runs.

Let Phi(t) be the sensitivity of the angles to the start pose, and s the standard deviation of a manually placed pose.
The predictability horizon of the planned swing is the time at which s |Phi(t)| exceeds a limit. Beyond this horizon the
actual swing differs from the planned one. Later segments still contain information, because their initial states are
fitted, but this information depends on the placement. The best releases are therefore rated by the mean of H over
random placement errors (`dpr_lab.planning.sequence`). All columns of the Jacobian, all releases and all segments are
computed in one batch.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.prediction import PAD, predict
from dpr_lab.dynamics.segments import segments
from dpr_lab.fitting.estimate import Estimate, FreeParameter
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import ENCODER_AMPLITUDES, RodsWithEffects
from dpr_lab.gap.screen.recordings import LENGTHS
from dpr_lab.planning.release import CandidateRelease


@dataclass(frozen=True, slots=True)
class SwingSettings:
    """Settings of the simulation of a planned release."""

    rate_hz: int = 50
    """Rate of the simulated readings, Hz. Each represents all samples up to the next reading."""
    path_hz: int = 200
    """Rate of the simulated swing, Hz; speeds at the start of segments are finite differences of its angles."""
    step_s: float = 5e-3
    """Longest Runge-Kutta step, s; the step of the Jacobian is twice as long."""
    horizon_hz: int = 20
    """Rate at which predictability is checked, Hz."""
    nudge_rad: float = 1e-5
    """Increment of a start pose from which its sensitivity is computed, rad."""
    lost_rad: float = 0.5
    """Standard deviation of an angle above which the swing is no longer predictable, rad."""
    batch: int = 16
    """Maximum number of releases in one batch, which limits the memory."""


SWING = SwingSettings()


@dataclass(frozen=True, slots=True)
class PresentModel:
    """Current estimate of the rig, and the unknowns of a plan."""

    estimate: Estimate
    """Ratios and effects of the current model, without segments."""
    columns: tuple[FreeParameter, ...]
    """The unknowns: the ratios, b and p/b, followed by the amplitudes of effects."""
    rods: RodsWithEffects
    noise: Array
    """(3,) noise density of the readings of joints 1, 2 and 0: standard deviation of a mean over 1 s, rad sqrt(s)."""
    placement_rad: float
    """Standard deviation of a manually placed start pose, rad."""
    inflation: float = 1.0
    """Variance inflation of a reading, in recorded and planned runs."""
    rezeroed: bool = False
    """Whether the encoders are zeroed before each recording; each recording then has its own zero errors."""


@dataclass(frozen=True, slots=True)
class Informed:
    """A release and its expected information."""

    release: CandidateRelease
    information: Array
    """(k, k) Fisher information about the unknowns."""


def informed(
    releases: Sequence[CandidateRelease], model: PresentModel, durations: Sequence[float] = ()
) -> list[Informed]:
    """Simulate releases and compute their information.

    Args:
        releases: the candidates
        model: the current estimate
        durations: shorter durations for which the information is also computed, s

    Returns:
        for each release, in order: the result for its own duration, then the results for the shorter durations
    """
    rated = []
    for batch in _batches(releases):
        for release, A, Z in zip(batch, *_slopes(batch, model), strict=True):
            for duration in (release.duration_s, *(d for d in durations if d < release.duration_s)):
                count = max(1, round(duration / LENGTHS.working))
                covered, zeros = (columns[:count].reshape(-1, columns.shape[2]) for columns in (A, Z))
                if model.rezeroed:
                    covered = covered - zeros @ np.linalg.lstsq(zeros, covered, rcond=1e-9)[0]
                rated.append(Informed(replace(release, duration_s=duration), covered.T @ covered / model.inflation))
    return rated


def _batches(releases: Sequence[CandidateRelease]) -> Iterator[list[CandidateRelease]]:
    """Divide releases into batches of equal duration in which the arm is always held, or always moves."""
    for _, group in groupby(releases, key=lambda release: (release.duration_s, release.mounted.arm_held)):
        members = list(group)
        yield from (members[i : i + SWING.batch] for i in range(0, len(members), SWING.batch))


def simulated_states(batch: Sequence[CandidateRelease], model: PresentModel) -> Array:
    """Simulate releases with effects; return their (releases, n, 4) states, rad and rad/s.

    The states begin at the release, and are sampled at the rate `SwingSettings.path_hz`. They contain no encoder
    errors. If the arm moves, a state has 6 components.
    """
    t = np.arange(round(batch[0].duration_s * SWING.path_hz) + 1) / SWING.path_hz
    read = t > PAD  # readings before this would start their segment before the release
    swings = segments([t[read]] * len(batch), range(len(batch)), [release.setup for release in batch], SWING.step_s)
    still = model.estimate.params.copy()
    still[ENCODER_AMPLITUDES] = 0.0
    starts = np.array([release.start for release in batch])
    joints = predict(model.estimate.whole, still, model.rods.constants, swings, starts, arm=swings.arm_moves)
    axes = joints.shape[1]
    read_joints = joints.reshape(len(batch), -1, axes)
    read_joints[:, :, 1] += model.rods.constants.relative2 * read_joints[:, :, 0]
    at_rest, first = starts[:, None, [0, 1, 4][:axes]], t[read][0]
    before = at_rest + (read_joints[:, :1] - at_rest) * (t[~read] / first)[:, None] ** 2
    theta = np.concatenate([before, read_joints], axis=1)
    omega = np.gradient(theta, 1 / SWING.path_hz, axis=1)
    omega[:, 0] = 0.0
    return np.concatenate([theta, omega], axis=2)[:, :, [0, 1, 2, 3] if axes == 2 else [0, 1, 3, 4, 2, 5]]


def joint_motion(release: CandidateRelease, model: PresentModel) -> Array:
    """Simulate a release; return its (n, 2, 3) angles and speeds of joints 0, 1 and 2, rad and rad/s.

    The angle of joint 1 is that of the inner rod. Joint 2 of a single rod does not move.
    """
    states = simulated_states([release], model)[0]
    motion = np.pad(states, ((0, 0), (0, 6 - states.shape[1])))[:, [[4, 0, 1], [5, 2, 3]]]
    motion[:, :, 2] = (motion[:, :, 2] - motion[:, :, 1]) * (not release.setup.alone)
    return motion


def reached_speeds(releases: Sequence[CandidateRelease], model: PresentModel) -> dict[str, float]:
    """Return the speed that each joint reaches in both directions, rad/s.

    A joint may reach the speed in one direction in one release, and in the other direction in another. The keys are
    `joint0`, `joint1` and `joint2`.
    """
    speeds = np.concatenate([np.zeros((1, 3)), *(joint_motion(release, model)[:, 1] for release in releases)])
    reached = np.minimum(speeds.max(axis=0), -speeds.min(axis=0))
    return dict(zip(("joint0", "joint1", "joint2"), reached.tolist(), strict=True))


def problem_of_releases(batch: Sequence[CandidateRelease], model: PresentModel) -> tuple[Problem, Array]:
    """Create the fit problem of releases of equal duration, with zero readings.

    Each segment starts one reading before its first reading, and the first segment at the release.

    Returns:
        the problem, and the (segments, 4) initial states of the segments
    """
    path, rate = simulated_states(batch, model), SWING.rate_hz
    length, stride = round(LENGTHS.working * rate), SWING.path_hz // rate
    count = (path.shape[1] - 1) // stride // length
    instants = [(k * length + np.arange(1, length + 1)) / rate for k in range(count)]
    states = path[:, np.arange(count) * length * stride].reshape(-1, path.shape[2])
    run = np.repeat(np.arange(len(batch)), count)
    cut = segments(instants * len(batch), run, [release.setup for release in batch], SWING.step_s)
    axes = 2 if batch[0].mounted.arm_held else 3
    read = np.array([[1.0, float(not release.setup.alone), 1.0][:axes] for release in batch])  # joints with a rod
    weight = np.repeat(read / (model.noise[:axes] * np.sqrt(rate)), count * length, axis=0)
    return Problem(cut, np.zeros((len(cut.t), axes)), weight, model.rods), states


def _slopes(batch: Sequence[CandidateRelease], model: PresentModel) -> tuple[Array, Array]:
    """Compute whitened Jacobians and project the initial states out of them.

    Returns:
        Jacobian (releases, segments, m, k) of the unknowns, and (releases, segments, m, 2) of the zero errors of the
        encoders
    """
    problem, states = problem_of_releases(batch, model)
    estimate = model.estimate.changed(initial=states)
    slopes = problem.slopes(estimate, model.columns)
    linear = linearise(problem, estimate, model.columns, problem.measured, slopes)
    shifts = np.broadcast_to(np.eye(problem.weight.shape[1], 2), (len(problem.t), problem.weight.shape[1], 2))
    zeros = linear.projected(problem.whitened(shifts))
    A, Z = (J.reshape(len(batch), -1, linear.A.shape[1], J.shape[-1]) for J in (linear.A, zeros))
    return A, Z


def horizon_s(release: CandidateRelease, model: PresentModel) -> float:
    """Return the predictability horizon of a release, s; at most its duration."""
    t = np.arange(1, round(release.duration_s * SWING.horizon_hz) + 1) / SWING.horizon_hz
    swings = segments([t] * 3, range(3), [release.setup] * 3, SWING.step_s)
    starts = np.tile(release.start, (3, 1))
    starts[[1, 2], [0, 1]] += SWING.nudge_rad
    estimate = model.estimate
    angles = predict(estimate.whole, estimate.params, model.rods.constants, swings, starts, arm=swings.arm_moves)
    first, *nudged = angles.reshape(3, len(t), -1)
    by_pose = (np.array(nudged) - first) / SWING.nudge_rad
    spread = model.placement_rad * np.sqrt(np.sum(by_pose**2, axis=0)).max(axis=1)
    return min(t[~(spread < SWING.lost_rad)].tolist(), default=release.duration_s)

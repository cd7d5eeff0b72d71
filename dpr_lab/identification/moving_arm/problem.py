"""Recordings with a moving arm as segments with free initial states: readings, weights, predictions, derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.arm import CLAMPED, DRIVEN
from dpr_lab.dynamics.moving_arm.swing import ArmSegments, arm_segments, swing_segments
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import refuse_still_arm
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.estimation.noise import arm_noise, noise_floor
from dpr_lab.fitting.cut import partition
from dpr_lab.identification.moving_arm.unknowns import Unknowns, mode_number, unknowns_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.setup import Torques

Cut = tuple[int, slice]
"""Index of a recording, and the samples of one of its segments."""


@dataclass(frozen=True, slots=True)
class CentralDifferences:
    """Increments of the central differences; the error of a derivative is below 1e-7 of it."""

    relative: float = 1e-5
    """Relative increment of an unknown."""
    least: float = 1e-6
    """Minimum increment of an unknown, for unknowns near zero."""
    state: float = 1e-5
    """Increment of an angle or speed, rad and rad/s."""


STEPS = CentralDifferences()


@dataclass(frozen=True, slots=True)
class ArmRecording:
    """A run from its release on, with its noise and input."""

    run: Run
    """The run from the release on."""
    mode: int
    """Mode of the arm: CLAMPED, FREE or DRIVEN."""
    std: Array
    """(3,) noise of the readings of joint 0, 1 and 2, rad."""
    drive: Array
    """(n,) mean input between consecutive samples."""
    slope: Array
    """(n,) mean derivative of the input between consecutive samples, per second."""


@dataclass(frozen=True, slots=True)
class ArmProblem:
    """Problem of the fit with a moving arm: the segments of all recordings with their unknowns."""

    unknowns: Unknowns
    """The fitted unknowns."""
    segments: ArmSegments
    """Layout of the segments, with their inputs."""
    cuts: tuple[Cut, ...]
    """Recording and samples of each segment."""
    max_step: float
    """Longest Runge-Kutta step, s."""
    t: Array
    """(samples,) instants, s since the release."""
    measured: Array
    """(samples, 3) readings of joints 0, 1, 2, rad; joint 2 as its encoder reads it."""
    weight: Array
    """(samples, 3) reciprocal standard deviation of the noise, 1/rad; zero for ignored joints."""
    moves: Flags
    """(segments, 6) mask of the free entries of the initial state."""
    frame: tuple[float, float]
    """Length L1 (m) and gravity g (m/s^2)."""
    relative: bool
    """Whether the encoder of joint 2 reads theta2 - theta1."""
    prior: Array
    """(free,) reciprocal standard deviation of a measured unknown; zero for an unknown that was not measured."""

    @property
    def dof(self) -> int:
        """Number of readings minus number of fitted values."""
        return int(np.count_nonzero(self.weight)) - int(self.moves.sum()) - len(self.unknowns.free)

    @property
    def lengths_s(self) -> Array:
        """(segments,) duration of each segment, s."""
        return np.array([self.t[part][-1] - self.t[part][0] for part in self.slices()])

    def slices(self) -> list[slice]:
        """Slices of the samples, one for each segment."""
        return [slice(i, j) for i, j in pairwise(self.segments.offsets.tolist())]

    def predict(self, p: Array, initial: Array) -> Array:
        """(samples, 3) predicted readings of the joints, rad."""
        readings = swing_segments(p, self.frame, self.segments, initial)[:, :3]
        if self.relative:
            with np.errstate(invalid="ignore"):  # value if the integration fails
                readings[:, 2] -= readings[:, 1]
        return readings

    def residuals(self, p: Array, initial: Array) -> Array:
        """(samples, 3) measured minus predicted, divided by the noise; not finite if the integration fails."""
        return np.where(self.weight > 0, self.weight * (self.measured - self.predict(p, initial)), 0.0)

    def slopes(self, p: Array, initial: Array) -> tuple[Array, Array]:
        """(samples, 3, free) and (samples, 3, 6) derivatives of the whitened predictions, by central differences."""
        columns = []
        for place in self.unknowns.places:
            h = max(STEPS.relative * abs(p[place]), STEPS.least)
            shift = np.zeros(len(p))
            shift[place] = h
            columns.append((self.predict(p + shift, initial) - self.predict(p - shift, initial)) / (2 * h))
        states = []
        for k in range(6):
            shift = np.zeros(6)
            shift[k] = STEPS.state
            ahead, behind = (self.predict(p, initial + sign * shift * self.moves) for sign in (1.0, -1.0))
            states.append((ahead - behind) / (2 * STEPS.state))
        weight = self.weight[:, :, None]
        return np.stack(columns, axis=2) * weight, np.stack(states, axis=2) * weight

    def with_std(self, std: Array) -> "ArmProblem":
        """Copy of the problem with other standard deviations (3,) of the joints, rad."""
        return replace(self, weight=np.where(self.weight > 0, 1.0 / std, 0.0))


def recordings_of(runs: Sequence[Run], rig: Rig) -> list[ArmRecording]:
    """Runs with the noise of their readings and with their input.

    Raises:
        RunError: this fit does not support a run.
    """
    return [_recording(run, rig) for run in runs]


def _recording(run: Run, rig: Rig) -> ArmRecording:
    name = run.file or run.name
    if run.arm_mode == "prescribed":
        raise RunError(f"{name}: its arm is prescribed: identify it separately from runs with a free or driven arm")
    if run.mounting != rig.rods.mounting or run.torques is not None or run.added_mass is not None:
        raise RunError(
            f"{name}: with a moving arm, all runs need the mounting of the rig file, no torques at joints 1"
            f" and 2, and no added mass"
        )
    if run.arm_mode == "driven" and rig.motor is None:
        raise RunError(f"{name}: its arm is driven: the rig file needs [motor] with the input")
    if run.arm_mode == "clamped":
        refuse_without_motion(run, rig)
    else:
        refuse_still_arm(run.swing.theta[:, 0], run.arm_mode, name)
    swing, std = run.swing, np.full(3, np.nan)
    std[1:] = noise_floor(run, rig).std_joint
    std[0] = arm_noise(run, rig)
    drive, slope = np.zeros((2, len(swing.t)))
    if run.arm_input is not None:
        held = Torques(run.t + run.input_delay_s, np.zeros((len(run.t), 2)), on_arm=run.arm_input)
        drive[:-1], slope[:-1] = _line(swing.t, run.between_rows(held))
    return ArmRecording(swing, mode_number(run.arm_mode, rig.motor.input if rig.motor else ""), std, drive, slope)


def _line(t: Array, torques: Torques) -> tuple[Array, Array]:
    """Mean (n - 1,) and slope (n - 1,) of a linear input in each interval between instants (n,).

    The line has the mean and the first moment of the input in the interval. A constant with this mean would cause a
    relative error (w T)^2/12 of the angles at the angular frequency w and the interval T.
    """
    knots, impulse = torques.arm_knots
    fine = np.union1d(knots, t)
    inside = np.interp(fine, knots, impulse)
    area = np.append(0.0, np.cumsum(0.5 * (inside[1:] + inside[:-1]) * np.diff(fine)))[np.searchsorted(fine, t)]
    until, T = np.interp(t, knots, impulse), np.diff(t)
    moment = 0.5 * T * (until[1:] + until[:-1]) - np.diff(area)
    return np.diff(until) / T, 12.0 * moment / T**3


def arm_problem(recordings: Sequence[ArmRecording], rig: Rig, length: float) -> tuple[ArmProblem, Array]:
    """Problem with segments of about one length (s), and (segments, 6) rough initial states."""
    cuts = [(i, part) for i, recording in enumerate(recordings) for part in partition(recording.run, length)]
    problem = problem_of(recordings, rig, cuts)
    initial = np.array([_rough_state(recordings[i].run, part) for i, part in cuts])
    initial[:, 1:] = np.where(problem.moves[:, 1:], initial[:, 1:], 0.0)  # a clamped arm keeps its angle
    return problem, initial


def problem_of(
    recordings: Sequence[ArmRecording], rig: Rig, cuts: Sequence[Cut], max_step: float = MAX_STEP
) -> ArmProblem:
    """Problem with the given segments, and with steps of at most `max_step` seconds."""
    both_rods = rig.rods.mounted == "both"
    modes = [recordings[i].mode for i, _ in cuts]
    driven = any(recording.run.arm_mode == "driven" and recording.mode != DRIVEN for recording in recordings)
    unknowns = unknowns_of(modes, driven, rig)
    segments = arm_segments(
        [recordings[i].run.t[part] for i, part in cuts],
        modes,
        [recordings[i].drive[part] for i, part in cuts],
        max_step,
        [recordings[i].slope[part] for i, part in cuts],
    )
    relative = both_rods and rig.encoders.joint2 == "relative"
    measured = np.concatenate([recordings[i].run.theta[part] for i, part in cuts])
    if relative:
        measured[:, 2] -= measured[:, 1]
    axes = np.array([[mode != CLAMPED, True, both_rods] for mode in modes])
    std = np.array([recordings[i].std for i, _ in cuts])
    weight = np.repeat(np.where(axes, 1.0 / std, 0.0), np.diff(segments.offsets), axis=0)
    prior = np.zeros(len(unknowns.free))
    if "L0" in unknowns.free:
        prior[unknowns.free.index("L0")] = 1.0 / (rig.rig.L0_std or 1.0)
    return ArmProblem(
        unknowns,
        segments,
        tuple(cuts),
        max_step,
        np.concatenate([recordings[i].run.t[part] for i, part in cuts]),
        measured,
        weight,
        np.tile(axes, 2),
        (rig.L1, rig.g),
        relative,
        prior,
    )


def _rough_state(run: Run, part: slice, neighbours: int = 12) -> Array:
    """(6,) state at the first sample of a segment, from a parabola through the neighbours."""
    rows = slice(max(part.start - neighbours, 0), min(part.start + neighbours, len(run.t)))
    t = run.t[rows] - run.t[part.start]
    slope = np.polynomial.polynomial.polyfit(t, run.theta[rows], 2)[:2]
    return np.asarray(slope, dtype=np.float64).reshape(6)

"""Fitting problem of recordings with a moving arm: segments with free initial states.

The problem contains readings and weights; its model predicts the readings and their derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.arm import CLAMPED, DRIVEN
from dpr_lab.dynamics.moving_arm.followed import FOLLOW
from dpr_lab.dynamics.moving_arm.swing import ArmSegments, arm_segments, swing_segments
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import refuse_still_arm
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.estimation.noise import arm_noise, noise_floor
from dpr_lab.fitting.cut import partition
from dpr_lab.fitting.estimate import Estimate, FreeParameter
from dpr_lab.fitting.problem import Problem
from dpr_lab.identification.moving_arm.unknowns import STEPS, Unknowns, mode_number, unknowns_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run, turned_arm
from dpr_lab.setup import Torques

Cut = tuple[int, slice]
"""Index of a recording, and the samples of one of its segments."""


@dataclass(frozen=True, slots=True)
class ArmRecording:
    """A run from its release on, and its noise and input."""

    run: Run
    """The run from the release on."""
    mode: int
    """Mode of the arm: CLAMPED, FREE or DRIVEN."""
    std: Array
    """(3,) noise of the readings of joint 0, 1 and 2, rad."""
    drive: Array
    """(n,) mean of the input from each sample to the next."""
    slope: Array
    """(n,) mean derivative of the input from each sample to the next, per second."""


@dataclass(frozen=True, slots=True)
class ArmSwings:
    """Model of rods, arm and drive without effects, an `OutputModel` of the common fitting engine.

    The vector of an estimate contains `SWING_PARAMETERS` in units of the scale.
    """

    constants: RigConstants
    """Measured constants of the rig."""
    inputs: ArmSegments
    """The segments of the problem, with the inputs of the arm."""
    free: Flags
    """(segments, 6) mask of the free entries of the initial state, in the order of `Segments.states`."""

    def predict(self, segments: Segments, estimate: Estimate) -> Array:
        """Predict the readings (samples, 3) of joints 0, 1 and 2, rad.

        They are not finite if the integration fails.
        """
        initial = np.zeros(self.free.shape)
        initial[:, : segments.states] = estimate.initial
        frame = self.constants.L1, self.constants.g
        readings = swing_segments(estimate.vector, frame, self.inputs, initial[:, FOLLOW.order])[:, :3]
        with np.errstate(invalid="ignore"):  # the values are not finite if the integration fails
            readings[:, 2] -= self.constants.relative2 * readings[:, 1]
        return readings

    def slopes(
        self, segments: Segments, estimate: Estimate, free: Sequence[FreeParameter], predicted: Array | None = None
    ) -> Array:
        """Compute the derivatives (samples, 3, free + states) of the readings by central differences."""
        vector, initial = estimate.vector, estimate.initial
        of_vector, of_states, columns = np.eye(len(vector)), np.eye(segments.states), []
        shifts = [(parameter.step * of_vector[parameter.place], 0.0, parameter.step) for parameter in free]
        shifts += [(0.0, STEPS.state * unit * self.free[:, : segments.states], STEPS.state) for unit in of_states]
        for shift, state, step in shifts:
            estimates = (Estimate(vector + sign * shift, initial + sign * state) for sign in (1.0, -1.0))
            ahead, behind = (self.predict(segments, changed) for changed in estimates)
            columns.append((ahead - behind) / (2 * step))
        return np.stack(columns, axis=2)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmProblem(Problem):
    """Fitting problem for segments of recordings with a moving arm.

    The columns of the readings belong to joints 0, 1 and 2.
    """

    model: ArmSwings
    """Model of rods, arm and drive."""
    recordings: Sequence[ArmRecording]
    rig: Rig
    """The recorded rig."""
    unknowns: Unknowns
    """The fitted unknowns."""
    cuts: tuple[Cut, ...]
    """Recording and samples of each segment."""
    max_step: float
    """Longest Runge-Kutta step, s."""

    def with_cuts(self, cuts: Sequence[Cut], max_step: float = MAX_STEP) -> "ArmProblem":
        """Return the problem of these recordings with different segments."""
        return problem_of(self.recordings, self.rig, cuts, max_step)

    @property
    def dof(self) -> int:
        """Number of readings minus number of fitted values."""
        return self.evidence - len(self.unknowns.free)

    @property
    def lengths_s(self) -> Array:
        """Duration (segments,) of each segment, s."""
        offsets = self.segments.offsets
        return self.t[offsets[1:] - 1] - self.t[offsets[:-1]]


def recordings_of(runs: Sequence[Run], rig: Rig) -> list[ArmRecording]:
    """Return each run with the noise of its readings and with its input.

    Raises:
        RunError: the fit does not support one of the runs.
    """
    return [_recording(run, rig) for run in runs]


def _recording(run: Run, rig: Rig) -> ArmRecording:
    name = run.file or run.name
    if run.arm_mode == "prescribed":
        raise RunError(f"{name}: its arm is prescribed: identify it separately from runs with a free or driven arm")
    if run.mounting != rig.rods.mounting or run.torques is not None or run.added_mass is not None:
        raise RunError(
            f"{name}: a run with a moving arm must have the mounting of the rig file. Torques at joints 1 and 2"
            " and an added mass are not supported"
        )
    if run.arm_mode == "driven" and rig.motor is None:
        raise RunError(f"{name}: its arm is driven: the rig file needs [motor] with the input")
    if run.arm_mode == "clamped":
        if turned := turned_arm(run.swing.theta):
            raise RunError(f"{name}: {turned}")
        refuse_without_motion(run, rig)
    else:
        refuse_still_arm(run.swing.theta[:, 0], run.arm_mode, name)
    swing, std = run.swing, reading_std(run, rig)
    drive, slope = np.zeros((2, len(swing.t)))
    if run.arm_input is not None:
        held = Torques(run.t + run.input_delay_s, np.zeros((len(run.t), 2)), on_arm=run.arm_input)
        drive[:-1], slope[:-1] = _line(swing.t, run.between_rows(held))
    return ArmRecording(swing, mode_number(run.arm_mode, rig.input), std, drive, slope)


def reading_std(run: Run, rig: Rig) -> Array:
    """Return the noise (3,) of a single reading of joints 0, 1 and 2, rad."""
    return np.append(arm_noise(run, rig), noise_floor(run, rig).std_joint)


def _line(t: Array, torques: Torques) -> tuple[Array, Array]:
    """Approximate the input by a line in each interval between the times (n,).

    The result contains the means (n - 1,) and slopes (n - 1,) of the lines. A line has the mean and the first moment of
    the input in its interval. A constant with this mean would cause a relative error (w T)^2/12 of the angles, where w
    is the angular frequency of the input and T the interval.
    """
    knots, impulse = torques.arm_knots
    fine = np.union1d(knots, t)
    inside = np.interp(fine, knots, impulse)
    area = np.append(0.0, np.cumsum(0.5 * (inside[1:] + inside[:-1]) * np.diff(fine)))[np.searchsorted(fine, t)]
    until, T = np.interp(t, knots, impulse), np.diff(t)
    moment = 0.5 * T * (until[1:] + until[:-1]) - np.diff(area)
    return np.diff(until) / T, 12.0 * moment / T**3


def arm_problem(recordings: Sequence[ArmRecording], rig: Rig, length: float) -> tuple[ArmProblem, Array]:
    """Cut recordings into segments of about one length, s, with rough initial states.

    The initial states have the shape (segments, 4 or 6).
    """
    cuts = [(i, part) for i, recording in enumerate(recordings) for part in partition(recording.run, length)]
    problem = problem_of(recordings, rig, cuts)
    initial = np.array([_rough_state(recordings[i].run, part) for i, part in cuts])
    return problem, np.where(problem.model.free, initial, 0.0)[:, : problem.segments.states]


def problem_of(
    recordings: Sequence[ArmRecording], rig: Rig, cuts: Sequence[Cut], max_step: float = MAX_STEP
) -> ArmProblem:
    """Return the fitting problem of given segments.

    The integration steps are at most `max_step`, s.
    """
    modes = [recordings[i].mode for i, _ in cuts]
    driven = any(recording.run.arm_mode == "driven" and recording.mode != DRIVEN for recording in recordings)
    unknowns = unknowns_of(modes, driven, rig)
    t = [recordings[i].run.t[part] for i, part in cuts]
    setups = [replace(recording.run.setup, arm_moves=recording.mode != CLAMPED) for recording in recordings]
    layout = segments(t, [i for i, _ in cuts], setups, max_step)
    measured = np.concatenate([recordings[i].run.theta[part] for i, part in cuts])
    measured[:, 1:] = rig.encoders.joint_angles.of_rods(measured[:, 1:])
    arm_moves = np.array(modes) != CLAMPED
    rods = np.tile([True, rig.rods.mounted == "both"], (len(cuts), 1))
    std = np.array([recordings[i].std for i, _ in cuts])
    weight = np.where(np.column_stack([arm_moves, rods]), 1.0 / std, 0.0)
    return ArmProblem(
        segments=layout,
        measured=measured,
        weight=np.repeat(weight, np.diff(layout.offsets), axis=0),
        model=ArmSwings(
            rig_constants(rig),
            arm_segments(
                t,
                modes,
                [recordings[i].drive[part] for i, part in cuts],
                max_step,
                [recordings[i].slope[part] for i, part in cuts],
            ),
            np.column_stack([rods, rods, arm_moves, arm_moves]),
        ),
        prior=unknowns.prior,
        recordings=recordings,
        rig=rig,
        unknowns=unknowns,
        cuts=tuple(cuts),
        max_step=max_step,
    )


def _rough_state(run: Run, part: slice, neighbours: int = 12) -> Array:
    """Estimate the state (6,) at the first sample of a segment by a local parabola.

    The order is the same as in `Segments.states`.
    """
    rows = slice(max(part.start - neighbours, 0), min(part.start + neighbours, len(run.t)))
    line = np.polynomial.polynomial.polyfit(run.t[rows] - run.t[part.start], run.theta[rows], 2)[:2]
    return np.asarray(line, dtype=np.float64).ravel()[np.argsort(FOLLOW.order)]

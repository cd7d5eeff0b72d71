"""Compare a model with a run in short segments and in a free run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import STEP, segments
from dpr_lab.effects import effect_params
from dpr_lab.errors import RunError
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS, Estimate
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.model import Model
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.ratio_fit import (
    TO_THE_MINIMUM,
    RatioFit,
    fit_ratios,
    predictable_until,
    rods_estimate,
    segmented,
)
from dpr_lab.rig import Rig
from dpr_lab.run import Run, moves
from dpr_lab.shown import Row, Shown


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Shown):
    """Comparison of one run with one model.

    The times are those of the run, from the release on.
    """

    run: str
    """Name of the run."""
    pose: str | None
    """Name of the pose from which the run was released; None if unknown."""
    held_out: bool
    """Whether the run was not fitted."""
    t: Array
    """(n,) times since the release, s."""
    measured: Array
    """(n, 2) measured theta1, theta2, rad."""
    free_run: Array
    """(n, 2) theta1, theta2 simulated from the initial state of the first segment, rad."""
    tracked: Array
    """(n, 2) theta1, theta2 simulated by segments with free initial states, rad."""
    horizon_s: float
    """Predictability horizon, s: the uncertainty of the initial state alone then moves the free run by 0.1 rad.

    Beyond the horizon a comparison of free runs does not test the model.
    """
    noise_rad: Array
    """(2,) noise floor of theta1 and theta2, rad."""
    segments: int
    """Number of segments with free initial states."""
    segment_rms_rad: Array
    """(2,) root mean square of `measured` - `tracked`, rad."""
    free_run_rms_rad: Array
    """(2,) root mean square of `measured` - `free_run` up to the horizon, rad."""
    torque_kind: str = ""
    """Kind of the known torques, `measured` or `commanded`; empty if unknown."""
    truncated: bool = False
    """Whether the recording was interrupted or damaged."""

    def _heading(self) -> str:
        role = "held out" if self.held_out else "used in the fit"
        return f"Comparison with run {self.run} ({role}), predictability horizon {self.horizon_s:.3g} s"

    def _rows(self) -> list[Row]:
        by_kind = {"noise": self.noise_rad, "segments": self.segment_rms_rad, "free run": self.free_run_rms_rad}
        rows = ((name, *(f"{1e3 * value:.3g}" for value in values.tolist())) for name, values in by_kind.items())
        return [row[: self.rods + 1] for row in (("mrad rms", "theta1", "theta2"), *rows)]

    @property
    def rods(self) -> int:
        """Number of mounted rods; the two columns of a single rod are equal."""
        return 1 if np.array_equal(*self.measured.T) else 2

    @property
    def free_run_error(self) -> Array:
        """Error of the free run, (n, 2): `measured` - `free_run`, rad; figure 3 of the publication shows it."""
        return self.measured - self.free_run

    @property
    def segment_residual(self) -> Array:
        """Residual of the segments, (n, 2): `measured` - `tracked`, rad."""
        return self.measured - self.tracked


@dataclass(frozen=True, slots=True)
class FreeRun:
    """Simulation from a fitted initial state to the end of a recording, without correction."""

    t: Array
    """(n,) times since the release, s."""
    theta: Array
    """(n, 2) simulated theta1, theta2, rad."""
    horizon_s: float
    """Predictability horizon as in `Comparison`, s."""


@dataclass(frozen=True, slots=True)
class Followed:
    """Run to whose segments the initial states of a model are fitted.

    A free run can start at each segment.
    """

    preprocessed: PreprocessedRun
    """Run with its velocities and its noise."""
    bare: RatioFit
    """Fit of the rods without effects, from which the predictability horizon is computed."""
    fitted: RatioFit
    """Fit of the model with its effects; `bare` if the model has no effects."""
    held_out: bool
    """Whether the run was not fitted."""

    @property
    def step(self) -> float:
        """Longest Runge-Kutta step of a free run, s."""
        return MAX_STEP if self.fitted is self.bare else STEP

    @property
    def estimate(self) -> Estimate:
        """Parameters of the model, and fitted initial states of the segments."""
        return self.fitted.fit.estimate


@solvable
def follow(run: Run, rig: Rig, model: Model, segment_s: float = 0.5) -> Followed:
    """Fit the initial states of the segments of a run; the parameters of the model are not fitted.

    Args:
        run: the recording
        rig: encoders of the run
        model: the model
        segment_s: length of a segment, s

    Raises:
        RunError: the run cannot be used, or its arm was free or driven.
    """
    if moves([run]):
        raise RunError(
            f"{run.file or run.name}: its arm was {run.arm_mode}, but the arm of the model is clamped: identify a"
            " model from runs of this kind"
        )
    return follow_preprocessed(preprocess(run, rig), rig, model, segment_s)


@solvable
def follow_preprocessed(preprocessed: PreprocessedRun, rig: Rig, model: Model, segment_s: float = 0.5) -> Followed:
    """Fit the initial states of the segments of a preprocessed run, as `follow` does.

    Several models can use the same preprocessed run.
    """
    problem, initial = segmented([preprocessed], rig, segment_s)
    bare = fit_ratios(problem, rods_estimate(model.unknowns, initial), held=range(len(UNKNOWN_RATIOS)))
    fitted = _with_effects(bare, initial, rig, model) if model.effects else bare
    return Followed(preprocessed, bare, fitted, held_out=not model.used(preprocessed.run.sha256))


def _with_effects(bare: RatioFit, measured: Array, rig: Rig, model: Model) -> RatioFit:
    """Refit the initial states of a run with the effects of the model.

    The fit starts from the initial states that were fitted without effects. Because the torques without effects may be
    wrong by 20 %, it may converge to a local minimum, in which a segment fits worse than without effects. The fit of
    such a segment is then repeated from its measured initial state, and from the final state of the previous segment,
    which is more precise if the rods are fast.

    Args:
        bare: fit of the run without effects
        measured: (segments, 4) measured initial states, rad and rad/s
        rig: the recorded rig
        model: the model with its effects
    """
    laid_out = bare.problem.segments
    at_step = replace(laid_out, step=np.full(len(laid_out), STEP))
    problem = replace(bare.problem, segments=at_step, model=RodsWithEffects(rig_constants(rig)))
    firsts = laid_out.t[laid_out.offsets[:-1]]
    leads = firsts - np.array([segment_start(first) for first in firsts.tolist()])
    starts = np.stack([bare.fit.estimate.initial, measured])
    # with effects, a segment starts shortly before its first sample
    starts[:, :, :2] -= leads[:, None] * starts[:, :, 2:]
    start = Estimate.of(model.unknowns, effect_params(model.effects), starts[0], bare.fit.estimate.zeros)
    best = fit(problem, start, (), iterations=15, settings=TO_THE_MINIMUM)
    for further in (lambda _: starts[1], lambda estimate: _continued(problem, estimate)):
        worse = best.linear.chi2_by_segment > bare.fit.linear.chi2_by_segment
        if not worse.any():
            break
        tried = np.where(worse[:, None], further(best.estimate), best.estimate.initial)
        other = fit(problem, start.changed(initial=tried), (), iterations=15, settings=TO_THE_MINIMUM)
        better = other.linear.chi2_by_segment < best.linear.chi2_by_segment
        initial = np.where(better[:, None], other.estimate.initial, best.estimate.initial)
        best = fit(problem, start.changed(initial=initial), (), iterations=1, settings=TO_THE_MINIMUM)
    return RatioFit(problem, best)


def _continued(problem: Problem, estimate: Estimate) -> Array:
    """Return the end state of each segment as the initial state of the next segment, (segments, 4).

    The first segment keeps its initial state.
    """
    laid_out = problem.segments
    if len(laid_out) == 1:
        return estimate.initial
    firsts = laid_out.t[laid_out.offsets[:-1]]
    times = [
        np.array([first, start - STEP, start + STEP])
        for first, start in zip(firsts[:-1], map(segment_start, firsts[1:].tolist()), strict=True)
    ]
    until = replace(problem, segments=segments(times, setups=laid_out.setups, step=STEP))
    readings = until.predict(estimate.changed(initial=estimate.initial[:-1], zeros=np.zeros((0, 2))))
    _, before, after = until.joints.to_rods(readings).reshape(-1, 3, 2).transpose(1, 0, 2)
    ends = np.hstack([(before + after) / 2, (after - before) / (2 * STEP)])
    return np.vstack([estimate.initial[:1], ends])


def free_run_from(followed: Followed, at_s: float) -> FreeRun:
    """Simulate a free run from the beginning of the segment that contains a time.

    Args:
        followed: the run and the initial states fitted to its segments
        at_s: the time, s since the release
    """
    laid_out = followed.bare.problem.segments
    index = max(int(np.searchsorted(laid_out.t[laid_out.offsets[:-1]], at_s, side="right")) - 1, 0)
    t = laid_out.t[laid_out.offsets[index] :]
    started = followed.estimate.changed(initial=followed.estimate.initial[index : index + 1])
    onward = segments([t], setups=laid_out.setups, step=followed.step)
    problem = replace(followed.fitted.problem, segments=onward)
    return FreeRun(t, problem.joints.to_rods(problem.predict(started)), predictable_until(followed.bare, index, t))


def compare_run(run: Run, rig: Rig, model: Model, segment_s: float = 0.5) -> Comparison:
    """Compare a run with a model in segments and in a free run.

    Only the initial states are fitted.

    Args:
        run: the recording
        rig: the recorded rig; its encoders determine the noise floor
        model: the model
        segment_s: length of a segment, s

    Raises:
        RunError: the run cannot be used, or the model cannot follow the readings.
    """
    followed = follow(run, rig, model, segment_s)
    run, noise = followed.preprocessed.run, followed.preprocessed.noise
    t, measured, tracked = run.t, run.theta[:, 1:], followed.fitted.predicted
    freely = free_run_from(followed, t[0])
    predictable = t <= freely.horizon_s
    segment_rms, free_run_rms = _rms(measured - tracked), _rms((measured - freely.theta)[predictable])
    if not np.isfinite([*segment_rms, *free_run_rms]).all():
        raise RunError(
            f"{run.file or run.name}: the model cannot follow these readings: check zero, unit, sign and order of the"
            " angles and the unit of time, or exclude the run"
        )
    return Comparison(
        run=run.name,
        pose=run.pose,
        held_out=followed.held_out,
        t=t,
        measured=measured,
        free_run=freely.theta,
        tracked=tracked,
        horizon_s=freely.horizon_s,
        noise_rad=np.sqrt(np.diag(noise.covariance)),
        segments=followed.bare.segments,
        segment_rms_rad=segment_rms,
        free_run_rms_rad=free_run_rms,
        torque_kind=run.torque_kind,
        truncated=not run.complete,
    )


def _rms(error: Array) -> Array:
    return np.sqrt(np.mean(error**2, axis=0))

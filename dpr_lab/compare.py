"""A model beside a measurement: segment residuals, and a free run as far as it can be predicted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import BASE
from dpr_lab.dynamics.known import known_of
from dpr_lab.dynamics.readings import pieces, started
from dpr_lab.effects import effect_vector
from dpr_lab.estimation.evidence import Evidence, conditions, gather
from dpr_lab.estimation.growth import free_run
from dpr_lab.estimation.least_squares import Conditions, SegmentFit, fit_segments
from dpr_lab.estimation.segments import cut
from dpr_lab.estimation.tracking import Simulated, track
from dpr_lab.model import Model
from dpr_lab.rig import Rig
from dpr_lab.run import Run

SEGMENT_S = 0.5
"""Length of the segments with free start states, s."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """One run against one model. All arrays share the run's instants from the release on."""

    run: str
    pose: str | None
    held_out: bool
    """Whether the run took no part in the identification."""
    t: NDArray[np.float64]
    """(n,) time since the release, s."""
    measured: NDArray[np.float64]
    """(n, 2) measured theta1, theta2, rad."""
    free_run: NDArray[np.float64]
    """(n, 2) simulated from the start state fitted on the first segment, rad."""
    tracked: NDArray[np.float64]
    """(n, 2) simulated segment by segment with free start states, rad."""
    horizon_s: float
    """Time until the start state's uncertainty alone moves the free run by 0.1 rad, s.

    Beyond it a sample-by-sample comparison of free runs says nothing about the model.
    """
    noise_rad: NDArray[np.float64]
    """(2,) noise floor by axis, rad."""
    segments: int
    segment_rms_rad: NDArray[np.float64]
    """(2,) root mean square of measured - tracked, rad."""
    free_run_rms_rad: NDArray[np.float64]
    """(2,) root mean square of measured - free_run up to the horizon, rad."""

    @property
    def free_run_error(self) -> NDArray[np.float64]:
        """(n, 2) measured - free_run, rad (Figure 3 of the paper)."""
        return self.measured - self.free_run

    @property
    def segment_residual(self) -> NDArray[np.float64]:
        """(n, 2) measured - tracked, rad."""
        return self.measured - self.tracked


@dataclass(frozen=True, slots=True)
class FreeRun:
    """One simulation from a fitted start state to the end of the record."""

    t: NDArray[np.float64]
    """(n,) time since the release, s."""
    theta: NDArray[np.float64]
    """(n, 2) simulated theta1, theta2, rad."""
    horizon_s: float
    """Time since the release until which it can be predicted, as in `Comparison`, s."""


@dataclass(frozen=True, slots=True)
class Followed:
    """A run followed by a model from segment to segment; a free run can start where a segment does."""

    evidence: Evidence
    known: Conditions
    fit: SegmentFit
    corrected: Simulated | None
    """The model with its effects; None for one without."""
    starts: NDArray[np.float64]
    """(segments, 4) fitted start states of what simulates: `corrected`, else the bare model."""
    tracked: NDArray[np.float64]
    """(n, 2) simulated segment by segment, rad."""
    held_out: bool


def compare_run(run: Run, rig: Rig, model: Model) -> Comparison:
    """Simulate a run with a model: segment by segment, and as one free run from its first segment's start state.

    Args:
        run: the measurement
        rig: its encoders, for the noise floor
        model: what to simulate; its ratios stay as they are, only start states are fitted
    """
    return compare_followed(follow(run, rig, model))


def follow(run: Run, rig: Rig, model: Model) -> Followed:
    """Fit the start states of a run's segments to a model; arguments as for `compare_run`."""
    evidence = gather(run, rig)
    known = conditions([evidence], rig)
    unknowns = model.unknowns[: known.unknowns]
    fit = fit_segments(unknowns, cut(0, evidence.run, evidence.states, SEGMENT_S), known, held=range(len(unknowns)))
    held_out = not model.used(run.sha256)
    if not model.effects:
        starts = np.array([segment.start for segment in fit.segments])
        return Followed(evidence, known, fit, None, starts, np.concatenate(fit.predicted), held_out)
    base = np.array([model.base[name].value for name in BASE])
    corrected = Simulated(base, effect_vector(model.effects), known_of(rig))
    starts, tracked = _tracked(corrected, evidence.run, fit)
    return Followed(evidence, known, fit, corrected, starts, tracked, held_out)


def free_run_from(followed: Followed, at_s: float) -> FreeRun:
    """A free run from the segment that an instant lies in.

    Args:
        followed: the run and its fitted start states
        at_s: where to start, s since the release; it starts where that segment does
    """
    firsts = [segment.t[0] for segment in followed.fit.segments]
    index = max(int(np.searchsorted(firsts, at_s, side="right")) - 1, 0)
    run = followed.evidence.run
    t = run.t[run.t >= firsts[index]]
    theta, horizon = free_run(followed.fit, index, t, followed.known)
    if followed.corrected is not None:
        alone = pieces([t], [0], [run.added_mass])
        theta = followed.corrected.angles(alone, followed.starts[index : index + 1]) @ _to_rods(followed.corrected)
    return FreeRun(t, theta, horizon)


def compare_followed(followed: Followed) -> Comparison:
    """What `compare_run` gives, of a run that was followed already."""
    run = followed.evidence.run
    t, measured = run.t, run.theta[:, 1:]
    freely = free_run_from(followed, t[0])
    predictable = t <= freely.horizon_s
    return Comparison(
        run=run.name,
        pose=run.pose,
        held_out=followed.held_out,
        t=t,
        measured=measured,
        free_run=freely.theta,
        tracked=followed.tracked,
        horizon_s=freely.horizon_s,
        noise_rad=np.sqrt(np.diag(followed.evidence.noise.covariance)),
        segments=len(followed.fit.segments),
        segment_rms_rad=_rms(measured - followed.tracked),
        free_run_rms_rad=_rms((measured - freely.theta)[predictable]),
    )


def _tracked(corrected: Simulated, run: Run, fit: SegmentFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(segments, 4) start states and (n, 2) angles of the rods under the model's effects, SI."""
    starts = np.array([segment.start for segment in fit.segments])
    leads = np.array([segment.t[0] - started(float(segment.t[0])) for segment in fit.segments])
    starts[:, :2] -= leads[:, None] * starts[:, 2:]  # a segment with effects starts a moment before its first sample
    cut_alike = pieces([segment.t for segment in fit.segments], [0] * len(starts), [run.added_mass])
    to_rods = _to_rods(corrected)
    measured = np.concatenate([segment.theta for segment in fit.segments]) @ np.linalg.inv(to_rods)
    starts, tracked = track(corrected, cut_alike, measured, starts)
    return starts, tracked @ to_rods


def _to_rods(corrected: Simulated) -> NDArray[np.float64]:
    """(2, 2) what encoder readings are multiplied by, from the right, to give absolute angles."""
    return np.array([[1.0, corrected.known.relative2], [0.0, 1.0]])


def _rms(error: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(np.mean(error**2, axis=0))

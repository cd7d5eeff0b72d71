"""A model beside a measurement: segment residuals, and a free run as far as it can be predicted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import BASE
from dpr_lab.dynamics.known import known_of
from dpr_lab.dynamics.readings import PAD, pieces
from dpr_lab.effects import effect_vector
from dpr_lab.estimation.evidence import conditions, gather
from dpr_lab.estimation.growth import free_run
from dpr_lab.estimation.least_squares import SegmentFit, fit_segments
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


def compare_run(run: Run, rig: Rig, model: Model) -> Comparison:
    """Simulate a run with a model: segment by segment, and as one free run from its first segment's start state.

    Args:
        run: the measurement
        rig: its encoders, for the noise floor
        model: what to simulate; its ratios stay as they are, only start states are fitted
    """
    evidence = gather(run, rig)
    known = conditions([evidence], rig)
    unknowns = model.unknowns[: known.unknowns]
    fit = fit_segments(unknowns, cut(0, evidence.run, evidence.states, SEGMENT_S), known, held=range(len(unknowns)))
    t, measured = evidence.run.t, evidence.run.theta[:, 1:]
    freely, horizon = free_run(fit, 0, t, known)
    tracked = np.concatenate(fit.predicted)
    if model.effects:
        tracked, freely = _with_effects(evidence.run, rig, model, fit)
    predictable = t <= horizon
    return Comparison(
        run=run.name,
        pose=run.pose,
        held_out=not model.used(run.sha256),
        t=t,
        measured=measured,
        free_run=freely,
        tracked=tracked,
        horizon_s=horizon,
        noise_rad=np.sqrt(np.diag(evidence.noise.covariance)),
        segments=len(fit.segments),
        segment_rms_rad=_rms(measured - tracked),
        free_run_rms_rad=_rms((measured - freely)[predictable]),
    )


def _with_effects(run: Run, rig: Rig, model: Model, fit: SegmentFit) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 2) segment by segment, and (n, 2) as one free run: what the encoders read under the model's effects, rad."""
    base = np.array([model.base[name].value for name in BASE])
    corrected = Simulated(base, effect_vector(model.effects), known_of(rig))
    to_joint = np.array([[1.0, 0.0], [-corrected.known.relative2, 1.0]])
    starts = np.array([segment.start for segment in fit.segments])
    starts[:, :2] -= PAD * starts[:, 2:]  # a segment with effects starts a moment before its first sample
    cut_alike = pieces([segment.t for segment in fit.segments], [0] * len(starts), [run.added_mass])
    measured = np.concatenate([segment.theta for segment in fit.segments]) @ to_joint.T
    starts, tracked = track(corrected, cut_alike, measured, starts)
    freely = corrected.angles(pieces([run.t], [0], [run.added_mass]), starts[:1])
    to_rods = np.linalg.inv(to_joint).T
    return tracked @ to_rods, freely @ to_rods


def _rms(error: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(np.mean(error**2, axis=0))

"""Identification of a rig with a moving arm, and comparison of runs with the model."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.identified import SETTINGS
from dpr_lab.identification.model import EstimatedValue, RigFacts, RunUsed
from dpr_lab.identification.moving_arm.doubts import failures, stop_sentence
from dpr_lab.identification.moving_arm.fit import ArmFit, covariance_of, fit_moving_arm, fit_segments
from dpr_lab.identification.moving_arm.input_rows import other_input
from dpr_lab.identification.moving_arm.model import ArmFitSummary, MovingArmModel
from dpr_lab.identification.moving_arm.problem import ArmRecording, arm_problem, recordings_of
from dpr_lab.identification.moving_arm.scale import (
    absolute_values,
    estimated,
    motor_notes,
    scale_of_arm,
    stated_scale,
)
from dpr_lab.identification.uncertainty import refuse_undetermined
from dpr_lab.rig import Rig
from dpr_lab.run import Run, truncation
from dpr_lab.shown import Row, Shown
from dpr_lab.version import __version__

JOINTS_READ = ("joint 0", "joint 1", "joint 2")


def identify_moving_arm(runs: Sequence[Run], rig: Rig) -> MovingArmModel:
    """Identify rods, arm and drive from runs with a clamped, free or driven arm.

    Args:
        runs: runs, at least one with a free or driven arm
        rig: initial values and measured values

    Raises:
        RunError: a run cannot be used.
        IdentificationError: the values of the rig file cannot be simulated, or the runs determine no parameter.
    """
    recordings = recordings_of(runs, rig)
    fit = _fitted(recordings, rig)
    covariance = covariance_of(fit)
    refuse_undetermined(fit.values, covariance, "the arm and rods")
    unknowns, std = fit.problem.unknowns, np.sqrt(np.diag(covariance))
    names = [unknowns.name(parameter) for parameter in unknowns.free]
    estimates = [*map(estimated, fit.values.tolist(), std.tolist())]
    is_determined = [estimate.std <= SETTINGS.hardly_seen * abs(estimate.value) for estimate in estimates]
    scale, places = scale_of_arm(fit, covariance, rig), np.flatnonzero(is_determined)
    determined = {unknowns.free[k]: float(fit.values[k]) for k in places}
    absolute = absolute_values(determined, covariance[np.ix_(places, places)], scale, unknowns.scale, unknowns.input)
    return MovingArmModel(
        rig=RigFacts.of(rig),
        mounted="both" if unknowns.scale == "b" else "inner",
        input=unknowns.input if any(run.arm_mode == "driven" for run in runs) else "",
        scale=unknowns.scale,
        ratios=dict(compress(zip(names, estimates, strict=True), is_determined)),
        undetermined={
            name: undetermined(name, estimate)
            for name, estimate, known in zip(names, estimates, is_determined, strict=True)
            if not known
        },
        covariance=covariance.tolist(),
        unknowns=names,
        absolute=absolute,
        scale_sentence=stated_scale(
            absolute[unknowns.scale], unknowns.scale, scale.fixed_by, scale.constants_std
        ).sentence,
        swing=fit.p.tolist(),
        fit=_summary(fit, recordings),
        runs=runs_used(runs, fit),
        notes=motor_notes(fit, scale, rig, determined),
        warnings=[
            *_warnings(fit),
            *filter(None, [other_input(fit, runs, rig)]),
            *truncation(run.name for run in runs if not run.complete),
        ],
        failures=failures(fit, recordings, rig, gain_seen="gain" in determined),
        version=__version__,
    )


def _fitted(recordings: Sequence[ArmRecording], rig: Rig) -> ArmFit:
    """Fit the recordings; if this fails and the arm hits a stop, the error names the stop."""
    try:
        return fit_moving_arm(recordings, rig)
    except IdentificationError as error:
        if stop := next(filter(None, (stop_sentence(recording.run) for recording in recordings)), ""):
            raise IdentificationError(stop) from error
        raise


def _summary(fit: ArmFit, recordings: Sequence[ArmRecording]) -> ArmFitSummary:
    noise = np.sqrt(np.mean([recording.std**2 for recording in recordings], axis=0))
    read = np.any(fit.problem.read, axis=0)
    return ArmFitSummary(
        rms_rad=dict(compress(zip(JOINTS_READ, fit.rms.tolist(), strict=True), read)),
        noise_rad=dict(compress(zip(JOINTS_READ, noise.tolist(), strict=True), read)),
        segments=len(fit.problem.segments),
        segment_s=float(np.median(fit.problem.lengths_s)),
        chi2_per_dof=fit.misfit,
        converged=fit.converged,
        merges=list(fit.merges),
    )


def undetermined(name: str, estimate: EstimatedValue) -> str:
    """State why the result contains no value for an unknown."""
    low, high = estimate.interval90
    if not estimate.std < SETTINGS.unseen * max(abs(estimate.value), 1.0):
        return "not determined by these recordings"
    if low > 0:
        return f"poorly determined: {low:.3g} to {high:.3g} (90 %)"
    if name[:2] in ("c0", "c1", "c2", "k0", "f0"):
        return f"not distinguishable from zero: {low:.3g} to {high:.3g} (90 %)"
    return "not determined by these recordings"


def runs_used(runs: Sequence[Run], fit: ArmFit) -> list[RunUsed]:
    """Return the entries of the fitted runs.

    The noise of the readings is the unit of the reduced chi-square, even if the fit weights joints by their residuals.
    """
    problem, of_segments = fit.problem, fit.problem.segments.run
    of_samples = of_segments[problem.owner]
    std = np.array([recording.std for recording in problem.recordings])[of_samples]
    residuals = np.where(problem.read, problem.measured - problem.predict(fit.estimate), 0.0) / std
    chi2 = np.bincount(of_samples, np.sum(residuals**2, axis=1)) / np.bincount(of_segments, problem.evidence_by_segment)
    return [
        RunUsed.of(run, samples=len(run.swing.t), duration_s=run.duration, chi2_per_dof=reduced, segments=count)
        for run, reduced, count in zip(runs, chi2.tolist(), np.bincount(of_segments).tolist(), strict=True)
    ]


def _warnings(fit: ArmFit) -> list[str]:
    if fit.misfit <= SETTINGS.gap_warning:
        return []
    return [
        f"the residual is {fit.misfit**0.5:.1f} times the noise: the model is incomplete, and `diagnose`"
        " looks for the missing effect. The standard deviations are computed for residuals clustered by segment; a"
        " systematic error may be larger"
    ]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ArmComparison(Shown):
    """Comparison of one run with one model, by segments."""

    run: str
    """Name of the run."""
    held_out: bool
    """Whether the run was not fitted."""
    t: Array
    """(n,) times since the release, s."""
    measured: Array
    """(n, 3) readings of the joints, rad, as the encoders read them; nan without an encoder."""
    simulated: Array
    """(n, 3) readings that the model predicts, rad; nan without an encoder.

    The initial state of each segment is fitted.
    """
    segment_s: float
    """Length of a segment, s."""
    rms_rad: dict[str, float]
    """Rms residual of each joint, rad."""
    noise_rad: dict[str, float]
    """Standard deviation of the noise of the readings of each joint, rad."""
    truncated: bool = False
    """Whether the recording was interrupted or damaged."""

    @classmethod
    def of(
        cls,
        run: Run,
        model: MovingArmModel,
        t: Array,
        measured: Array,
        simulated: Array,
        segment_s: float,
        noise: Array,
    ) -> "ArmComparison":
        """Compare readings with the simulation by a model.

        Args:
            run: the run
            model: the model
            t: (n,) times since the release, s
            measured: (n, 3) readings, rad; nan without an encoder
            simulated: (n, 3) simulated readings, rad; nan without an encoder
            segment_s: length of a segment, s
            noise: (3,) standard deviation of the noise of each joint, rad
        """
        residual = measured - simulated
        read = {name: k for k, name in enumerate(JOINTS_READ) if np.isfinite(measured[:, k]).any()}
        rms = {name: float(np.sqrt(np.nanmean(residual[:, k] ** 2))) for name, k in read.items()}
        noise_rad = {name: float(noise[k]) for name, k in read.items()}
        return cls(run.name, not model.used(run.sha256), t, measured, simulated, segment_s, rms, noise_rad)

    def _heading(self) -> str:
        role = "held out" if self.held_out else "used in the fit"
        return f"Comparison with run {self.run} ({role}), segments of {self.segment_s:g} s"

    def _rows(self) -> list[Row]:
        by_kind = {"noise": self.noise_rad, "segments": self.rms_rad}
        rows = [(kind, *(f"{1e3 * values[name]:.3g}" for name in self.rms_rad)) for kind, values in by_kind.items()]
        return [("mrad rms", *self.rms_rad), *rows]


AnyComparison = Comparison | ArmComparison
"""Comparison of a run with a model of any arm."""


def compare_moving_arm(run: Run, rig: Rig, model: MovingArmModel, segment_s: float = 0.5) -> ArmComparison:
    """Compare a run with a model by segments; only the initial states are fitted.

    Raises:
        RunError: the model belongs to another rig, or cannot follow the readings.
    """
    model.refuse_run(run, rig)
    recordings = recordings_of([run], rig)
    problem, initial = arm_problem(recordings, rig, segment_s)
    try:
        fit = fit_segments(problem, Estimate(np.array(model.swing), initial), states_only=True)
    except IdentificationError as error:
        raise RunError(f"{run.file or run.name}: the model cannot follow these readings") from error
    measured, simulated = (
        np.where(problem.read, readings, np.nan) for readings in (problem.measured, problem.predict(fit.estimate))
    )
    return ArmComparison.of(run, model, recordings[0].run.t, measured, simulated, segment_s, recordings[0].std)

"""Estimates of the ratios, and of the sizes of given effects, from each run separately."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.fitting.estimate import SCALE, FreeParameter, alone_share
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.moving_arm.fit import covariance_of, fit_moving_arm
from dpr_lab.identification.moving_arm.problem import recordings_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.setup import only_inner


@dataclass(frozen=True, slots=True)
class Estimates:
    """Estimates from each run, in chronological order."""

    runs: tuple[str, ...]
    """Names of the runs."""
    poses: tuple[str, ...]
    """Pose of each run. Model errors bias the estimates differently at each pose."""
    names: tuple[str, ...]
    """Names of the parameters."""
    values: Array
    """(runs, parameters) estimates, SI units."""
    std: Array
    """(runs, parameters) standard deviations due to the noise of each run, SI units."""
    b: float | None = None
    """Assumed inertia b, or a for an inner rod alone, kg m^2; None if the runs determine it.

    Sizes that depend on this inertia are given as ratios, whose names end in `/b` or `*b` (`/a` or `*a`).
    """
    inertia: str = "b"
    """Name of the assumed inertia: `a` for an inner rod alone, otherwise `b`."""


@solvable
def estimate_each(
    runs: Sequence[Run],
    rig: Rig,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    start: Array | None = None,
) -> Estimates:
    """Fit each run separately, in segments of 0.5 s.

    Args:
        runs: the runs in chronological order
        rig: lengths, masses and encoders
        effects: named effects of a diagnosis with all parameters; their amplitudes are also fitted
        start: (6,) initial values of the ratios and of b; None: values of the rig file

    Raises:
        RunError: a run cannot be fitted, or the runs determine different parameters.
    """
    initial = nominal_ratios(rig) if start is None else start
    fits = [_estimate(run, rig, effects or {}, initial) for run in runs]
    names = fits[0][0]
    for run, (run_names, _, _) in zip(runs, fits, strict=True):
        if run_names != names:
            raise RunError(
                f"{run.file or run.name}: identifies {', '.join(run_names)}, but the first run identifies"
                f" {', '.join(names)}"
            )
    values, std = (np.array(columns) for columns in list(zip(*fits, strict=True))[1:])
    alone = only_inner(run.setup for run in runs)
    b = None if "b" in names else float(initial[SCALE]) * (alone_share(initial) if alone else 1.0)
    return _estimates(runs, names, values, std, b, "a" if alone else "b")


@solvable
def estimate_each_arm(runs: Sequence[Run], rig: Rig, clearest: float = 0.5) -> Estimates:
    """Fit rods, arm and drive to each run separately.

    A ratio that some run does not determine accurately enough is omitted.

    Args:
        runs: the runs in chronological order, all with the same mode of the arm
        rig: lengths, masses and encoders
        clearest: maximum relative standard deviation of a ratio that is compared; for friction, which may be near zero,
            relative to the largest estimate

    Raises:
        RunError: a run cannot be fitted, the runs differ in the mode of the arm, or no ratio is determined by all runs.
        IdentificationError: the values of the rig file cannot be simulated.
    """
    modes = sorted({run.arm_mode for run in runs})
    if len(modes) > 1:
        raise RunError(f"the arm was {' in some runs and '.join(modes)} in others: compare runs of one mode")
    fits = [fit_moving_arm(recordings_of([run], rig), rig) for run in runs]
    values = np.array([fitted.values for fitted in fits])
    std = np.array([np.sqrt(np.diag(covariance_of(fitted))) for fitted in fits])
    clear = np.isfinite(values).all(axis=0) & (std <= clearest * np.abs(values).max(axis=0)).all(axis=0)
    if not clear.any():
        raise RunError("no ratio is determined by all of these runs: record longer or larger swings")
    unknowns = fits[0].problem.unknowns
    names = tuple(unknowns.name(name) for name, is_clear in zip(unknowns.free, clear, strict=True) if is_clear)
    return _estimates(runs, names, values[:, clear], std[:, clear])


def _estimates(
    runs: Sequence[Run], names: tuple[str, ...], values: Array, std: Array, b: float | None = None, inertia: str = "b"
) -> Estimates:
    poses = tuple(run.pose or "" for run in runs)
    return Estimates(tuple(run.name for run in runs), poses, names, values, std, b, inertia)


def _estimate(
    run: Run, rig: Rig, effects: Mapping[str, Mapping[str, float]], start: Array
) -> tuple[tuple[str, ...], Array, Array]:
    """Fit one run; return the names, values and standard deviations of its parameters."""
    refuse_without_motion(run, rig)
    _, problem, bare = fit_bare_model(Recordings((record(run, rig),), rig), start)
    fitted = bare.fit
    if effects:
        estimate = fitted.estimate.changed(params=effect_params(effects))
        fitted = fit(problem, estimate, free_parameters(estimate, tuple(effects), problem))
    if not np.isfinite(fitted.chi2):
        raise RunError(f"{run.file or run.name}: the model cannot follow this run. Omit it")
    A, _ = fitted.linear.flat
    norms = np.linalg.norm(A, axis=0)
    if not (norms > 0).all():
        raise RunError(f"{run.file or run.name}: does not identify every parameter. Omit this run")
    inverse = np.linalg.pinv((A / norms).T @ (A / norms), hermitian=True)
    misfit = max(1.0, fitted.chi2 / problem.measured.size)
    covariance = misfit * inverse / np.outer(norms, norms)
    indices = [i for i, parameter in enumerate(fitted.free) if parameter.block != "zeros"]
    parameters = [fitted.free[i] for i in indices]
    scale = [i for i in indices if not fitted.free[i].effect and fitted.free[i].name == "b"]
    alone = only_inner([run.setup])
    inertia = fitted.estimate.ratios[SCALE] * (alone_share(fitted.estimate.ratios) if alone else 1.0)
    rows = []
    for parameter in parameters:
        power = 0 if scale else _scale_power(parameter)
        size = _name(parameter, power, "a" if alone else "b"), parameter.read(fitted.estimate) / inertia**power
        rows.append(ratio_of(parameter, fitted.estimate, rig, alone=alone) or (*size, inertia**power))
    names, values, divisors = zip(*rows, strict=True)
    change = np.eye(len(fitted.free))[indices]
    for row, (parameter, value, divisor) in enumerate(zip(parameters, values, divisors, strict=True)):
        if scale and parameter.effect in (FREE_ARM.name, DRIVE_GAIN.name):
            # to first order the variance of b (x / b) is that of x - (x / b) b
            change[row, scale] = -value * divisor / fitted.estimate.ratios[SCALE]
    std = np.sqrt(np.einsum("ij,jk,ik->i", change, covariance, change))
    return names, np.array(values), std / np.array(divisors)


def _scale_power(parameter: FreeParameter) -> int:
    """Return the exponent of the inertia b in an amplitude; 0 for other parameters."""
    effect = EFFECTS.get(parameter.effect)
    return next((p.scale_power for p in effect.parameters if p.name == parameter.name), 0) if effect else 0


def _name(parameter: FreeParameter, power: int, inertia: str) -> str:
    name = parameter.name if not parameter.effect else f"{parameter.effect}.{parameter.name}"
    return name + {1: f"/{inertia}", -1: f"*{inertia}"}.get(power, "")

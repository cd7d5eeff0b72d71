"""Ratios of rods, arm and drive, estimated separately from each run."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.drift.estimates import Estimates
from dpr_lab.errors import RunError
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.moving_arm.fit import covariance_of, fit_moving_arm
from dpr_lab.identification.moving_arm.problem import recordings_of
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@solvable
def estimate_each_arm(runs: Sequence[Run], rig: Rig, clearest: float = 0.5) -> Estimates:
    """Fit each run separately; ratios that at least one run does not determine are omitted.

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
    names, values, stds = list[str](), [], []
    for run in runs:
        fit = fit_moving_arm(recordings_of([run], rig), rig)
        names = [fit.problem.unknowns.name(parameter) for parameter in fit.problem.unknowns.free]
        values.append(fit.values)
        stds.append(np.sqrt(np.diag(covariance_of(fit))))
    estimates, std = np.array(values), np.array(stds)
    scale = np.abs(estimates).max(axis=0)
    clear = np.isfinite(estimates).all(axis=0) & (std <= clearest * scale).all(axis=0)
    if not clear.any():
        raise RunError("no ratio is determined by all of these runs: record longer or larger swings")
    determined = tuple(name for name, is_clear in zip(names, clear, strict=True) if is_clear)
    return Estimates(
        tuple(run.name for run in runs),
        tuple(run.pose or "" for run in runs),
        determined,
        estimates[:, clear],
        std[:, clear],
    )

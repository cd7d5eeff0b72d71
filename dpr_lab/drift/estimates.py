"""What each run alone says of the rig: its ratios, and the sizes of effects that are known to be there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import effect_params
from dpr_lab.errors import RunError
from dpr_lab.fitting.estimate import ZERO
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.data.record import record
from dpr_lab.gap.data.recordings import Recordings
from dpr_lab.gap.selection.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.selection.hypothesis import free_parameters
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimates:
    """What each of some runs says, in the order of time."""

    runs: tuple[str, ...]
    poses: tuple[str, ...]
    """Of each run, the pose it was released from: what the model misses differs between them."""
    names: tuple[str, ...]
    """Of the parameters."""
    values: Array
    """(runs, parameters) SI"""
    std: Array
    """(runs, parameters) by the noise of each run alone, SI."""


def estimate_each(
    runs: Sequence[Run],
    rig: Rig,
    effects: Mapping[str, Mapping[str, float]] | None = None,
    start: Array | None = None,
) -> Estimates:
    """Fit every run alone, over segments of half a second.

    Args:
        runs: in the order of time
        rig: lengths, masses and encoders
        effects: what a diagnosis named, with all parameters: their amplitudes are fitted too
        start: (6,) ratios and b to start from; the rig file's values by default

    Raises:
        RunError: a run that cannot be fitted.
    """
    found = [_estimate(run, rig, effects or {}, nominal_ratios(rig) if start is None else start) for run in runs]
    names = found[0][0]
    for run, (own, _, _) in zip(runs, found, strict=True):
        if own != names:
            raise RunError(f"{run.file or run.name}: shows {', '.join(own)}, the first run {', '.join(names)}")
    values, std = (np.array([item[part] for item in found]) for part in (1, 2))
    return Estimates(tuple(run.name for run in runs), tuple(run.pose or "" for run in runs), names, values, std)


def _estimate(
    run: Run, rig: Rig, effects: Mapping[str, Mapping[str, float]], start: Array
) -> tuple[tuple[str, ...], Array, Array]:
    """Names, values and standard deviations of one run's parameters."""
    _, problem, bare = fit_bare_model(Recordings((record(run, rig),), rig), start)
    found = bare.fit
    if effects:
        at = replace(found.estimate, params=effect_params({name: dict(values) for name, values in effects.items()}))
        found = fit(problem, at, free_parameters(at, tuple(effects), problem))
    A, _ = found.linear.flat
    sizes = np.linalg.norm(A, axis=0)
    if not (sizes > 0).all():
        raise RunError(f"{run.file or run.name}: does not show every parameter: leave it out")
    inverse = np.linalg.pinv((A / sizes).T @ (A / sizes), hermitian=True)
    excess = max(1.0, found.chi2 / problem.measured.size)
    std = np.sqrt(excess * np.diag(inverse)) / sizes
    kept = [i for i, p in enumerate(found.free) if p.effect != ZERO]
    told = [found.free[i] for i in kept]
    names = tuple(p.name if p.effect is None else f"{p.effect}.{p.name}" for p in told)
    return names, np.array([parameter.read(found.estimate) for parameter in told]), std[kept]

"""What each run alone says of the rig: its ratios, and the sizes of effects that are known to be there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.fitting.estimate import SCALE, FreeParameter
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimates:
    """What each of some runs says, in the order of time."""

    runs: tuple[str, ...]
    """Names of the runs."""
    poses: tuple[str, ...]
    """Of each run, the pose it was released from: what the model misses differs between them."""
    names: tuple[str, ...]
    """Of the parameters."""
    values: Array
    """(runs, parameters) SI"""
    std: Array
    """(runs, parameters) by the noise of each run alone, SI."""
    b: float | None = None
    """The b that absolute sizes assume, kg m^2; None where the runs fix it. Sizes that scale with it are then ratios
    to it, and their names end in `/b` or `*b`."""


@solvable
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
    begun = nominal_ratios(rig) if start is None else start
    found = [_estimate(run, rig, effects or {}, begun) for run in runs]
    names = found[0][0]
    for run, (own, _, _) in zip(runs, found, strict=True):
        if own != names:
            raise RunError(f"{run.file or run.name}: shows {', '.join(own)}, the first run {', '.join(names)}")
    values, std = (np.array([item[part] for item in found]) for part in (1, 2))
    b = None if "b" in names else float(begun[SCALE])
    return Estimates(tuple(run.name for run in runs), tuple(run.pose or "" for run in runs), names, values, std, b)


def _estimate(
    run: Run, rig: Rig, effects: Mapping[str, Mapping[str, float]], start: Array
) -> tuple[tuple[str, ...], Array, Array]:
    """Names, values and standard deviations of one run's parameters."""
    refuse_without_motion(run, rig)
    _, problem, bare = fit_bare_model(Recordings((record(run, rig),), rig), start)
    found = bare.fit
    if effects:
        at = found.estimate.changed(params=effect_params({name: dict(values) for name, values in effects.items()}))
        found = fit(problem, at, free_parameters(at, tuple(effects), problem))
    A, _ = found.linear.flat
    sizes = np.linalg.norm(A, axis=0)
    if not (sizes > 0).all():
        raise RunError(f"{run.file or run.name}: does not show every parameter: leave it out")
    inverse = np.linalg.pinv((A / sizes).T @ (A / sizes), hermitian=True)
    excess = max(1.0, found.chi2 / problem.measured.size)
    std = np.sqrt(excess * np.diag(inverse)) / sizes
    kept = [i for i, p in enumerate(found.free) if p.block != "zeros"]
    shown = [found.free[i] for i in kept]
    fixed = any(not parameter.effect and parameter.name == "b" for parameter in shown)
    powers = [0 if fixed else _scale_power(parameter) for parameter in shown]
    names = tuple(_name(parameter, power) for parameter, power in zip(shown, powers, strict=True))
    scales = found.estimate.ratios[SCALE] ** np.array(powers, dtype=float)
    return names, np.array([parameter.read(found.estimate) for parameter in shown]) / scales, std[kept] / scales


def _scale_power(parameter: FreeParameter) -> int:
    """How an amplitude follows the scale, which each run alone leaves open."""
    effect = EFFECTS.get(parameter.effect)
    return next((p.scale_power for p in effect.parameters if p.name == parameter.name), 0) if effect else 0


def _name(parameter: FreeParameter, power: int) -> str:
    name = parameter.name if not parameter.effect else f"{parameter.effect}.{parameter.name}"
    return name + {1: "/b", -1: "*b"}.get(power, "")

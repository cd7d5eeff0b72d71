"""Runs and a rig in, an identified model out: search globally, finish at the noise floor, say what was fixed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.errors import ConfigError, IdentificationError, RunError, unknown_name
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import FRICTION, ON_ELBOW, SCALE
from dpr_lab.identification.expected import expected_information
from dpr_lab.identification.identifiability import Identifiability, identifiability, summary
from dpr_lab.identification.merging import merge_segments
from dpr_lab.identification.misread.refuse import refuse_impossible, refuse_misread, refuse_negative_scale
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.misread.tried import second_look
from dpr_lab.identification.model import (
    Covariance,
    EstimatedValue,
    FitSummary,
    Identifiable,
    Model,
    ParameterValue,
    RigFacts,
    RunUsed,
    SearchRecord,
)
from dpr_lab.identification.objectives import OBJECTIVES
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.prior_update import prior_ratio_std, update_prior
from dpr_lab.identification.profile import profile90
from dpr_lab.identification.ratio_fit import RatioFit, predictable_until, short_fit
from dpr_lab.identification.scaling.prior_spread import scale_of, with_intervals
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.identification.uncertainty import RatioUncertainty, uncertainty
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run, as_runs
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.problem import Generation
from dpr_lab.search.settings import SearchSettings
from dpr_lab.version import __version__

Entry = TypeVar("Entry")


@dataclass(frozen=True, slots=True)
class IdentifySettings:
    """What an identification warns of."""

    gap_warning: float = 3.0
    """Reduced chi-square above which the model clearly misses something."""
    doubted: float = 20.0
    """Reduced chi-square above which other readings of the runs are tried."""
    hardly_seen: float = 0.5
    """Standard deviation of a ratio, of its value, from which the runs do not tell it."""


SETTINGS = IdentifySettings()

FRICTION_NAMES = tuple(RATIOS[i] for i in FRICTION)


@solvable
def identify(
    runs: Run | Sequence[Run],
    rig: Rig,
    *,
    objective: str = "segments",
    search: str = "iga",
    settings: SearchSettings | None = None,
    seed: int = 0,
    profile: bool = False,
    on_generation: Callable[[Generation, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    on_polish: Callable[[], None] | None = None,
) -> Model:
    """Identify the kinetic parameters of a rig from free swings.

    The search (IGA by default) finds the basin inside the rig file's bounds; least squares over segments of 0.25 s,
    then over ever longer ones as far as the model follows, give the ratios and their covariance.

    Args:
        runs: what was recorded, one run or several; two of the three poses are enough
        rig: bounds, measured values, encoders
        objective: a name of `OBJECTIVES`: `segments` (chaos-safe, default) or `paper` (E(Z), docs/theory.md equation 2)
        search: a name of `ALGORITHMS`
        settings: of the search; the objective's own by default
        seed: of everything random; same seed, same answer, whatever the number of threads
        profile: also find each ratio's interval by profile likelihood; takes some seconds
        on_generation: called with each generation and the number of generations to come at most
        stop: asked after each generation; once true the search ends there, and its best so far goes on to the polish
        on_polish: called when the search is over and the local fit begins

    Raises:
        ConfigError: no such objective or search.
        RunError: nothing to identify from.
        IdentificationError: not one candidate inside the bounds could be simulated, or the recordings are of no such
            rig: read with another zero, unit, sign or order than they were written with.
    """
    runs = as_runs(runs)
    if not runs:
        raise RunError("no runs to identify from")
    chosen = _choose(OBJECTIVES, objective, "objective")
    algorithm = _choose(ALGORITHMS, search, "search")
    refuse_misread(runs, rig)
    prepared = [preprocess(run, rig) for run in runs]
    settings = settings or _suited(chosen.settings, search)
    if not any(run.setup.free for run in runs):  # the search knows free swings only; the rig file is the start
        settings = settings.model_copy(update={"generations": 1})
    began = time.perf_counter()
    history: list[Generation] = []
    searched = [item for item in prepared if item.run.setup.free] or prepared
    for generation in algorithm.run(chosen.build(searched, rig), rig.bounds, settings, np.random.default_rng(seed)):
        history.append(generation)
        if on_generation:
            on_generation(generation, settings.generations)
        if stop and stop():
            break
    if not np.isfinite(history[0].best_cost):
        raise IdentificationError("no candidate inside the bounds could be simulated: check the rig file's bounds")
    found = SearchRecord(
        algorithm=search,
        objective=objective,
        seed=seed,
        evaluations=history[-1].evaluations,
        seconds=time.perf_counter() - began,
        generations=history[-1].number,
        best=dict(zip(PARAMETERS, history[-1].best.tolist(), strict=True)),
        best_cost=history[-1].best_cost,
        history={
            name: [float(getattr(generation, name)) for generation in history]
            for name in ("evaluations", "best_cost", "best_fitness", "population_fitness")
        },
    )
    if on_polish:
        on_polish()
    return _model(polish(history[-1].best, prepared, rig), prepared, rig, found, profile)


def polish(Z: NDArray[np.float64], runs: Sequence[PreprocessedRun], rig: Rig) -> RatioFit:
    """Least squares from segments of 0.25 s to the longest that the model follows.

    Args:
        Z: (9,) parameters to start from
        runs: with their states and noise
        rig: lengths, gravity, encoders

    Raises:
        IdentificationError: what was found can be no rig's.
    """
    setups = [item.run.setup for item in runs]
    searched = any(not setup.held and setup.free for setup in setups)
    found = merge_segments(short_fit(Z if searched else rig.nominal, runs, rig))
    if not all(setup.held for setup in setups):
        refuse_impossible(found.ratios, rig)
    if SCALE in found.visible:
        refuse_negative_scale(found.fit.estimate.ratios, [item.run for item in runs], rig)
    return found


@solvable
def identifiability_of(
    runs: Run | Sequence[Run], rig: Rig, tell: Callable[[str], object] | None = None
) -> Identifiability:
    """What free swings of a rig can and cannot tell, and what to measure next.

    Example: `dpr.identifiability(runs, rig).null_space`, or `dpr.identifiability([], rig)` before any recording.

    Args:
        runs: one recording or several; none for releases simulated from the rig's poses at the rig file's values
        rig: bounds, measured values, encoders and poses
        tell: takes a sentence on what was done otherwise than one might think

    Raises:
        ConfigError: neither runs nor poses.
        RunError: a run that cannot be used.
        IdentificationError: what was found can be no rig's.
    """
    tell, runs = tell or (lambda sentence: None), as_runs(runs)
    if not runs:
        if not rig.poses:
            raise ConfigError(f"{rig.path}: poses: there are none to simulate; add [poses.X1], or name recorded runs")
        tell(f"no runs given: simulated releases from {', '.join(rig.poses)}, at the rig file's values")
        return identifiability(expected_information(rig.nominal, rig), rig)
    refuse_misread(runs, rig)
    found = polish(rig.nominal, [preprocess(run, rig) for run in runs], rig)
    if not found.fit.converged:
        tell("warning: the fit from the rig file's values did not settle; run `dpr-lab identify` for a global search")
    sure = _determined(uncertainty(found))
    nine, _ = update_prior(sure.values, sure.covariance, rig, found.visible)
    Z = np.array([value.value for value in nine.values()])
    # What the model misses is no better than noise of that size.
    return identifiability(sure.information / max(1.0, found.chi2_per_dof), rig, Z, visible=found.visible)


def _suited(name: str, search: str) -> SearchSettings:
    """The objective's own search file where it is for this algorithm, else the algorithm's defaults."""
    settings = load_search(name)
    return settings if settings.algorithm == search else ALGORITHMS[search].settings()


def _choose(table: Mapping[str, Entry], name: str, kind: str) -> Entry:
    if name not in table:
        raise ConfigError(unknown_name(f"no {kind} named {name}", name, table))
    return table[name]


def _model(found: RatioFit, runs: Sequence[PreprocessedRun], rig: Rig, search: SearchRecord, profile: bool) -> Model:
    sure = _determined(uncertainty(found))
    noise = np.sqrt(np.mean([np.diag(item.noise.covariance) for item in runs], axis=0))
    measured = np.concatenate([item.run.theta[:, 1:] for item in runs])
    rms = np.sqrt(np.mean((measured - found.predicted) ** 2, axis=0))
    ratios = {name: _ratio(found, sure, rig, name, profile) for name in RATIOS}
    parameters, base = update_prior(sure.values, sure.covariance, rig, found.visible)
    scale, unknown = _scale(found, sure, rig, base["b"]), found.fit.estimate.ratios
    parameters, base = with_intervals(parameters, base, ratios, scale, unknown, rig, found.visible)
    return Model(
        rig=RigFacts(name=rig.name, sha256=rig.sha256, L1=rig.L1, g=rig.g),
        ratios=ratios,
        covariance=Covariance(order=list(sure.names), matrix=sure.covariance.tolist()),
        cramer_rao_std=dict.fromkeys(RATIOS, 0.0) | _of_ratios(sure.names, sure.cramer_rao_std),
        p_over_b=float(found.fit.estimate.ratios[ON_ELBOW]) if any(item.run.setup.alone for item in runs) else None,
        parameters=parameters,
        base=base,
        scale=scale,
        identifiability=_identifiable(found, sure, rig, np.array([value.value for value in parameters.values()])),
        fit=FitSummary(
            rms_rad=dict(zip(("theta1", "theta2"), rms.tolist(), strict=True)),
            noise_rad=dict(zip(("theta1", "theta2"), noise.tolist(), strict=True)),
            segments=found.segments,
            chi2_per_dof=found.chi2_per_dof,
            iterations=found.fit.iterations,
            longest_segment_s=found.longest_s,
        ),
        search=search,
        runs=[_used(i, runs[i], found) for i in range(len(runs))],
        warnings=_warnings(found, sure) + _beyond_bounds(parameters, rig),
        failures=_failures(found, sure) + _misread(found, [item.run for item in runs], rig),
        version=__version__,
    )


def _determined(sure: RatioUncertainty) -> RatioUncertainty:
    """The same uncertainty.

    Raises:
        IdentificationError: it is not finite, so that the runs determine nothing.
    """
    if not (np.isfinite(sure.values).all() and np.isfinite(sure.covariance).all()):
        raise IdentificationError(
            "these runs do not determine the ratios: no finite uncertainty. Record larger and longer swings, and check"
            " zero, unit, sign and order of the angles"
        )
    return sure


def _of_ratios(names: Sequence[str], values: NDArray[np.float64]) -> dict[str, float]:
    return {name: value for name, value in zip(names, values.tolist(), strict=True) if name in RATIOS}


def _ratio(found: RatioFit, sure: RatioUncertainty, rig: Rig, name: str, profile: bool) -> EstimatedValue:
    value = float(found.ratios[RATIOS.index(name)])
    if name not in sure.names:
        std = prior_ratio_std(rig)[RATIOS.index(name)]
        reach = NORMAL_Q90 * std
        return EstimatedValue(value=value, std=std, interval90=(value - reach, value + reach), fixed_by="bound")
    i = sure.names.index(name)
    return EstimatedValue(
        value=value,
        std=float(sure.std[i]),
        interval90=sure.interval90(i),
        profile90=_profile(found, sure, i) if profile else None,
    )


def _scale(found: RatioFit, sure: RatioUncertainty, rig: Rig, b: ParameterValue) -> Scale:
    """The scale of absolute sizes: seen by the runs, or the rig file's."""
    if SCALE not in found.visible:
        return scale_of(b, found.fit.estimate.ratios, rig, found.visible)
    low, high = sure.interval90(list(found.visible).index(SCALE))
    return Scale(b=b.value, interval90=(max(low, 1e-3 * b.value), high), fixed_by="data")


def _profile(found: RatioFit, sure: RatioUncertainty, index: int) -> tuple[float | None, float | None]:
    low, high = profile90(found, sure, index)
    return low if np.isfinite(low) else None, high if np.isfinite(high) else None


def _identifiable(found: RatioFit, sure: RatioUncertainty, rig: Rig, Z: NDArray[np.float64]) -> Identifiable:
    seen = sure.information / max(1.0, found.chi2_per_dof)  # what the model misses is no better than noise of that size
    told = identifiability(seen, rig, Z, lengths=False, visible=found.visible)
    return Identifiable.model_validate(summary(told))


def _misread(found: RatioFit, runs: Sequence[Run], rig: Rig) -> list[str]:
    """What speaks against the description of runs that the model is far from explaining."""
    look = second_look(runs, rig) if found.chi2_per_dof > SETTINGS.doubted else None
    return [look.sentence] if look and look.sentence else []


def _used(index: int, item: PreprocessedRun, found: RatioFit) -> RunUsed:
    run, mine = item.run, np.flatnonzero(found.problem.segments.run == index)
    return RunUsed(
        file=str(run.file or run.name),
        sha256=run.sha256,
        pose=run.pose,
        samples=len(run.t),
        duration_s=run.duration,
        chi2_per_dof=float(found.fit.linear.chi2_by_segment[mine].sum())
        / ((1 if run.setup.alone else 2) * len(run.t) - run.setup.starts * len(mine)),
        segments=len(mine),
        horizon_s=predictable_until(found, int(mine[0]), run.t),
        torque_kind=run.torque_kind,
        zeros_rad=found.fit.estimate.zeros[index].tolist() if found.problem.rezeroed else [],
    )


def _warnings(found: RatioFit, sure: RatioUncertainty) -> list[str]:
    said = []
    if found.chi2_per_dof > SETTINGS.gap_warning:
        said.append(
            f"the residual is {found.chi2_per_dof**0.5:.1f} times the noise floor over segments of"
            f" {found.longest_s:.2g} s: the model misses something of this rig"
        )
    said += [f"{name} is held at zero: the data ask for less friction than none" for name in sure.at_zero]
    said += [
        f"{name} is hardly seen in these runs: its standard deviation exceeds half its value"
        for name, value, std in zip(sure.names, sure.values, sure.std, strict=True)
        if name in FRICTION_NAMES and value > 0 and std > SETTINGS.hardly_seen * value
    ]
    unseen = [name for name in RATIOS if name not in sure.names]
    if unseen:
        said.append(
            f"these runs do not show {', '.join(unseen)}: they are the rig file's; record swings of both rods to see"
            " them"
        )
    return said


def _beyond_bounds(parameters: Mapping[str, ParameterValue], rig: Rig) -> list[str]:
    lower, upper = rig.bounds
    return [
        f"{name} = {value.value:.4g} lies outside its bounds {lower[i]:.4g} .. {upper[i]:.4g}: the data and the"
        " measured values ask for it, so check the bounds, the measured values, L1 and g"
        for i, (name, value) in enumerate(parameters.items())
        if rig.searched[i] and not 0.999 * lower[i] <= value.value <= 1.001 * upper[i]
    ]


def _failures(found: RatioFit, sure: RatioUncertainty) -> list[str]:
    said = []
    if not found.fit.converged:
        said.append(f"the local solver did not settle in {found.fit.iterations} iterations: start from tighter bounds")
    said += [
        f"{name} is not identifiable from these runs: its standard deviation is {std / value:.0%} of its value"
        for name, value, std in zip(sure.names, sure.values, sure.std, strict=True)
        if name in RATIOS and name not in FRICTION_NAMES and not std / value < SETTINGS.hardly_seen
    ]
    return said

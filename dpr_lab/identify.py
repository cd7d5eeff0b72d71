"""Runs and a rig in, an identified model out: search globally, finish at the noise floor, say what was fixed."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dpr_lab import __version__
from dpr_lab.dynamics.base import BASE, RATIOS, base_parameters, ratios
from dpr_lab.errors import ConfigError, IdentificationError, RunError
from dpr_lab.estimation.anchors import anchor
from dpr_lab.estimation.evidence import Evidence, conditions, gather
from dpr_lab.estimation.growth import free_run, grow
from dpr_lab.estimation.least_squares import UNKNOWNS, Conditions, SegmentFit, fit_segments
from dpr_lab.estimation.profile import profile90
from dpr_lab.estimation.segments import cut
from dpr_lab.identifiability import identifiability, summary
from dpr_lab.model import (
    Covariance,
    Estimate,
    Fit,
    Identifiable,
    Model,
    ParameterValue,
    RigFacts,
    RunUsed,
    SearchRecord,
)
from dpr_lab.objectives import OBJECTIVES
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.problem import Generation
from dpr_lab.search.settings import SearchSettings

Entry = TypeVar("Entry")

FIRST_SEGMENT_S = 0.25  # converges from any start inside +-20 % bounds
WORKING_SEGMENT_S = 0.5
GAP_WARNING = 3.0  # reduced chi-square above which the model clearly misses something


def identify(
    runs: Sequence[Run],
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

    The search (IGA by default) finds the basin inside the rig file's bounds; segment least squares then grows from
    0.25 s segments to the longest the model follows, and gives the ratios their covariance.

    Args:
        runs: what was recorded; two of the three poses are enough
        rig: bounds, measured values, encoders
        objective: a name of `OBJECTIVES`: `segments` (chaos-safe, default) or `paper` (E(Z), equation 2)
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
        IdentificationError: not one candidate inside the bounds could be simulated.
    """
    if not runs:
        raise RunError("no runs to identify from")
    chosen = _choose(OBJECTIVES, objective, "objective")
    algorithm = _choose(ALGORITHMS, search, "search")
    evidence = [gather(run, rig) for run in runs]
    settings = settings or _suited(chosen.settings, search)
    began = time.perf_counter()
    history: list[Generation] = []
    for generation in algorithm.run(chosen.build(evidence, rig), rig.bounds, settings, np.random.default_rng(seed)):
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
    return _model(polish(history[-1].best, evidence, rig), evidence, rig, found, profile)


def polish(Z: NDArray[np.float64], evidence: Sequence[Evidence], rig: Rig) -> SegmentFit:
    """Segment least squares from 0.25 s to the longest segments the model follows.

    Args:
        Z: (9,) parameters to start from
        evidence: the runs with their states and noise
        rig: for L1 and g
    """
    known = conditions(evidence, rig)
    base = base_parameters(Z, rig.rig.L1, rig.rig.g)
    start = np.append(ratios(base), base[BASE.index("b")])[: known.unknowns]
    for length in (FIRST_SEGMENT_S, WORKING_SEGMENT_S):
        segments = [s for i, item in enumerate(evidence) for s in cut(i, item.run, item.states, length)]
        fit = fit_segments(start, segments, known)
        start = fit.unknowns
    return grow(fit, known)


def _suited(name: str, search: str) -> SearchSettings:
    """The objective's own search file where it is for this algorithm, else the algorithm's defaults."""
    settings = load_search(name)
    return settings if settings.algorithm == search else ALGORITHMS[search].settings()


def _choose(table: Mapping[str, Entry], name: str, kind: str) -> Entry:
    if name not in table:
        raise ConfigError(f"no {kind} named {name!r}; there are: {', '.join(table)}")
    return table[name]


def _model(fit: SegmentFit, evidence: Sequence[Evidence], rig: Rig, found: SearchRecord, profile: bool) -> Model:
    residuals = [s.theta - p for s, p in zip(fit.segments, fit.predicted, strict=True)]
    noise = np.sqrt(np.mean([np.diag(item.noise.covariance) for item in evidence], axis=0))
    rms = np.sqrt(np.mean(np.concatenate(residuals) ** 2, axis=0))
    std = np.sqrt(np.diag(fit.covariance))
    parameters, base = anchor(fit.unknowns, fit.covariance, rig)
    return Model(
        rig=RigFacts(name=rig.name, sha256=rig.sha256, L1=rig.rig.L1, g=rig.rig.g),
        ratios={
            name: Estimate(
                value=float(fit.ratios[i]),
                std=float(std[i]),
                interval90=fit.interval90(i),
                profile90=_profile(fit, i, conditions(evidence, rig)) if profile else None,
            )
            for i, name in enumerate(RATIOS)
        },
        covariance=Covariance(order=list(UNKNOWNS[: len(fit.unknowns)]), matrix=fit.covariance.tolist()),
        cramer_rao_std=dict(zip(RATIOS, fit.cramer_rao_std.tolist(), strict=False)),
        parameters=parameters,
        base=base,
        identifiability=_identifiable(fit, rig, np.array([value.value for value in parameters.values()])),
        fit=Fit(
            rms_rad=dict(zip(("theta1", "theta2"), rms.tolist(), strict=True)),
            noise_rad=dict(zip(("theta1", "theta2"), noise.tolist(), strict=True)),
            segments=len(fit.segments),
            chi2_per_dof=fit.chi2_per_dof,
            iterations=fit.iterations,
            longest_segment_s=max(s.duration for s in fit.segments),
        ),
        search=found,
        runs=[_used(i, evidence, fit, rig) for i in range(len(evidence))],
        warnings=_warnings(fit) + _beyond_bounds(parameters, rig),
        failures=_failures(fit),
        version=__version__,
    )


def _profile(fit: SegmentFit, index: int, known: Conditions) -> tuple[float | None, float | None]:
    low, high = profile90(fit, index, known)
    return low if np.isfinite(low) else None, high if np.isfinite(high) else None


def _identifiable(fit: SegmentFit, rig: Rig, Z: NDArray[np.float64]) -> Identifiable:
    return Identifiable.model_validate(summary(identifiability(fit.information / max(1.0, fit.chi2_per_dof), rig, Z)))


def _used(index: int, evidence: Sequence[Evidence], fit: SegmentFit, rig: Rig) -> RunUsed:
    run = evidence[index].run
    mine = [i for i, segment in enumerate(fit.segments) if segment.run == index]
    _, horizon = free_run(fit, mine[0], run.t, conditions(evidence, rig))
    samples = sum(len(fit.segments[i].t) for i in mine)
    return RunUsed(
        file=str(run.file or run.name),
        sha256=run.sha256,
        pose=run.pose,
        samples=samples,
        duration_s=run.duration,
        chi2_per_dof=sum(fit.chi2_by_segment[i] for i in mine) / (2 * samples - 4 * len(mine)),
        segments=len(mine),
        horizon_s=horizon,
    )


def _warnings(fit: SegmentFit) -> list[str]:
    said = []
    if fit.chi2_per_dof > GAP_WARNING:
        said.append(
            f"the residual is {fit.chi2_per_dof**0.5:.1f} times the noise floor over segments of"
            f" {max(s.duration for s in fit.segments):.2g} s: the model misses something of this rig"
        )
    said += [f"{name} is held at zero: the data ask for less friction than none" for name in fit.at_zero]
    said += [
        f"{RATIOS[i]} is hardly seen in these runs: its standard deviation exceeds half its value"
        for i in (3, 4)
        if fit.ratios[i] > 0 and fit.covariance[i, i] ** 0.5 > fit.ratios[i] / 2
    ]
    return said


def _beyond_bounds(parameters: Mapping[str, ParameterValue], rig: Rig) -> list[str]:
    lower, upper = rig.bounds
    return [
        f"{name} = {value.value:.4g} lies outside its bounds {lower[i]:.4g} .. {upper[i]:.4g}: the data and the"
        " measured values ask for it, so check the bounds, the measured values, L1 and g"
        for i, (name, value) in enumerate(parameters.items())
        if rig.searched[i] and not 0.999 * lower[i] <= value.value <= 1.001 * upper[i]
    ]


def _failures(fit: SegmentFit) -> list[str]:
    said = []
    if not fit.converged:
        said.append(f"the local solver did not settle in {fit.iterations} iterations: start from tighter bounds")
    relative = np.sqrt(np.diag(fit.covariance)[:3]) / fit.ratios[:3]
    said += [
        f"{RATIOS[i]} is not identifiable from these runs: its standard deviation is {relative[i]:.0%} of its value"
        for i in np.flatnonzero(~(relative < 0.5))
    ]
    return said

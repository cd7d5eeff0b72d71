"""Identify a model from runs by global search and least squares."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError, IdentificationError, RunError, unknown_name
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.identification.expected import expected_information
from dpr_lab.identification.identifiability import Identifiability, identifiability
from dpr_lab.identification.identified import determined, identified_model
from dpr_lab.identification.merging import merge_segments
from dpr_lab.identification.misread.refuse import refuse_impossible, refuse_impossible_scale, refuse_misread
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.model import (
    Model,
    SearchRecord,
)
from dpr_lab.identification.objectives import OBJECTIVES
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.prior_update import update_prior
from dpr_lab.identification.ratio_fit import RatioFit, short_fit
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run, as_runs
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.problem import Generation
from dpr_lab.search.settings import SearchSettings

Entry = TypeVar("Entry")


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
    """Identify the kinetic parameters of a rig from runs with a clamped or prescribed arm.

    See `dpr_lab.identification.moving_arm.any_arm.identify` for the arguments; it accepts every mode of the
    arm.

    Raises:
        ConfigError: the objective or the search is unknown.
        RunError: there are no runs.
        IdentificationError: no candidate inside the bounds could be simulated, or the recordings do not match the rig
            because zero, unit, sign or order of the readings is specified incorrectly.
    """
    runs = as_runs(runs)
    if not runs:
        raise RunError("no runs to identify from")
    chosen = _choose(OBJECTIVES, objective, "objective")
    algorithm = _choose(ALGORITHMS, search, "search")
    refuse_misread(runs, rig)
    prepared_runs = [preprocess(run, rig) for run in runs]
    settings = settings or _suited(chosen.settings, search)
    if not any(
        run.setup.free for run in runs
    ):  # the search supports free swings only; otherwise the fit starts from the rig file
        settings = settings.model_copy(update={"generations": 1})
    began = time.perf_counter()
    history: list[Generation] = []
    searched = [swing for swing in prepared_runs if swing.run.setup.free] or prepared_runs
    for generation in algorithm.run(chosen.build(searched, rig), rig.bounds, settings, np.random.default_rng(seed)):
        history.append(generation)
        if on_generation:
            on_generation(generation, settings.generations)
        if stop and stop():
            break
    if not np.isfinite(history[0].best_cost):
        raise IdentificationError("no candidate inside the bounds could be simulated: check the bounds in the rig file")
    record = SearchRecord(
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
    return identified_model(polish(history[-1].best, prepared_runs, rig), prepared_runs, rig, record, profile)


def polish(Z: Array, runs: Sequence[PreprocessedRun], rig: Rig) -> RatioFit:
    """Fit the ratios by least squares in longer and longer segments.

    Segments grow as long as the model follows the readings. The first segments have a length of 0.25 s.

    Args:
        Z: (9,) initial parameters
        runs: runs with their states and noise
        rig: lengths, gravity, encoders

    Raises:
        IdentificationError: the fitted values are physically impossible.
    """
    setups = [prepared.run.setup for prepared in runs]
    searched = any(not setup.held and setup.free for setup in setups)
    ratio_fit = merge_segments(short_fit(Z if searched else rig.nominal, runs, rig))
    if not all(setup.held for setup in setups):
        refuse_impossible(ratio_fit.ratios, rig)
    if SCALE in ratio_fit.visible:
        refuse_impossible_scale(ratio_fit.fit.estimate.ratios, [prepared.run for prepared in runs], rig)
    return ratio_fit


@solvable
def identifiability_of(
    runs: Run | Sequence[Run], rig: Rig, tell: Callable[[str], object] | None = None
) -> Identifiability:
    """Analyse which parameters of a rig free swings determine, and recommend bench measurements.

    Example: `dpr.identifiability(runs, rig).null_space`, or `dpr.identifiability([], rig)` before any recording.

    Args:
        runs: one or several recordings; if empty, releases from the poses of the rig are simulated with the values of
            the rig file
        rig: bounds, measured values, encoders and poses
        tell: function that is called with each notice or warning

    Raises:
        ConfigError: there are neither runs nor poses.
        RunError: a run cannot be used.
        IdentificationError: the fitted values are physically impossible.
    """
    tell, runs = tell or (lambda sentence: None), as_runs(runs)
    if not runs:
        if not rig.poses:
            raise ConfigError(
                f"{rig.path}: poses: there are no poses to simulate; add [poses.X1], or give recorded runs"
            )
        tell(f"no runs given: simulated releases from {', '.join(rig.poses)}, with the values of the rig file")
        return identifiability(expected_information(rig.nominal, rig), rig)
    refuse_misread(runs, rig)
    ratio_fit = polish(rig.nominal, [preprocess(run, rig) for run in runs], rig)
    if not ratio_fit.fit.converged:
        tell(
            "warning: the fit from the values of the rig file did not converge; run `dpr-lab identify` for"
            " a global search"
        )
    ratio_uncertainty = determined(uncertainty(ratio_fit))
    nine, _ = update_prior(ratio_uncertainty.values, ratio_uncertainty.of_runs, rig, ratio_fit.visible)
    Z = np.array([value.value for value in nine.values()])
    # A residual above the noise floor is treated as noise of that size.
    return identifiability(
        ratio_uncertainty.information / max(1.0, ratio_fit.chi2_per_dof), rig, Z, visible=ratio_fit.visible
    )


def _suited(name: str, search: str) -> SearchSettings:
    """Load the search file of the objective if it is for this algorithm.

    Otherwise return the defaults of the algorithm.
    """
    settings = load_search(name)
    return settings if settings.algorithm == search else ALGORITHMS[search].settings()


def _choose(table: Mapping[str, Entry], name: str, kind: str) -> Entry:
    if name not in table:
        raise ConfigError(unknown_name(f"no {kind} named {name}", name, table))
    return table[name]

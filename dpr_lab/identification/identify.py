"""Identification of a rig with an arm in any mode, and analysis of its identifiable parameters."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError, IdentificationError, RunError, refuse_unknown
from dpr_lab.estimation.usable_runs import refuse_unusable
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.identification.expected import mounted_releases
from dpr_lab.identification.identifiability import Identifiability
from dpr_lab.identification.identifiability import identifiability as analysed
from dpr_lab.identification.identified import identified_model
from dpr_lab.identification.merging import merge_segments
from dpr_lab.identification.misread.refuse import refuse_impossible, refuse_impossible_scale, refuse_misread
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.model import SearchRecord
from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability, identifiability_of_arm
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.identification.objectives import OBJECTIVES
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.prior_update import clamped_cosine, posterior_of
from dpr_lab.identification.ratio_fit import RatioFit, information, short_fit, visible_of
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run, as_runs, moves
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.problem import Generation
from dpr_lab.search.settings import SearchSettings
from dpr_lab.setup import only_inner


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
) -> AnyModel:
    """Identify the parameters of a rig from recordings.

    With a clamped or prescribed arm, a global search (by default the improved genetic algorithm, IGA) finds initial
    values within the bounds of the rig file. A least-squares fit then estimates the ratios and their covariance. It
    starts with segments of 0.25 s, which are lengthened as long as the model follows the readings.

    With a free or driven arm, the parameters of arm and drive are identified as well. The same least-squares fit then
    starts from the values of the rig file, and the search options below have no effect. A genetic algorithm searches
    for initial values only if this fit fails.

    Args:
        runs: one or several runs; two free swings from different poses are sufficient
        rig: bounds, measured values, encoders
        objective: a name of `OBJECTIVES`: `segments` (default) or `paper` (E(Z), docs/theory.md equation 2)
        search: a name of `ALGORITHMS`
        settings: settings of the search; default: those of the objective
        seed: seed of all random numbers; the same seed gives the same result for any number of threads
        profile: whether to compute the interval of each ratio by profile likelihood as well, which takes some seconds
        on_generation: function that is called with each generation and the maximum number of generations
        stop: function that is called after each generation; if it returns true the search ends, and the local fit
            starts from the best individual
        on_polish: function that is called at the start of the local fit

    Returns:
        `MovingArmModel` if the arm of a run is free or driven, or if a single rod swings on a clamped arm of a rig
        whose arm is free or driven in the rig file; otherwise `Model`. Both have `ratios`, `warnings`, `failures` and
        `save`.

    Raises:
        ConfigError: the objective or the search is unknown.
        RunError: there are no runs, a run is given twice, or a run cannot be used or belongs to another rig.
        IdentificationError: a run has a gap that is too long, no candidate inside the bounds could be simulated, the
            recordings determine no parameter, or they do not match the rig because zero, unit, sign or order of the
            readings is specified incorrectly.

    Source: docs/theory.md, section 2 (search), 5 (multiple shooting), 11 and 12 (parameters from ratios).
    """
    runs = as_runs(runs)
    refuse_unusable(runs, rig)
    if has_arm_model(runs, rig):
        if on_polish:
            on_polish()
        return identify_moving_arm(runs, rig)
    if not runs:
        raise RunError("no runs to identify from")
    refuse_unknown([objective], OBJECTIVES, "objective")
    refuse_unknown([search], ALGORITHMS, "search")
    chosen = OBJECTIVES[objective]
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
    rng = np.random.default_rng(seed)
    for generation in ALGORITHMS[search].run(chosen.build(searched, rig), rig.bounds, settings, rng):
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


def has_arm_model(runs: Sequence[Run], rig: Rig) -> bool:
    """Check whether `identify` returns a `MovingArmModel` for these runs.

    This is the case if the arm of a run is free or driven. It is also the case for a rotary pendulum with a single rod
    and a clamped arm, because its recordings determine only ratios to the inertia of the rod.
    """
    alone = rig.rods.mounted == "inner" and rig.arm.mode in ("free", "driven")
    return moves(runs) or (alone and bool(runs) and not any(run.arm_mode == "prescribed" for run in runs))


def polish(Z: Array, runs: Sequence[PreprocessedRun], rig: Rig) -> RatioFit:
    """Fit the ratios by least squares, first in segments of 0.25 s.

    The segments are lengthened as long as the model follows the readings.

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
def identifiability(
    runs: Run | Sequence[Run], rig: Rig, tell: Callable[[str], object] | None = None
) -> Identifiability | ArmIdentifiability:
    """Analyse which parameters of a rig its recordings determine, and recommend bench measurements.

    Example: `dpr.identifiability(runs, rig).null_space`, or `dpr.identifiability([], rig)` before any recording.

    Args:
        runs: one or several recordings; if empty, releases from the poses of the rig are simulated with the values of
            the rig file
        rig: bounds, measured values, encoders, poses and motor
        tell: function that is called with each notice or warning

    Returns:
        `ArmIdentifiability` if the arm is free or driven in a run (without runs: in the rig file); otherwise
        `Identifiability`.

    Raises:
        ConfigError: there are neither runs nor poses; or a joint of the rig is prescribed, and there are no runs that
            contain its motion.
        RunError: a run is given twice, cannot be used, or belongs to another rig.
        IdentificationError: a run has a gap that is too long, or the fitted values are physically impossible or cannot
            be simulated.

    Source: docs/theory.md, sections 3 and 16.
    """
    tell, runs = tell or (lambda sentence: None), as_runs(runs)
    refuse_unusable(runs, rig)
    if moves(runs) or (not runs and rig.arm.mode in ("free", "driven")):
        return identifiability_of_arm(runs, rig)
    if not runs:
        if "prescribed" in (rig.joints.inner, rig.arm.mode):
            joint = "inner rod" if rig.joints.inner == "prescribed" else "arm"
            raise ConfigError(
                f"the {joint} of rig {rig.name} is prescribed: its motion, which determines the identifiable"
                " parameters, is known only from recordings. Give runs, for example runs/*.mcap"
            )
        if not rig.poses:
            raise ConfigError(
                f"{rig.path}: poses: there are no poses to simulate; add [poses.X1], or give recorded runs"
            )
        tell(f"no runs given: simulated releases from {', '.join(rig.poses)}, with the values of the rig file")
        problem, estimate = mounted_releases(rig.nominal, rig)
        setups, visible = problem.segments.setups, visible_of(problem.segments)
        alone, clamped = only_inner(setups), clamped_cosine(setups)
        posterior = posterior_of(estimate.ratios, rig, visible, alone=alone, clamped=clamped)
        return analysed(information(problem, estimate), rig, posterior)
    refuse_misread(runs, rig)
    ratio_fit = polish(rig.nominal, [preprocess(run, rig) for run in runs], rig)
    if not ratio_fit.fit.converged:
        tell(
            "warning: the fit from the values of the rig file did not converge; run `dpr-lab identify` for"
            " a global search"
        )
    ratio_uncertainty = uncertainty(ratio_fit)
    posterior = posterior_of(
        ratio_fit.fit.estimate.ratios,
        rig,
        ratio_fit.visible,
        ratio_uncertainty.of_runs,
        alone=only_inner(run.setup for run in runs),
        clamped=clamped_cosine(run.setup for run in runs),
    )
    return analysed(ratio_uncertainty.information / ratio_fit.noise_factor, rig, posterior)


def _suited(name: str, search: str) -> SearchSettings:
    """Return the settings of the search file `name` if it is for the algorithm `search`.

    Otherwise return the default settings of the algorithm.
    """
    settings = load_search(name)
    return settings if settings.algorithm == search else ALGORITHMS[search].settings()

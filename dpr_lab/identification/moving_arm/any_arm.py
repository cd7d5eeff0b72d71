"""Identify a rig with any mode of the arm, and read its models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.estimation.usable_runs import refuse_other_rigs, refuse_repeated
from dpr_lab.identification.identifiability import Identifiability
from dpr_lab.identification.identify import identifiability_of
from dpr_lab.identification.identify import identify as identify_rods
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.identification.model import Model
from dpr_lab.identification.model import load_model as load_rods_model
from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability, identifiability_of_arm
from dpr_lab.identification.moving_arm.identify import identify_moving_arm
from dpr_lab.identification.moving_arm.model import MovingArmModel, load_moving_arm_model
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_runs, moves
from dpr_lab.search.problem import Generation
from dpr_lab.search.settings import SearchSettings


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
) -> Model | MovingArmModel:
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
        IdentificationError: no candidate inside the bounds could be simulated, the recordings determine no parameter,
            or they do not match the rig because zero, unit, sign or order of the readings is specified incorrectly.

    Source: docs/theory.md, section 2 (search), 5 (multiple shooting), 11 and 12 (parameters from ratios).
    """
    runs = as_runs(runs)
    refuse_repeated(runs)
    refuse_other_rigs(runs, rig.name)
    if has_arm_model(runs, rig):
        if on_polish:
            on_polish()
        return identify_moving_arm(runs, rig)
    return identify_rods(
        runs,
        rig,
        objective=objective,
        search=search,
        settings=settings,
        seed=seed,
        profile=profile,
        on_generation=on_generation,
        stop=stop,
        on_polish=on_polish,
    )


def has_arm_model(runs: Sequence[Run], rig: Rig) -> bool:
    """Check whether `identify` returns a `MovingArmModel` for these runs.

    The result is also true for recordings of a rotary pendulum with a single rod and a clamped arm. These recordings
    determine only ratios to the inertia of the rod.
    """
    alone = rig.rods.mounted == "inner" and rig.arm.mode in ("free", "driven")
    return moves(runs) or (alone and bool(runs) and not any(run.arm_mode == "prescribed" for run in runs))


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
        RunError: a run cannot be used, or belongs to another rig.
        IdentificationError: the fitted values are physically impossible, or cannot be simulated.

    Source: docs/theory.md, sections 3 and 16.
    """
    runs = as_runs(runs)
    refuse_other_rigs(runs, rig.name)
    if moves(runs) or (not runs and rig.arm.mode in ("free", "driven")):
        return identifiability_of_arm(runs, rig)
    if not runs and "prescribed" in (rig.joints.inner, rig.arm.mode):
        joint = "inner rod" if rig.joints.inner == "prescribed" else "arm"
        raise ConfigError(
            f"the {joint} of rig {rig.name} is prescribed: its motion, which determines the identifiable parameters,"
            " is known only from recordings. Give runs, for example runs/*.mcap"
        )
    return identifiability_of(runs, rig, tell)


def load_model(path: Path | str) -> Model | MovingArmModel:
    """Read a model file `model.json` that `identify` or `diagnose --out` has written.

    Args:
        path: path of the file

    Returns:
        `MovingArmModel` for a rig with a free or driven arm, otherwise `Model`

    Raises:
        RunError: the file is missing, not JSON, or not a model; the message names the key.
    """
    return load_moving_arm_model(Path(path)) or load_rods_model(path)

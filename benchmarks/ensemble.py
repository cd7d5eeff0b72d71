"""Predictive bands of an ensemble of sampled models: share of the readings of held-out recordings that they contain.

    python benchmarks/ensemble.py [--plants 24] [--first 9000] [--members 50] [--real ../shared/data/real]

    [--mujoco 12] [--driven 12] [--identify] [--json]

Simulated plants are drawn as for blind trials. Three recordings of 5 s are diagnosed, and three from other poses are
held out. `--mujoco` does the same with rigs in MuJoCo that have one to three of the planted errors of
`benchmarks/simulator_models.py`. `--driven` uses plants with driven joints, with or without a random fault of the
drives; the held-out recordings have other torques. Every recording of a real rig is held out once. A single recording
is cut into pieces, and every second piece is held out. Recordings that spend more than half of their time beyond the
fitted amplitudes are pooled separately, without a target. The readings of one recording are strongly dependent.
Therefore the standard error is that of the mean over recordings.
"""

import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from _bars import Bar, options, show
from _trial_cases import Case, hidden
from real import RealRig, rigs
from simulator_models import KINDS, PLANTED, RIGHT, mjcf

sys.path.insert(0, str(Path(__file__).parents[1]))
from dpr_lab.errors import DprError
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.ensemble.amplitudes import beyond_fitted, fitted_amplitudes
from dpr_lab.exports.ensemble.bands import PredictiveBand, predictive_band
from dpr_lab.exports.ensemble.calibrate import widened
from dpr_lab.exports.ensemble.left_out import factor_without
from dpr_lab.exports.ensemble.sampled import ensemble_posterior, sampled_models
from dpr_lab.exports.ensemble.scatter import scatter_of_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification.identify import identify
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.workflows.rig_from import rig_from_model
from sim_device.trials.driven import drawn_drives, drawn_fault, driven_runs
from sim_device.trials.offline_recorder import record
from tests.exports.planted_errors import STARTS, recordings

DRAWS = ("single", "clean", "pair", "single", "triple", "background")
"""Kinds of the plants, in turn."""
PIECE_S = 5.0
"""Duration of a piece of a single real recording, s."""
PIECES = 8
OTHER_TORQUES = 1_000_000
"""Number added to a seed for the torques of held-out recordings."""
BEYOND = 0.5
"""Share of a recording's time beyond the fitted amplitudes above which its bands need not contain its readings."""


Fitted = tuple[Model, list[PosteriorComponent], str]
"""A model, its posterior, and the verdict or method of its fit."""
Tested = tuple[PredictiveBand, float]
"""A band, and the share of time of its recording beyond the fitted amplitudes."""


def diagnosed(fitted: list[Run], rig: Rig) -> Fitted:
    """Corrected model and posterior of a diagnosis."""
    diagnosis = diagnose(fitted, rig)
    model = corrected_model(diagnosis, fitted, rig)
    assert isinstance(model, Model)
    return model, ensemble_posterior(model, diagnosis), diagnosis.verdict


def identified(fitted: list[Run], rig: Rig) -> Fitted:
    """Model and posterior of an identification, without effects."""
    model = identify(fitted, rig)
    return model, ensemble_posterior(model, None, scatter_of_ratios(model, fitted, rig)), "identify"


def bands(
    fit: Callable[[list[Run], Rig], Fitted], fitted: list[Run], held_out: list[Run], rig: Rig, members: int, seed: int
) -> Iterator[Tested]:
    """Compute the bands of an ensemble for held-out recordings.

    If this is not possible, the error is printed.
    """
    try:
        model, posterior, verdict = fit(fitted, rig)
        factor = factor_without(model, posterior, fitted, rig, seed)
        ensemble = sampled_models(model, widened(posterior, factor), members, seed)
        sets = [f"{'+'.join(c.effects) or 'none'} {c.probability:.2f}" for c in posterior]
        print(f"# {verdict}, widened by {factor:.2f}: {'; '.join(sets)}", flush=True)
        amplitudes = fitted_amplitudes(model, fitted, rig)
        assert amplitudes is not None
        for run in held_out:
            band = predictive_band(model, ensemble, run, rig, seed)
            beyond = beyond_fitted(amplitudes, band, model, run, rig)
            within = f"{100 * band.covered:.1f} % of {band.readings}"
            size = f"{1e3 * band.width_rad:.3g} mrad wide"
            print(
                f"#   {band.run}: {within}, until {band.horizon_s:.2f} s, {size}, {100 * beyond:.0f} % beyond",
                flush=True,
            )
            if band.readings:
                yield band, beyond
    except DprError as error:
        print(f"#   not possible: {error}", flush=True)


def simulated(seed: int, members: int, fit: Callable[[list[Run], Rig], Fitted]) -> Iterator[Tested]:
    """Bands of one simulated plant."""
    kind = DRAWS[seed % len(DRAWS)]
    plant, rig = hidden(Case("", kind, seed))
    print(f"# {seed}, {kind}: {'+'.join(plant.effects) or 'no effect'}")
    unseen = record(plant, elsewhere(rig), duration=5.0, before=len(rig.poses))
    yield from bands(fit, list(record(plant, rig, duration=5.0)), list(unseen), rig, members, seed)


def elsewhere(rig: Rig) -> Rig:
    """Copy of the rig with other poses."""
    poses = {
        name: pose.model_copy(update={"theta1": pose.theta1 + 0.5, "theta2": pose.theta2 - 0.7})
        for name, pose in rig.poses.items()
    }
    return rig.model_copy(update={"poses": poses})


def in_mujoco(seed: int, members: int, fit: Callable[[list[Run], Rig], Fitted]) -> Iterator[Tested]:
    """Bands of one rig that MuJoCo simulates.

    The rig file is created from the model without the planted errors.
    """
    rng = np.random.default_rng([29, seed])
    kinds = [kind for kind in KINDS["xml"] if not kind.startswith("gear")]  # a gear is visible only in driven rods
    errors = rng.choice(kinds, 1 + seed % 3, replace=False).tolist()
    truth = mjcf(RIGHT | {kind: float(rng.uniform(*PLANTED[kind][2])) for kind in errors})
    print(f"# MuJoCo {seed}: {', '.join(errors)}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "robot.xml"
        file.write_text(mjcf(RIGHT), encoding="utf-8")
        rig_from_model(file, Path(folder) / "rig.toml")
        rig = load_rig(Path(folder) / "rig.toml")
    others = [(theta1 + 0.5, theta2 - 0.7) for theta1, theta2 in STARTS]
    fitted, unseen = (recordings(truth, rig, 5.0, starts=starts) for starts in (STARTS, others))
    renamed = [replace(run, name=f"held out {k}") for k, run in enumerate(unseen)]
    yield from bands(fit, fitted, renamed, rig, members, seed)


def driven(seed: int, members: int, fit: Callable[[list[Run], Rig], Fitted]) -> Iterator[Tested]:
    """Bands of one plant with driven joints.

    The held-out recordings have other torques and other poses.
    """
    fault, rig = drawn_fault(seed), load_rig("paper")
    print(f"# driven {seed}: {fault.name if fault else 'no fault'}")
    plant, fitted = driven_runs(rig, seed, fault=fault, duration=PIECE_S)
    others = drawn_drives(plant.model_copy(update={"seed": OTHER_TORQUES + seed}))
    unseen = record(plant, elsewhere(rig), duration=PIECE_S, drives=others, before=len(rig.poses))
    yield from bands(fit, fitted, list(unseen), rig, members, seed)


def real(rig: RealRig, members: int, fit: Callable[[list[Run], Rig], Fitted]) -> Iterator[Tested]:
    """Bands of one real rig."""
    print(f"# {rig.title}")
    folds = list(rig.folds)
    if len(rig.runs) == 1:
        pieces = _pieces(rig.runs[0])
        folds = [(pieces[0::2], pieces[1::2])]
    for fitted, unseen in folds:
        yield from bands(fit, fitted, unseen, rig.rig, members, 0)


def _pieces(run: Run) -> list[Run]:
    """At most `PIECES` pieces of a recording, of equal length, each with its own time."""
    swing = run.swing
    length = min(10.0, max(PIECE_S, float(swing.t[-1]) / PIECES)) if swing.t[-1] > 2 * PIECE_S else swing.t[-1] / 4
    begins = swing.t[0] + length * np.arange(int(swing.t[-1] / length + 1e-9))
    cut = [run.only((run.t >= begin) & (run.t < begin + length)) for begin in begins.tolist()]
    return [replace(piece, t=piece.t - piece.t[0], name=f"piece {k}") for k, piece in enumerate(cut[:PIECES])]


def pooled(name: str, some: list[Tested], target: bool = True) -> Bar:
    """Coverage of all readings of some recordings."""
    shares, counts = np.array([band.covered for band, _ in some]), np.array([band.readings for band, _ in some])
    share = 100 * float(shares @ counts / counts.sum())
    error = 100 * float(shares.std() / len(shares) ** 0.5)
    words = f"{name}: 90 % bands cover, %, {len(some)} recordings, standard error {error:.2g}"
    return Bar(words, "86 .. 94", share, bool(86 <= share <= 94)) if target else Bar(words, "-", share, None)


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=24)
    parser.add_argument("--first", type=int, default=9000)
    parser.add_argument("--members", type=int, default=50)
    parser.add_argument("--real", type=Path, default=Path(__file__).parents[2] / "shared" / "data" / "real")
    parser.add_argument("--mujoco", type=int, default=0, help="number of rigs in MuJoCo")
    parser.add_argument("--driven", type=int, default=0, help="number of plants with driven joints")
    parser.add_argument("--identify", action="store_true", help="models of `identify` instead of a diagnosis")
    chosen = parser.parse_args()
    fit = identified if chosen.identify else diagnosed
    drawn = range(chosen.first, chosen.first + (2 if chosen.quick else chosen.plants))
    made = {seed: list(simulated(seed, chosen.members, fit)) for seed in drawn}
    result = []
    for kind in dict.fromkeys(DRAWS):
        some = [band for seed, each in made.items() if DRAWS[seed % len(DRAWS)] == kind for band in each]
        result += [pooled(f"simulated, {kind}", some, target=False)] if some else []
    everything = [band for each in made.values() for band in each]
    result += [pooled("simulated rigs", everything)] if everything else []
    mujoco = range(chosen.first, chosen.first + chosen.mujoco)
    others = [band for seed in mujoco for band in in_mujoco(seed, chosen.members, fit)]
    result += [pooled("rigs in MuJoCo", others)] if others else []
    under_torques = range(chosen.first, chosen.first + chosen.driven)
    others = [band for seed in under_torques for band in driven(seed, chosen.members, fit)]
    result += [pooled("driven plants", others)] if others else []
    if chosen.real.is_dir() and not chosen.quick:
        of_rigs = {rig.title: list(real(rig, chosen.members, fit)) for rig in rigs(chosen.real)}
        result += [pooled(name, some, target=False) for name, some in of_rigs.items() if some]
        every = [each for some in of_rigs.values() for each in some]
        result.append(pooled("real rigs", [each for each in every if each[1] <= BEYOND]))
        outside = [each for each in every if each[1] > BEYOND]
        result += [pooled("real rigs, beyond the fitted amplitudes", outside, target=False)] if outside else []
    show("predictive bands of ensembles", result, chosen.json)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()

"""True statements in a rig file never make the prediction of held-out recordings worse: random geared plants."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record as screened
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.out_of_sample import held_out_prediction
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import Joints
from dpr_lab.run import Run
from sim_device.plant.config import load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request
from tests.thinned import candidates, thinned

KNOWN = ("geared", "rezeroed", "masses")
DRIVE = {
    "coulomb_joint1.torque_Nm": (5e-4, 1e-2),
    "coulomb_joint2.torque_Nm": (5e-4, 1e-2),
    "load_friction_joint1.friction_radius_m": (1e-5, 5e-4),
    "load_friction_joint2.friction_radius_m": (1e-5, 5e-4),
    "rotor_inertia_joint2.inertia_kgm2": (2e-5, 1e-3),
}
"""Effect and amplitude -> range of its size."""
LIKELY = ("coulomb", "load_friction", "rotor_inertia", "encoder_offset", "stribeck")
ZERO_STD = 0.02
"""Of the zeros of the encoders in each recording, rad."""
WORSE, NOISE, OF_BARE = 1.25, 1e-3, 0.02
"""Factor, rad and share of the bare model's error within which two predictions count as equal: a free run of a chaotic
swing amplifies the noise of the fit.
"""


def plant_runs(seed: int, drive: dict[str, tuple[float, float]], zero_std: float) -> tuple[Rig, list[Run]]:
    """A rig file with weighed masses, and recordings of the plant: drives of random sizes, zeros of each recording."""
    rng = np.random.default_rng([seed, 77])
    base, rig = weighed(load_plant("paper", seed), load_rig("paper"))
    plant = draw_plant(parse_request("single:subtle" if drive and seed % 2 else "clean"), base, rig)
    effects = {name: dict(values) for name, values in plant.effects.items()}
    for key, (least, most) in drive.items():
        effect, amplitude = key.split(".")
        effects[effect] = {amplitude: float(np.exp(rng.uniform(np.log(least), np.log(most))))}
    runs = record(plant.model_copy(update={"effects": effects}), rig, 4.0, 200)
    zeros = np.cumsum(rng.normal(0, zero_std, (len(runs), 2)), axis=1)
    return rig, [
        replace(run, theta=run.theta + np.append(0.0, own), counts=None) for run, own in zip(runs, zeros, strict=True)
    ]


def knowing(weighed_rig: Rig, known: tuple[str, ...]) -> Rig:
    """The rig file that states some of what is true."""
    rig = weighed_rig if "masses" in known else load_rig("paper")
    encoders = rig.encoders.model_copy(update={"rezeroed": "rezeroed" in known})
    return rig.model_copy(update={"encoders": encoders, "joints": Joints(geared=(1, 2) if "geared" in known else ())})


def bare_error(rig: Rig, fitted: list[Run], unseen: list[Run]) -> float:
    """Chi-square of the bare model per reading of the recordings that were not fitted."""
    seen, other = (Recordings(tuple(screened(run, rig) for run in runs), rig) for runs in (fitted, unseen))
    bare = fit_bare_model(seen, nominal_ratios(rig))[2]
    held_out = held_out_prediction(other, bare)
    return float(held_out.chi2(bare).sum() / held_out.dof.sum())


def diagnosed_errors(rig: Rig, fitted: list[Run], unseen: list[Run]) -> tuple[float, float]:
    """Rms of the free runs along the recordings that were not fitted, of the bare model and of the diagnosis, rad."""
    errors = diagnose(fitted, rig, library=candidates(*LIKELY), held_out=unseen).gap.free_run_rad
    bare, diagnosed = (
        float(np.sqrt(np.mean([errors[run.name][model] ** 2 for run in unseen]))) for model in ("before", "after")
    )
    return bare, diagnosed


@pytest.mark.slow
@pytest.mark.parametrize("zero_std", thinned([ZERO_STD, 0.0], 2))
@pytest.mark.parametrize("seed", thinned(range(3), 3))
def test_zeros_of_each_recording_do_not_worsen_the_prediction(seed: int, zero_std: float) -> None:
    rig, runs = plant_runs(seed, {}, zero_std)
    error, without = (bare_error(knowing(rig, known), runs[:1], runs[1:]) for known in (("rezeroed",), ()))
    print(f"seed {seed}: rezeroed {error:.2f}, without {without:.2f}")
    assert error <= 1.1 * without
    assert error < 2.0 or zero_std == 0.0


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("case", thinned(product(range(12), KNOWN), 36), ids=str)
def test_prior_knowledge_of_a_rig_never_worsens_its_prediction(case: tuple[int, str]) -> None:
    seed, left_out = case
    weighed_rig, runs = plant_runs(seed, DRIVE, ZERO_STD)
    runs, fitted = runs[seed % 3 :] + runs[: seed % 3], 1 + seed % 4 // 2
    bare, error = diagnosed_errors(knowing(weighed_rig, KNOWN), runs[:fitted], runs[fitted:])
    known = tuple(name for name in KNOWN if name != left_out)
    _, without = diagnosed_errors(knowing(weighed_rig, known), runs[:fitted], runs[fitted:])
    print(f"seed {seed}: all known {1e3 * error:.2f} mrad, without {left_out} {1e3 * without:.2f} mrad")
    assert error <= WORSE * without + NOISE + OF_BARE * bare

"""Expected recordings of possible releases."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.advice.expected_recordings import MENU, simulated_release
from dpr_lab.gap.advice.recording import DISTINGUISHED, _distance_after_fits
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record


@pytest.mark.slow
@pytest.mark.parametrize("release", [*MENU.values()][1::3], ids=["rods alone", "with a mass"])
def test_the_model_of_a_release_follows_its_own_first_readings(recorded, screened, bare, release):
    """The first segment starts at rest in the pose of the release, with the clamped mass, as its readings."""
    runs = recorded({}, duration=2.0)
    _, base = bare(runs)
    problem, initial = simulated_release(screened(runs), base, release)
    chi2 = problem.chi2_by_segment(problem.predict(problem.with_zeros(base.fit.estimate.changed(initial=initial))))
    assert np.sqrt(chi2[0] / problem.measured[: problem.segments.offsets[1]].size) < 0.1


@pytest.mark.slow
def test_a_class_with_hysteresis_gets_a_bench_check_and_no_release() -> None:
    """A tilt and a zero error are equivalent; derivatives near the reversals of the hysteresis suggest a difference."""
    torques = {"base_tilt": {"tilt_rad": 0.01}, "coulomb_joint2": {"torque_Nm": 0.004}}
    plant, rig = load_plant("paper", 5).model_copy(update={"effects": torques}), load_rig("paper")
    names = ("base_tilt", "encoder_offset_joint1", "hysteresis_joint2")
    diagnosis = diagnose(record(plant, rig, 4.0, 250)[:2], rig, library={name: EFFECTS[name] for name in names})
    assert {"base_tilt", "encoder_offset_joint1"} in [{*effect.members} for effect in diagnosis.effects]
    assert {check.kind for check in diagnosis.checks} == {"measurement"}
    assert diagnosis.advice == [diagnosis.checks[0].sentences]


@pytest.mark.parametrize(
    ("pair", "fits"),
    [
        (("coulomb_joint2", "stribeck_joint2"), {("stribeck_joint2", "coulomb_joint2"): 9.0}),
        (("stribeck_joint2", "coulomb_joint2"), {("stribeck_joint2", "coulomb_joint2"): 9.0}),
        (("base_tilt", "spring_joint1"), {("base_tilt", "spring_joint1"): 9.0, ("spring_joint1", "base_tilt"): 8.0}),
        (("base_tilt", "spring_joint1"), {("base_tilt", "spring_joint1"): 0.5 * DISTINGUISHED}),
    ],
    ids=["simpler first", "richer first", "both directions", "first decides"],
)
def test_a_simpler_form_is_fitted_to_readings_of_the_richer_one(
    pair: tuple[str, str], fits: Mapping[tuple[str, str], float]
) -> None:
    """Any other fit is an error, because `fits` contains only the necessary ones."""

    class Release:
        def distance_after_fit(self, name: str, other: str) -> float:
            return fits[name, other]

    release: Any = Release()
    assert _distance_after_fits(release, *pair) == min(fits.values())

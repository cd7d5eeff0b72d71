"""A curve with many amplitudes is not named instead of the simple effect that it imitates over a small arc."""

import numpy as np
import pytest

from dpr_lab.gap.diagnose import diagnose
from tests.bench_rigs import Rod, bench, one_rod, rod_swing, table
from tests.thinned import candidates

pytestmark = pytest.mark.slow

OFFSETS = ("encoder_offset_joint1", "base_tilt", "com_offset_link1")
"""Indistinguishable on a rod alone, but for its zero."""
LIKELY = candidates("coulomb", "encoder", "detent", "spring", "base_", "com_")


@pytest.mark.long
@pytest.mark.parametrize(("seed", "least"), [(201, 0.6), (202, 0.4)])  # decision 92: an eccentricity fits about as well
def test_a_potentiometer_with_a_zero_error_is_not_called_eccentric(seed, least):
    case = bench("potentiometer", seed)
    diagnosis = diagnose(case.runs, case.rig, held_out=case.held_out, library=LIKELY)
    assert diagnosis.effects[0].name in OFFSETS
    assert diagnosis.effects[0].probability > least
    eccentric = [effect.probability for effect in diagnosis.effects if effect.name == "encoder_eccentricity_joint1"]
    assert all(probability < 0.6 for probability in eccentric)


def test_an_eccentric_encoder_is_still_named_as_one(tmp_path):
    rng = np.random.default_rng(7)
    t, w2 = np.arange(0.0, 5.0, 0.005), 36.0
    rig, runs = one_rod(1.5 * 9.81 / w2, 0.1, 8192, rng), []
    for name, start in (("first", 2.9), ("second", 2.2), ("third", 2.6)):
        angle = rod_swing(Rod(w2, 0.03, 0.0, 0.0), start, t)
        angle = angle + 6e-3 * np.sin(angle + 0.4) + 2e-3 * np.cos(2 * angle) + rng.normal(0.0, 2e-4, len(t))
        runs.append(table(tmp_path, name, rig, {"t_s": t, "theta1_rad": angle}))
    diagnosis = diagnose(runs[:2], rig, held_out=runs[2:], library=LIKELY)
    assert diagnosis.effects[0].name == "encoder_eccentricity_joint1"
    assert diagnosis.effects[0].probability > 0.8


@pytest.mark.long
def test_cogging_that_follows_small_unknown_causes_does_not_replace_a_zero_error():
    case = bench("classroom", 404)
    diagnosis = diagnose(case.runs, case.rig, held_out=case.held_out, library=LIKELY)
    assert any(name in OFFSETS for name in diagnosis.model_effects)
    assert not {"detent_joint1", "spring_joint1", "encoder_eccentricity_joint1"} & diagnosis.model_effects.keys()

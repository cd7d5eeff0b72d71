"""Short recordings of one rod, of which another one is held out: what they share, and what they do not."""

import numpy as np
import pytest

from dpr_lab.gap.diagnose import diagnose
from tests.bench_rigs import Rod, one_rod, rod_swing, table
from tests.thinned import candidates

pytestmark = pytest.mark.slow

W2 = 21.4
"""Square of the natural frequency of a uniform rod of 0.69 m, 1/s^2."""
ROUNDED_RAD = np.radians(0.1)
"""The logger prints one decimal of a degree."""
LIKELY = candidates("air_drag", "friction_drift", "coulomb", "stribeck", "encoder", "base_")


@pytest.fixture
def rig():
    return one_rod(1.5 * 9.81 / W2, 0.115, 4000, np.random.default_rng(1))


@pytest.fixture
def recorded(tmp_path, rig):
    def swing(name, start_deg, seconds, w2=W2, offset=-8e-4, seed=3):
        t, rng = np.arange(0.0, seconds, 0.02), np.random.default_rng(seed)
        angle = rod_swing(Rod(w2, 0.04, 0.0, 9e-3), np.radians(start_deg), t)
        angle = ROUNDED_RAD * np.rint((angle + offset + rng.normal(0.0, 1e-4, len(t))) / ROUNDED_RAD)
        return table(tmp_path, name, rig, {"t_s": t, "theta1_rad": angle})

    return swing


@pytest.mark.long
def test_air_drag_is_named_and_not_a_friction_that_drifts(rig, recorded):
    large, small = recorded("large", 68.0, 10.0), recorded("small", 40.0, 7.0)
    diagnosis = diagnose(large, rig, held_out=small, library=LIKELY)
    assert "air_drag_both" in [effect.name for effect in diagnosis.effects]
    assert "friction_drift_joint1" not in diagnosis.model_effects


def test_a_gap_of_the_held_out_recording_alone_is_no_absence_of_a_gap(rig, recorded):
    diagnosis = diagnose(recorded("small", 12.0, 5.0, offset=0.0), rig, held_out=recorded("large", 68.0, 10.0))
    assert diagnosis.verdict == "unexplained"
    assert "held-out recordings show" in diagnosis.sentence


def test_a_rod_that_was_exchanged_between_the_recordings_is_recognised(rig, recorded):
    before, after = recorded("before", 68.0, 10.0), recorded("after", 40.0, 9.0, w2=1.38 * W2)
    diagnosis = diagnose(before, rig, held_out=after, library=LIKELY)
    assert diagnosis.verdict == "unexplained"
    assert any("differ in e1/a" in note and "If the rig was changed" in note for note in diagnosis.notes)


def test_the_cause_of_a_gap_in_twenty_readings_is_proposed_without_certainty(tmp_path, rig):
    t, rng = np.arange(0.0, 2.4, 0.12), np.random.default_rng(3)
    angle = rod_swing(Rod(W2, 0.04, 2.0, 0.0), np.radians(60.0), t) + rng.normal(0.0, 8e-3, len(t))
    diagnosis = diagnose(table(tmp_path, "coarse", rig, {"t_s": t, "theta1_rad": angle}), rig, library=LIKELY)
    [friction] = diagnosis.effects
    assert "coulomb_joint1" in friction.members
    assert friction.probability < 0.9

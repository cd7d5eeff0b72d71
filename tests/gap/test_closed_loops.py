"""Diagnosis of rods under PD control on encoder counts, with rough torques, simulated by SciPy."""

import pytest

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig
from tests.closed_loop import ClosedLoop
from tests.thinned import candidates, thinned

CASES = {
    "backlash_joint2, 20 mrad": ClosedLoop(play=20e-3),
    "coulomb_joint2": ClosedLoop(friction=(0.0, 3e-3)),
    "coulomb_joint1": ClosedLoop(friction=(5e-3, 0.0)),
    "backlash_joint2, 15 mrad": ClosedLoop(play=15e-3),
    "torque_scale_joint1": ClosedLoop(gain=(1.08, 1.0)),
    "backlash_joint2, 5 mrad": ClosedLoop(play=5e-3),
    "torque_scale_joint2": ClosedLoop(gain=(1.0, 1.08)),
}
"""Cause -> the loop."""
DURATION_S = 3.0
LIKELY = ("backlash", "coulomb", "torque_", "latency", "hysteresis", "encoder_offset")


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("case", thinned([(cause, seed) for cause in CASES for seed in (0, 1)], 16))
def test_a_cause_in_a_closed_loop_is_named(paper: Rig, case: tuple[str, int]) -> None:
    cause, seed = case
    diagnosis = diagnose(CASES[cause].runs(paper, seed, duration=DURATION_S), paper, library=candidates(*LIKELY))
    assert diagnosis.verdict in ("named", "partly_explained")
    assert cause.split(",")[0] in diagnosis.effects[0].members
    assert any("Noise of the measured torques" in sentence for sentence in diagnosis.assumptions)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_closed_loop_without_a_cause_has_no_gap(paper: Rig) -> None:
    diagnosis = diagnose(ClosedLoop().runs(paper, 1, duration=DURATION_S), paper, library=candidates(*LIKELY))
    assert (diagnosis.verdict, diagnosis.model_effects) == ("no_gap", {})

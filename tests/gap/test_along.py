"""Torques along a known swing against the whole rig's own equations."""

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, effect_vector, place
from dpr_lab.gap.along import arm_torques
from dpr_lab.gap.base_fit import fit_base, nominal_rods
from dpr_lab.gap.problem import Point, problem
from dpr_lab.gap.record import record
from dpr_lab.gap.response import course
from dpr_lab.gap.scan import shapes
from dpr_lab.rig import Rig

WHOLE_S = 2.0  # no start state but that of the release, so that the arm's past is the model's
COUPLING = 1e-4  # small enough to be linear


@pytest.mark.parametrize("frequency", [4.0, 12.0])
def test_a_compliant_arm_answers_as_the_whole_rig_does(recorded, paper: Rig, frequency: float):
    made, starts = problem([record(run, paper) for run in recorded({}, duration=WHOLE_S)], paper, 2 * WHOLE_S)
    arm = {"coupling_per_kg": COUPLING, "frequency_hz": frequency, "damping_ratio": 0.05}
    held, loose = (
        Point(nominal_rods(paper), effect_vector({"arm_compliance": a} if a else {}), starts) for a in ({}, arm)
    )
    whole = made.predict(loose)[0] - made.predict(held)[0]
    along = course(made, held)
    linear = along.readings(arm_torques(made, along, loose.vector[None]))[:, :, 0]
    assert len(made.run) == 3
    assert np.abs(linear - whole).max() < 0.05 * np.abs(whole).max()


def test_the_scan_finds_the_arms_frequency_between_the_points_of_its_grid(recorded, paper: Rig):
    truth = {"arm_compliance": {"coupling_per_kg": 0.06, "frequency_hz": 7.2, "damping_ratio": 0.08}}
    made, base = fit_base([record(run, paper) for run in recorded(truth)], paper, nominal_rods(paper))
    best = dict(shapes(EFFECTS["arm_compliance"], made, base.fit, course(made, base.fit.point))[0])
    assert best[place("arm_compliance", "frequency_hz")] == pytest.approx(7.2, rel=0.1)

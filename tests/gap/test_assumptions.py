"""Assumptions of a diagnosis of one rod, whose ratios refer to a."""

from types import SimpleNamespace as Fake
from typing import Any

import numpy as np

from dpr_lab.gap.conclusion.assumptions import assumptions
from dpr_lab.identification.scaling.scale import Scale


def test_the_assumptions_of_a_single_rod_refer_to_a() -> None:
    rig = Fake(rig=Fake(L1_std=None), L1=0.4, g=9.81, joints=Fake(geared=()))
    problem = Fake(segments=Fake(setups=[Fake(torques=None, added=(), arm=None)]), disturbance=None)
    recordings = Fake(
        rig=rig, records=[Fake(encoder0_moves=False)], arm_moves=False, torques_earlier=0.0, exact_torques=False
    )
    chosen = Fake(estimate=Fake(zeros=np.zeros((0, 2))), effects=())
    state: Any = Fake(
        fitted=Fake(division="", problem=problem, recordings=recordings),
        selection=Fake(
            chosen=chosen, expected=(), misleading=(), absorbed={"rotor_inertia_joint1": {"inertia_kgm2": "e1/b"}}
        ),
        intervals={},
    )
    scale = Scale(b=0.01, interval90=(0.008, 0.03), fixed_by="bound", inertia="a")
    text = " ".join(assumptions(state, {"rotor_inertia_joint1": {"inertia_kgm2": None}}, scale))
    assert "A release with a known added mass fixes a." in text
    assert "rotor_inertia_joint1 is indistinguishable from e1/a." in text
    assert "/b" not in text
    assert "sizes from which effects are excluded, hold only at these values" in text

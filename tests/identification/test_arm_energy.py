"""Recordings of an arm that is described as free but receives energy."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dpr_lab.identification.misread.energy import undescribed_drive
from dpr_lab.identification.moving_arm import doubts
from dpr_lab.identification.moving_arm.problem import recordings_of
from tests.identification.test_moving_arm_fit import PUSH, drawn, recorded, rig_with


def swing(rods: str, size: float):
    rng, driven = np.random.default_rng(4), rig_with("driven", "torque", rods)
    Z, arm, start = drawn(rng, driven)
    run = recorded(driven, Z, arm, start, size * PUSH, size * PUSH, rng)
    return replace(run, arm_mode="free", arm_input=None), rig_with("free", None, rods)


@pytest.mark.parametrize("rods", ["inner", "both"])
def test_only_a_motor_that_is_on_gives_energy_to_a_free_arm(rods: str):
    passive, rig = swing(rods, 0.0)
    pushed, _ = swing(rods, 3.0)
    assert not undescribed_drive([passive], rig)
    assert "its motor was on" in undescribed_drive([pushed], rig)
    assert not undescribed_drive([replace(pushed, arm_mode="driven", arm_input=PUSH)], rig)


def test_such_a_fit_is_not_reliable(monkeypatch: pytest.MonkeyPatch):
    run, rig = swing("inner", 3.0)
    recordings = recordings_of([run], rig)
    monkeypatch.setattr(doubts, "_wrong_angles", lambda recordings, rig, others: "")
    (sentence,) = doubts.failures(cast(Any, SimpleNamespace(misfit=100.0)), recordings, rig)
    assert "rises by" in sentence

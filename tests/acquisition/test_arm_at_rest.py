"""A movable arm must be at rest and inside its limits before the rods are released."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from dpr_lab.acquisition.capture import CaptureOptions, capture
from dpr_lab.acquisition.rest import arm_restless
from dpr_lab.acquisition.settings import RestLimits
from dpr_lab.errors import SafetyStop
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.reader import load_run


def furuta_with(**arm: object) -> Rig:
    table = load_rig("furuta").model_dump(exclude_none=True)
    return Rig.model_validate(table | {"arm": table["arm"] | arm})


def test_an_arm_that_drifts_or_stands_outside_forbids_a_release() -> None:
    t = np.linspace(0, 1, 101)
    theta = np.tile([0.3, 2.0, 2.0], (101, 1))
    limits, rig = RestLimits(), furuta_with(limits=(-1.0, 1.0))
    assert arm_restless(t, theta, rig, limits) == ""
    outside = theta + np.array([1.0, 0.0, 0.0])
    assert "outside its limits of -1 to 1 rad" in arm_restless(t, outside, rig, limits)
    drifting = theta + np.outer(t, [0.1, 0.0, 0.0])
    assert "the arm still moved: drifting 0.100 rad/s" in arm_restless(t, drifting, rig, limits)
    assert arm_restless(t, drifting, load_rig("paper"), limits) == ""  # a clamped arm


@pytest.mark.slow
def test_rods_are_not_released_while_the_arm_stands_outside_its_limits(tmp_path: Path, bench, agree) -> None:
    options = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=2.0)
    rig = furuta_with(limits=(0.5, 1.0))
    with bench(rig="furuta", plant="furuta") as (device, spy):
        with pytest.raises(SafetyStop, match=r"the arm stands at .* outside its limits of 0.5 to 1 rad"):
            capture(device, rig, "X1", options, tmp_path, confirm=agree)
        assert max(spy.sent) <= 39


@pytest.mark.slow
def test_a_motor_that_drives_an_arm_described_as_free_is_named(tmp_path: Path, bench, agree) -> None:
    options = CaptureOptions(duration=1.0, pose_timeout=60.0, rest_timeout=60.0)
    with bench(rig="furuta", plant="furuta") as (device, _):
        free = capture(device, furuta_with(mode="free"), "X1", options, tmp_path, confirm=agree)
        driven = capture(device, load_rig("furuta"), "X1", options, tmp_path, confirm=agree)
    assert any("record with --arm driven" in note for note in free.quality.notes)
    assert any("record with --arm driven" in note for note in load_run(free.run_file).notes)
    assert not any("--arm driven" in note for note in driven.quality.notes)


def test_limits_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValidationError, match="limits are reversed or equal: 1, -1"):
        furuta_with(limits=(1.0, -1.0))

"""A model with effects follows a driven recording in every segment, although the model without them is far off."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.identification.compare import compare_run
from dpr_lab.rig import load_rig
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import identified_model

pytest.importorskip("mujoco")
from tests.exports.planted_errors import ROBOT, STARTS, recordings

DRIVEN = ROBOT.replace(
    "</mujoco>", '<actuator><motor joint="shoulder" gear="10"/><motor joint="elbow" gear="5"/></actuator></mujoco>'
)
TRUE_GEAR = 12.5


@pytest.mark.slow
def test_a_fast_segment_is_followed_from_the_end_of_the_one_before(tmp_path: Path) -> None:
    """With a torque 20 % too small, the rods of a segment at 15 rad/s end elsewhere: its own start is too imprecise."""
    (tmp_path / "robot.xml").write_text(DRIVEN, encoding="utf-8")
    rig_from_model(tmp_path / "robot.xml", tmp_path / "rig.toml")
    rig = load_rig(tmp_path / "rig.toml")
    truth = DRIVEN.replace('gear="10"', f'gear="{TRUE_GEAR}"')
    _, run = recordings(truth, rig, gears=(10.0, 5.0), starts=STARTS[:2])
    for excess in (0.2502, 0.2497, 0.24999):
        model = identified_model(rig, {"torque_scale_joint1": {"excess": excess}})
        errors = compare_run(run, rig, model).segment_rms_rad
        assert np.all(errors < 1e-3), f"{excess}: {errors} rad"

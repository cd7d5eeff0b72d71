"""Effects that a format cannot contain, refitted without the amplitudes that it lacks."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.exports.into import WORDS
from dpr_lab.exports.refit import fitted_in_words, unchanged
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.rig import load_rig
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import base_of
from tests.exports.test_export_command import whole_model
from tests.thinned import covered

pytest.importorskip("mujoco")
from tests.exports.planted_errors import ROBOT, SHOULDER, recordings


@pytest.mark.slow
@pytest.mark.parametrize(
    ("further", "cubic"),
    covered(({"stribeck_joint2": {"coulomb_Nm": 1e-3, "extra_Nm": 1e-3, "speed_rad_s": 0.3}}, {}), (-3e-4, 0.0)),
)
def test_a_spring_with_a_cubic_term_becomes_a_linear_one(
    tmp_path: Path, cubic: float, further: dict[str, dict[str, float]]
) -> None:
    """Left out as a whole, the spring would be compensated by impossible inertias."""
    (tmp_path / "robot.xml").write_text(ROBOT, encoding="utf-8")
    rig_from_model(tmp_path / "robot.xml", tmp_path / "rig.toml")
    rig = load_rig(tmp_path / "rig.toml")
    runs = recordings(ROBOT.replace(SHOULDER, SHOULDER + ' stiffness="0.08"'), rig, 3.0)
    model = whole_model(rig, Estimate.of(unknown_ratios(base_of(rig)), effect_params({}), np.zeros((1, 4))))
    spring = {"stiffness_Nm_per_rad": 0.084, "cubic_Nm_per_rad3": cubic, "constant_Nm": 0.0}
    model = model.model_copy(update={"effects": {"spring_joint1": spring, **further}})
    fitted = fitted_in_words(model, WORDS["SDFormat"], runs, rig)
    stiffness = fitted.effects["spring_joint1"]["stiffness_Nm_per_rad"]
    simplified = {"spring_joint1"} if cubic else set[str]()
    assert unchanged(model, fitted) == set(fitted.effects) - simplified
    assert fitted.effects["spring_joint1"] == spring | {"stiffness_Nm_per_rad": stiffness, "cubic_Nm_per_rad3": 0.0}
    if cubic or further:
        assert stiffness == pytest.approx(0.08, rel=0.02)
    else:
        assert fitted is model

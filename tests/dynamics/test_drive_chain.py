"""The effects of the arm's drive act in sequence, and the gain comes first."""

import pytest

from dpr_lab.dynamics.step import motion_of
from dpr_lab.effects import effect_params
from dpr_lab.effects.effect_kernels import active_effects, arm_drives

STILL = motion_of(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@pytest.mark.parametrize(
    ("effects", "torque"),
    [
        ({"dead_zone_joint0": {"width_Nm": 0.1}}, 0.06),
        ({"saturation_joint0": {"share": 1.0, "limit_Nm": 0.1}}, 0.1),
        ({"dead_zone_joint0": {"width_Nm": 0.02}, "saturation_joint0": {"share": 1.0, "limit_Nm": 0.15}}, 0.14),
        ({"torque_scale_joint0": {"excess": 0.5}}, 0.24),
    ],
)
def test_they_act_on_the_torque_of_the_fitted_gain(effects, torque):
    params = effect_params({"drive_gain": {"excess": 1.0}, **effects})
    assert arm_drives(STILL, 0.08, params, active_effects(params)) == pytest.approx(torque)

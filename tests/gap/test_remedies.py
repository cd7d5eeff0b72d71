import math

import numpy as np
import pytest

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.gap.conclusion.at_rest import at_rest, held_angles
from dpr_lab.gap.conclusion.causes import of_camera, remedies
from dpr_lab.gap.result.causes import NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap.tables import causes
from dpr_lab.rig import Rig
from dpr_lab.setup import BOTH, Setup


@pytest.fixture
def named():
    def made(name: str, *twins: str, probability: float = 0.9) -> NamedEffect:
        result = {"name": name, "class": [name, *twins], "probability": probability, "parameters": {}, "share": 0.5}
        return NamedEffect.model_validate(result)

    return made


def test_a_wrong_setting_is_reported_with_its_right_value(named, paper: Rig):
    effects = [named("encoder_scale_joint2", "spring_joint2"), named("coulomb_joint1")]
    effects += [named("base_tilt", probability=0.09), named("detent_joint1", probability=0.49)]
    sizes = {"encoder_scale_joint2": {"excess": 1.7e-3}, "base_tilt": {"tilt_rad": 1e-3}}

    scale, simulate = remedies(effects, sizes, rig_constants(paper))

    assert "set counts_per_rev of joint 2 in the rig file to 16412 (now 16384)" in scale
    assert "first rule out spring_joint2" in scale
    assert "Add coulomb_joint1 to the simulator: model.json in the folder of this diagnosis" in simulate

    small = remedies(effects, sizes | {"encoder_scale_joint2": {"excess": 2e-5}}, rig_constants(paper))[0]
    assert "the rig file needs no correction: the error is less than half a count per turn of joint 2" in small


def test_the_table_of_causes_names_no_member_of_negligible_probability(named) -> None:
    effect = named("spring_joint1", "encoder_scale_joint1")
    rare = effect.model_copy(update={"odds": {"spring_joint1": 1.0, "encoder_scale_joint1": 5e-10}})
    for of_class, words in ((effect, 2), (rare, 1)):
        (stated,) = causes(Diagnosis.model_construct(effects=[of_class]))
        assert len(stated.split(" or ")) == words


def test_in_a_film_a_base_tilt_may_be_a_turned_camera(named):
    (warning,), (check,) = of_camera([named("coulomb_joint1"), named("base_tilt", probability=0.98)])
    assert "camera rotated about its optical axis has the same signature as base_tilt" in warning
    assert "plumb line" in check
    assert of_camera([named("coulomb_joint1")]) == ([], [])


def test_in_a_film_a_drift_of_an_encoder_may_be_a_camera_that_is_not_fixed(named):
    (warning,), (check,) = of_camera([named("encoder_drift_joint1"), named("coulomb_joint1")])
    assert "camera that is not fixed has the same signature as encoder_drift_joint1: check the camera first" in warning
    assert "mark" in check
    warnings, _ = of_camera([named("base_tilt", "encoder_offset_joint1"), named("encoder_drift_joint2")])
    assert len(warnings) == 2


@pytest.mark.parametrize(("excess", "usual"), [(-0.0242, True), (-0.05, False), (0.0012, False)])
def test_a_usual_resolution_near_the_fitted_one_is_named(named, paper: Rig, excess: float, usual: bool):
    rig = rig_constants(paper)._replace(counts_per_rev1=4096.0)
    (sentence,) = remedies([named("encoder_scale_joint1")], {"encoder_scale_joint1": {"excess": excess}}, rig)
    assert ("an encoder of 1000 lines, with four counts per line, has 4000" in sentence) is usual
    assert ("another cause is probable" in sentence) is (excess == -0.05)


@pytest.mark.parametrize(
    ("setup", "friction", "gravity"),
    [
        (BOTH, 0.011, 2.0),  # the inner rod also carries the reaction of joint 2
        (Setup("inner"), 0.01, 2.0 - 0.05 * 9.81 / 0.5),
        (Setup("clamped"), 0.01, 2.0 + 0.03 * 9.81 / 0.5),
        (Setup("clamped", elbow=math.pi), 0.01, 2.0 - 0.03 * 9.81 / 0.5),
    ],
)
def test_a_zero_read_at_rest_is_uncertain_by_friction_over_gravity(
    named, paper: Rig, setup: Setup, friction: float, gravity: float
):
    rig = rig_constants(paper)._replace(L1=0.5, g=9.81)
    whole = np.array([0.2, 0.02, 0.03, 2.0, 1e-3, 1e-4, 0.05])
    effects = [named("encoder_offset_joint1", "base_tilt"), named("stribeck_joint1"), named("coulomb_joint2")]
    sizes = {"encoder_offset_joint1": {"offset_rad": -6e-3}, "coulomb_joint2": {"torque_Nm": 1e-3}}
    sizes |= {"stribeck_joint1": {"torque_Nm": 8e-3, "extra_at_rest_Nm": 2e-3, "speed_rad_per_s": 0.1}}
    held = held_angles(list(sizes), whole, sizes, [setup], rig)
    assert held[0] == pytest.approx(friction / gravity, rel=1e-3)
    zero, _ = remedies(effects, sizes, rig, held)
    assert f"can hold the inner rod up to {1e3 * held[0]:.2g} mrad from its equilibrium: let it come to rest" in zero
    assert "from both sides and use the mean of the two readings." in at_rest("base_tilt", held)
    assert at_rest("coulomb_joint2", held) == ""
    assert at_rest("base_tilt", held_angles([], whole, sizes, [setup], rig)) == ""

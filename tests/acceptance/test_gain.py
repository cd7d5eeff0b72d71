"""Limits of the gain of a drive whose constants are measured."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.acceptance.gain import with_gain
from dpr_lab.acceptance.judge import judge
from dpr_lab.acceptance.limits import Limits
from dpr_lab.gap.result.evidence import Evidence, Exclusion, WiderModel
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from tests.a_diagnosis import made

KT = {"nominal": 0.05, "measured": 0.05, "std": 1e-3}


def rig_with(**motor: object) -> Rig:
    table = load_rig("driven_double").model_dump(exclude_none=True)
    return Rig.model_validate(table | {"motor": motor})


@pytest.mark.parametrize(
    ("motor", "quantity", "gain"),
    [({"input": "current", "kt": KT}, "kt/b", 0.05), ({"input": "torque"}, "1/b", 1.0)],
)
@pytest.mark.parametrize(("other_b", "answer"), [((0.95, 1.05), "pass"), ((0.5, 1.05), "not decidable")])
def test_a_limit_of_a_known_gain_follows_from_the_interval_of_b(
    motor: dict[str, object], quantity: str, gain: float, other_b: tuple[float, float], answer: str
) -> None:
    """A model with a further effect that is not excluded may widen the interval of b."""
    rig, t = rig_with(**motor), np.arange(3.0)
    run = replace(Run("a", t, np.zeros((3, 3)), None, None, rig.name, rig.sha256, 1.0), arm_mode="driven")
    wider = WiderModel(effects=["base_tilt"], intervals90={"b": other_b})
    diagnosis = made(effects=[], verdict="no_gap").model_copy(
        update={
            "scale": Scale(b=1.0, interval90=(0.9, 1.1), fixed_by="data"),
            "evidence": Evidence.model_construct(exclusions=[], friction={}, wider_models=[wider]),
        }
    )
    bounds = {"min": gain / 1.2, "max": gain / 0.8, "unit": {"kt/b": "1/(s^2 A)", "1/b": "1/(kg m^2)"}[quantity]}
    limits = Limits.model_validate({"ratios": {quantity: bounds}})
    (limit,) = judge(with_gain(diagnosis, [run], rig), limits).limits
    assert limit.answer == answer
    if answer == "pass":
        assert limit.interval90 == pytest.approx((gain / 1.1, gain / 0.9))
    assert judge(with_gain(diagnosis, [replace(run, arm_mode="free")], rig), limits).answer == "not decidable"


def test_a_gain_that_may_contain_an_error_is_not_computed_from_its_constants() -> None:
    """With measured rods, `torque_scale_joint0` is an effect, and a known mass determines b."""
    table = rig_with(input="current", kt=KT).model_dump(exclude_none=True)
    for name in ("m2", "l2", "J2"):
        nominal = table["parameters"][name]["nominal"]
        table["parameters"][name] = {"nominal": nominal, "measured": nominal, "std": 1e-3 * nominal}
    rig, t = Rig.model_validate(table), np.arange(3.0)
    run = replace(Run("a", t, np.zeros((3, 3)), None, None, rig.name, rig.sha256, 1.0), arm_mode="driven")
    scale = Scale(b=1.0, interval90=(0.99, 1.01), fixed_by="data")
    diagnosis = made(effects=[], verdict="named").model_copy(
        update={"scale": scale, "model_effects": {"torque_scale_joint0": {"excess": 0.2}}}
    )
    assert with_gain(diagnosis, [run], rig) is diagnosis


def test_an_undecided_gain_of_measured_rods_and_drive_names_the_effect_to_limit() -> None:
    limits = Limits.model_validate({"ratios": {"kt/b": {"max": 1.0, "unit": "1/(s^2 A)"}}})
    tested = Exclusion(effect="torque_scale_joint0", parameter="excess", size=0.1, estimate=0.0, confidence=0.99)
    for exclusions, advice in (([tested], True), ([], False)):
        evidence = Evidence.model_construct(exclusions=exclusions, friction={}, wider_models=[])
        diagnosis = made(effects=[], verdict="no_gap").model_copy(update={"evidence": evidence})
        (limit,) = judge(diagnosis, limits).limits
        assert limit.answer == "not decidable"
        assert limit.reason.endswith("limit torque_scale_joint0 instead") == advice

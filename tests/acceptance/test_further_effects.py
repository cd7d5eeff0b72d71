"""Limits of ratios and named effects where further effects are not excluded."""

from collections.abc import Callable
from typing import Any

import pytest

from dpr_lab.acceptance.judge import judge
from dpr_lab.acceptance.limits import Limits
from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.evidence import Evidence, Exclusion, WiderModel
from dpr_lab.rig import Rig
from sim_device.plant.config import load_plant
from tests.a_diagnosis import CLOCK, interval, made

CLOCK_LIMIT = {"effects": {CLOCK: {"excess": {"max": 0.0055, "unit": "1"}}}}
FRICTION_LIMIT = {"effects": {"coulomb_joint1": {"torque_Nm": {"max": 1e-3, "unit": "N m"}}}}
RATIO_LIMIT = {"ratios": {"c1/b": {"max": 1.05, "unit": "1/s"}}}


@pytest.mark.parametrize(
    ("probability", "words"),
    [
        (0.12, "air_drag_both is present (probability 12 %)"),
        (None, "common effects of undetectable sizes are present (air_drag_both)"),
    ],
)
@pytest.mark.parametrize(
    ("quantity", "limits", "upper"), [(f"{CLOCK}.excess", CLOCK_LIMIT, 0.006), ("c1/b", RATIO_LIMIT, 1.1)]
)
def test_a_limit_passes_only_if_effects_that_are_not_excluded_do_not_violate_it(
    probability: float | None, words: str, quantity: str, limits: dict[str, Any], upper: float
) -> None:
    """A missing Coulomb friction or air drag changes the viscous friction, and the sizes of named effects."""
    further = WiderModel(
        effects=["air_drag_both"], probability=probability, intervals90={quantity: (upper - 0.001, upper)}
    )
    answers = []
    for models in ([], [further]):
        evidence = Evidence.model_construct(exclusions=[], wider_models=models)
        result = made(determined={"c1/b": interval(1.0)}, evidence=None).model_copy(update={"evidence": evidence})
        answers += judge(result, Limits.model_validate(limits)).limits
    assert [limit.answer for limit in answers] == ["pass", "not decidable"]
    assert answers[1].interval90 is not None
    assert answers[1].interval90[1] == pytest.approx(upper)
    assert words in answers[1].reason


@pytest.mark.parametrize(
    ("limits", "effects", "reason"),
    [
        (CLOCK_LIMIT, ["air_drag_both", "base_tilt"], "air_drag_both and base_tilt together are indistinguishable"),
        (
            RATIO_LIMIT,
            ["base_tilt"],
            "base_tilt is indistinguishable from the fitted values: the interval is valid only without them",
        ),
        (FRICTION_LIMIT, ["base_tilt"], ""),
    ],
)
def test_no_fitted_value_passes_if_common_effects_are_indistinguishable_from_it(
    limits: Any, effects: list[str], reason: str
) -> None:
    absent = Exclusion(
        effect="coulomb_joint1", parameter="torque_Nm", size=1e-5, estimate=0, confidence=1, interval90=(-1e-6, 1e-6)
    )
    further = WiderModel(effects=effects, intervals90={})
    evidence = Evidence.model_construct(exclusions=[absent], wider_models=[further])
    result = made(determined={"c1/b": interval(1.0)}, evidence=None).model_copy(update={"evidence": evidence})
    (limit,) = judge(result, Limits.model_validate(limits)).limits
    assert limit.answer == ("not decidable" if reason else "pass")
    assert limit.reason.startswith(reason)


@pytest.mark.slow
def test_a_friction_that_is_not_named_is_part_of_the_interval_of_the_viscous_friction(
    recorded: Callable[..., list], paper: Rig
) -> None:
    result = diagnose(recorded({"coulomb_joint1": {"torque_Nm": 4e-5}}), paper)
    true = dict(zip(RATIOS, ratios(base_parameters(load_plant("paper").Z, paper.L1, paper.g)), strict=True))["c1/b"]
    assert result.evidence is not None
    (low, _), models = result.ratios["c1/b"].interval90, result.evidence.wider_models
    assert result.verdict == "no_gap"
    assert "coulomb_joint1" in models[-1].effects
    least = 1.0005 * true
    assert low > least, "the interval without friction passes"
    for limit, expected in ((least, "not decidable"), (0.98 * true, "pass")):
        limits = Limits.model_validate({"ratios": {"c1/b": {"min": limit, "unit": "1/s"}}})
        assert judge(result, limits).answer == expected

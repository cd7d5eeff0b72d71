"""Note on a probable cause whose interval contains zero."""

from types import SimpleNamespace as Fake
from typing import Any

from dpr_lab.effects import effect_params
from dpr_lab.gap.conclusion.notes import notes

NAME, SIZE = "encoder_offset_joint1", "offset_rad"


def noted(half_width: float, probability: float, name: str = NAME, **sizes: float) -> str:
    """Notes on an effect that leaves a remainder, as a rule a zero error of -28 mrad."""
    rig = Fake(joints=Fake(geared=()))
    estimate = Fake(params=effect_params({name: sizes or {SIZE: -0.028}}))
    state: Any = Fake(
        fitted=Fake(recordings=Fake(records=(), rig=rig), held_out=Fake(records=())),
        description=Fake(withholds=False),
        transfer=Fake(withdrawn=(), oversized=(), lone=None),
        selection=Fake(chosen=Fake(estimate=estimate), expected=(), bare=Fake(bounded_excess=1.0), path=()),
        posteriors=(Fake(name=name, probability=probability),),
        gap=Fake(budget=None),
        remainder=Fake(sentence="Unmodelled remainder."),
        intervals=dict.fromkeys([(name, size) for size in sizes or [SIZE]], half_width),
    )
    return " ".join(notes(state, "partly_explained", []))


def test_a_probable_cause_whose_interval_contains_zero_is_noted() -> None:
    assert f"The 90 % interval of the size of {NAME} contains zero" in noted(0.07, 0.9)
    assert "contains zero" not in noted(0.02, 0.9)
    assert "contains zero" not in noted(0.07, 0.4)
    sizes = {"torque_Nm": 1e-3, "extra_at_rest_Nm": 1e-3, "speed_rad_per_s": 0.3}
    assert "of stribeck_joint1 contains zero" in noted(0.01, 0.9, "stribeck_joint1", **sizes)
    assert f"of {NAME} contains zero" in noted(0.0, 0.9, offset_rad=0.0)

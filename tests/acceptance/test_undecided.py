"""Reasons of undecided limits, and the releases that decide them."""

from types import SimpleNamespace
from typing import Any

from dpr_lab.acceptance.judge import Acceptance, JudgedLimit, judge
from dpr_lab.acceptance.limits import Limits
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence, JointFriction
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.workflows.accept import with_recordings
from tests.a_diagnosis import made


def friction(size: float) -> Limits:
    return Limits.model_validate({"friction": {"joint1": {"max": size, "speed_rad_s": 3.0, "unit": "N m"}}})


def with_friction(std_Nm: list[float], scale90: tuple[float, float] = (1.0, 1.0)) -> Diagnosis:
    """Return a diagnosis without a gap, whose friction torque has the given standard deviations."""
    curve = JointFriction(
        speed_rad_per_s=[-3.0, -0.1, 0.1, 3.0],
        torque_Nm=[-2e-3, -1e-3, 1e-3, 2e-3],
        std_Nm=std_Nm,
        coefficients=2,
    )
    evidence = Evidence.model_construct(friction={"joint1": curve}, exclusions=[], wider_models=[])
    scale = Scale(b=1.0, interval90=scale90, fixed_by="bound")
    return made(verdict="no_gap", effects=[], probabilities={}).model_copy(
        update={"evidence": evidence, "scale": scale, "hints": []}
    )


def test_an_undecided_friction_limit_states_the_inaccurate_speeds_and_their_cause() -> None:
    (slow,) = judge(with_friction([1e-5, 5e-3, 5e-3, 1e-5]), friction(4e-3)).limits
    assert "5 mN m from 0.1 to 0.1 rad/s, but 0.01 mN m at 3 rad/s: the friction at rest" in slow.reason
    (fast,) = judge(with_friction([5e-3, 1e-5, 1e-5, 5e-3]), friction(4e-3)).limits
    assert "a faster swing helps" in fast.reason
    (even,) = judge(with_friction([3e-3] * 4), friction(4e-3)).limits
    assert even.reason == "the limit lies within the interval: record more releases"


def test_a_limit_that_only_the_scale_leaves_open_asks_for_no_releases() -> None:
    (limit,) = judge(with_friction([1e-5] * 4, (0.5, 3.0)), friction(4e-3)).limits
    assert limit.answer == "not decidable"
    assert limit.reason.startswith("only the uncertainty of b (0.5 to 3 kg m^2) leaves this open")
    plan: Any = SimpleNamespace(
        limits=[SimpleNamespace(quantity=limit.quantity, decides=True, all_shapes=False, release=1)],
        releases=[SimpleNamespace(text="P1")],
    )
    assert with_recordings(Acceptance("not decidable", "", (limit,)), plan).would_decide == ()


def test_a_limit_that_no_planned_release_decides_states_it_instead_of_advising_more_releases() -> None:
    reason = "the limit lies within the interval: record more releases"
    limits = [
        JudgedLimit(name, "N m", -1.0, 1.0, (0.0, 2.0), "not decidable", reason) for name in ("far", "near", "shapes")
    ]
    forecasts = [
        SimpleNamespace(quantity="far", decides=False, all_shapes=False, release=None),
        SimpleNamespace(quantity="near", decides=True, all_shapes=False, release=2),
        SimpleNamespace(quantity="shapes", decides=False, all_shapes=True, release=None),
    ]
    plan: Any = SimpleNamespace(limits=forecasts, releases=[SimpleNamespace(text="P1"), SimpleNamespace(text="P2")])
    acceptance = with_recordings(Acceptance("not decidable", "", tuple(limits)), plan)
    far, near, shapes = acceptance.limits
    assert far.reason == "the limit lies within the interval, and 2 further releases would probably not decide it"
    assert shapes.reason == reason
    assert near.reason == "the limit lies within the interval: release 2 alone is expected to decide it"
    assert (acceptance.would_decide, acceptance.recordings) == (("near",), ("P1", "P2"))

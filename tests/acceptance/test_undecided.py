"""Reasons of undecided limits, and the releases that decide them."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from dpr_lab.acceptance.judge import FIND_CAUSE, Acceptance, JudgedLimit, judge
from dpr_lab.acceptance.limits import Limits
from dpr_lab.acceptance.reason import Obstacle, Reason, within
from dpr_lab.dynamics.base import RATIO_UNITS
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.causes import EffectSize
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Budget, Evidence, JointFriction, RunBudget
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.planning.knowledge import known_before
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Inseparable, LimitForecast, Plan
from dpr_lab.planning.worth.objective import limit_forecasts
from dpr_lab.report.tables import limit_forecast_table
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.workflows.accept import with_recordings
from tests.a_diagnosis import made
from tests.one_cause import of_runs, one_cause


def friction(size: float) -> Limits:
    return Limits.model_validate({"friction": {"joint1": {"max": size, "speed_rad_s": 3.0, "unit": "N m"}}})


def with_friction(
    std_Nm: list[float],
    scale90: tuple[float, float] = (1.0, 1.0),
    fixed_by: Literal["data", "bound"] = "bound",
    constants_std: float = 0.0,
) -> Diagnosis:
    """Return a diagnosis without a gap, whose friction torque has the given standard deviations.

    The torque is 1 mN m at 0.1 rad/s and rises to 2 mN m at 3 rad/s.
    """
    speeds = [0.1, 1.0, 3.0] if len(std_Nm) == 3 else [0.1, 3.0]
    curve = JointFriction(
        speed_rad_per_s=[*(-speed for speed in reversed(speeds)), *speeds],
        torque_Nm=[*np.interp(speeds, [0.1, 3.0], [-1e-3, -2e-3])[::-1], *np.interp(speeds, [0.1, 3.0], [1e-3, 2e-3])],
        std_Nm=[*reversed(std_Nm), *std_Nm],
        coefficients=2,
    )
    evidence = Evidence.model_construct(friction={"joint1": curve}, exclusions=[], wider_models=[])
    scale = Scale(b=1.0, interval90=scale90, fixed_by=fixed_by, constants_std=constants_std)
    return made(verdict="no_gap", effects=[], probabilities={}).model_copy(
        update={"evidence": evidence, "scale": scale, "hints": []}
    )


@pytest.mark.parametrize(
    ("std_Nm", "stated", "remedies"),
    [
        ([5e-3, 1e-5], "5 mN m at 0.1 rad/s, but 0.01 mN m at 3 rad/s: the friction at rest", ["ends at rest"]),
        ([1e-5, 5e-3], "5 mN m at 3 rad/s, but 0.01 mN m at 0.1 rad/s: high speeds", ["faster"]),
        ([5e-3, 5e-3, 1e-5], "5 mN m from 0.1 to 1 rad/s, but 0.01 mN m at 3 rad/s", ["ends at rest"]),
        (
            [5e-3, 1e-5, 4e-3],
            "5 mN m at 0.1 rad/s and 4 mN m at 3 rad/s, but 0.01 mN m at 1 rad/s",
            ["ends at rest", "faster"],
        ),
    ],
)
def test_an_undecided_friction_limit_states_the_inaccurate_speeds_and_their_cause(
    std_Nm: list[float], stated: str, remedies: list[str]
) -> None:
    (limit,) = judge(with_friction(std_Nm), friction(4e-3)).limits
    assert f"with a free-form friction curve, the standard deviation of the torque is {stated}" in limit.reason
    assert [remedy for remedy in ("ends at rest", "faster") if remedy in limit.reason] == remedies


def test_speeds_with_an_accurate_torque_are_not_called_inaccurate() -> None:
    """At 3 rad/s the torque may exceed the limit of 1.95 mN m because it is large, not because it is inaccurate."""
    (limit,) = judge(with_friction([5e-3, 1e-4]), friction(1.95e-3)).limits
    assert "5 mN m at 0.1 rad/s, but 0.1 mN m at 3 rad/s" in limit.reason
    (even,) = judge(with_friction([3e-3] * 2), friction(4e-3)).limits
    assert even.reason == "the limit lies within the interval: record more releases"


def undecided(quantity: str, reason: Reason) -> JudgedLimit:
    stated = reason.text, reason.remedy, reason.obstacle, reason.effects
    return JudgedLimit(quantity, "", -1.0, 1.0, (0.0, 2.0), "not decidable", *stated)


def release(text: str, mass: AddedMass | None = None) -> SimpleNamespace:
    return SimpleNamespace(text=text, added_mass=mass)


def planned(limit: JudgedLimit, mass: AddedMass | None = None) -> Acceptance:
    """Return the result with a plan whose forecast is that one release decides this limit."""
    plan: Any = SimpleNamespace(
        limits=[SimpleNamespace(quantity=limit.quantity, decides=True, all_shapes=False, release=1)],
        releases=[release("P1", mass)],
        inseparable=[],
    )
    return with_recordings(Acceptance("not decidable", "", (limit,)), plan)


def test_a_limit_that_only_the_scale_leaves_open_asks_for_accurate_masses_or_a_known_mass_or_torque() -> None:
    (limit,) = judge(with_friction([1e-5] * 2, (0.5, 3.0)), friction(4e-3)).limits
    assert limit.answer == "not decidable"
    assert limit.reason.startswith(
        "only the uncertainty of b (0.5 to 3 kg m^2) leaves the limit undecided: state more accurate m"
    )
    assert limit.reason.endswith("in the rig file, or record a release with an added mass or a known torque")
    assert planned(limit).would_decide == ()
    with_mass = planned(limit, AddedMass(rod="outer", mass=0.1, position=0.2))
    assert with_mass.would_decide == (limit.quantity,)
    assert with_mass.limits[0].reason == f"{limit.reason}; release 1 alone is expected to decide it"


def test_with_a_clamped_elbow_only_the_inertia_of_the_whole_body_leaves_a_limit_open() -> None:
    """The interval of b is wider and does not apply to sizes."""
    diagnosis = with_friction([1e-5] * 2, (0.2, 5.0))
    assert diagnosis.scale is not None
    scale = diagnosis.scale.model_copy(update={"sizes90": (0.5, 3.0)})
    (limit,) = judge(diagnosis.model_copy(update={"scale": scale}), friction(4e-3)).limits
    uncertain = "the inertia of the whole body (50 % to 300 % of the value in use)"
    assert limit.reason.startswith(f"only the uncertainty of {uncertain} leaves the limit undecided: state more")


def test_a_limit_that_only_motor_constants_leave_open_asks_for_accurate_constants() -> None:
    (limit,) = judge(with_friction([1e-5] * 2, (0.99, 1.01), "data", 0.6), friction(3e-3)).limits
    assert limit.reason == (
        "only the uncertainty of the motor constants (standard deviation 60 %) leaves the limit undecided: state more"
        " accurate motor constants in the rig file"
    )


def test_a_limit_that_a_narrower_fit_decides_is_not_attributed_to_the_scale() -> None:
    """The interval at a known scale ends just below the limit. Its centre is below the limit for every scale."""
    wide = with_friction([1e-3] * 2, (0.9, 1.12))
    (limit,) = judge(wide, friction(3.7e-3)).limits
    assert limit.reason == "the limit lies within the interval: record more releases"
    assert planned(limit).would_decide == (limit.quantity,)


@pytest.mark.parametrize(("value", "reason"), [(1.0e-3, "the limit lies within"), (1.2e-3, "only the uncertainty of")])
def test_the_size_of_a_named_effect_decides_whether_the_scale_is_the_cause(value: float, reason: str) -> None:
    """The limit is 1.3 mN m; the fit excludes it for a known b, whose interval ends 12 % above b."""
    size = EffectSize(value=value, interval90=(0.8e-3, 1.29e-3), interval90_with_scale=(0.7e-3, 1.35e-3))
    base = with_friction([1e-5] * 2, (0.9, 1.12))
    effect = (
        made()
        .effects[0]
        .model_copy(update={"name": "coulomb_joint1", "members": ["coulomb_joint1"], "parameters": {"torque_Nm": size}})
    )
    limits = Limits.model_validate({"effects": {"coulomb_joint1": {"torque_Nm": {"max": 1.3e-3, "unit": "N m"}}}})
    (limit,) = judge(base.model_copy(update={"effects": [effect], "verdict": "named"}), limits).limits
    assert limit.answer == "not decidable"
    assert limit.reason.startswith(reason)


def test_a_limit_that_no_planned_release_decides_states_it_instead_of_advising_more_releases() -> None:
    reason = within()
    limits = [undecided(name, reason) for name in ("far", "near", "shapes")]
    forecasts = [
        SimpleNamespace(quantity="far", decides=False, all_shapes=False, release=None),
        SimpleNamespace(quantity="near", decides=True, all_shapes=False, release=2),
        SimpleNamespace(quantity="shapes", decides=False, all_shapes=True, release=None),
    ]
    texts = [release("P1"), release("P2")]
    plan: Any = SimpleNamespace(limits=forecasts, releases=texts, inseparable=[])
    acceptance = with_recordings(Acceptance("not decidable", "", tuple(limits)), plan)
    far, near, shapes = acceptance.limits
    assert far.reason == "the limit lies within the interval, and 2 further releases would probably not decide it"
    assert far.remedy == "2 further releases would probably not decide it"
    assert shapes.reason == reason.text
    assert near.reason == "the limit lies within the interval: release 2 alone is expected to decide it"
    assert (acceptance.would_decide, acceptance.recordings) == (("near",), ("P1", "P2"))


@pytest.mark.parametrize(
    ("quantity", "reason"),
    [
        ("encoder_offset_joint2.offset_rad", "the probability that this effect is the cause is 89 %"),
        ("a/b", "the ratios depend on the cause, and encoder_offset_joint2 has a probability of only 89 %"),
    ],
)
def test_a_limit_with_an_uncertain_cause_asks_for_the_bench_check_and_not_for_releases(
    quantity: str, reason: str
) -> None:
    """A release can make the interval narrower, but does not separate the causes."""
    limit = undecided(quantity, Reason(reason, obstacle="cause", effects=("encoder_offset_joint2",)))
    pair = Inseparable(causes=("encoder_offset_joint2", "com_offset_link2"), check="Turn the rod.")
    plan: Any = SimpleNamespace(
        limits=[SimpleNamespace(quantity=quantity, decides=True, all_shapes=False, release=1)],
        releases=[release("P1")],
        inseparable=[pair],
    )
    acceptance = with_recordings(Acceptance("not decidable", "", (limit,)), plan)
    assert (acceptance.recordings, acceptance.would_decide) == ((), ())
    stated = acceptance.limits[0].reason
    assert stated == f"{reason}. No release separates {pair.causes[0]} from {pair.causes[1]}. Turn the rod"
    plan.inseparable = []
    separable = with_recordings(Acceptance("not decidable", "", (limit,)), plan)
    assert (separable.would_decide, separable.recordings) == ((quantity,), ("P1",))
    assert separable.limits[0].remedy == "record P1, which tests the causes, and diagnose again"
    assert separable.limits[0].reason == f"{reason}: {separable.limits[0].remedy}"
    (unseen,) = with_recordings(Acceptance("", "", (replace(limit, obstacle="recordings"),)), plan).limits
    assert unseen.reason == f"{reason}: record the planned releases"


def test_the_effects_of_a_reason_are_effects_of_the_library() -> None:
    """An unnamed effect may be the cause of a detectable gap, and an initial state may look like an effect."""
    rival = {"name": "spring_joint1", "class": ["spring_joint1"], "probability": 0.3, "cosine": 1.0}
    result = of_runs(one_cause(effects=[], verdict="no_gap", rivals=[rival]), "P1", "P2")
    result = result.model_copy(update={"absorbed": {"coulomb_joint1": {"torque_Nm": "initial states"}}})
    spring = {"stiffness_Nm_per_rad": {"max": 1e-3, "unit": "N m/rad"}}
    sizes = {"spring_joint1": spring, "coulomb_joint1": {"torque_Nm": {"max": 1e-3, "unit": "N m"}}}
    judged = judge(result, Limits.model_validate({"effects": sizes})).limits
    assert [(limit.obstacle, limit.effects) for limit in judged] == [("cause", ()), ("alike", ())]


@pytest.mark.parametrize(
    ("stated", "ratio", "remedy"),
    [
        (
            ["a/b", "c1/b"],
            "c1/a",
            "record releases of the inner rod alone, and test them without the others, or limit c1/b",
        ),
        (["e1/a", "c1/a"], "c2/b", "record releases of both rods"),
        (["a/b"], "A/b", "record releases with a free or driven arm"),
        (["e1/a", "A/a"], "A/b", "record releases with a free or driven arm, or limit A/a"),
        (["a/b"], "kt/b", "record releases with an arm that is driven by this input"),
        (["a/b"], "kt/(R b)", "record releases with an arm that is driven by this input"),
        (
            ["a/b", "kt/(R b)"],
            "kt/(R a)",
            "record releases with an arm that is driven by this input, or limit kt/(R b)",
        ),
    ],
)
def test_a_ratio_that_the_recordings_do_not_determine_states_those_that_do(
    stated: list[str], ratio: str, remedy: str
) -> None:
    determined = {name: Interval(value=1.0, interval90=(0.9, 1.1)) for name in stated}
    diagnosis = with_friction([1e-5] * 2).model_copy(update={"determined": determined})
    limits = Limits.model_validate({"ratios": {ratio: {"max": 9.0, "unit": RATIO_UNITS[ratio]}}})
    (limit,) = judge(diagnosis, limits).limits
    assert limit.answer == "not decidable"
    assert limit.reason.endswith(f", not {ratio}: {remedy}")


def test_every_ratio_that_the_recordings_do_not_determine_has_a_reason() -> None:
    diagnosis = with_friction([1e-5] * 2).model_copy(update={"determined": {}, "ratios": {}})
    bound = {ratio: {"max": 9.0, "unit": unit} for ratio, unit in RATIO_UNITS.items()}
    for limit in judge(diagnosis, Limits.model_validate({"ratios": bound})).limits:
        assert f"not {limit.quantity}: record" in limit.reason


@pytest.mark.parametrize(
    ("quantity", "obstacle", "remedy"),
    [
        ("c1/b", "cause", ": record P1, which tests"),
        ("air_drag_both.torque", "alike", ". No planned release decides it. "),
        ("c1/b", "alike", EFFECTS["base_tilt"].bench_check[:20]),
    ],
)
def test_every_undecided_limit_states_a_recording_or_that_none_decides_it(
    quantity: str, obstacle: Obstacle, remedy: str
) -> None:
    reason = "any words: record, state, probability, further release"
    limit = undecided(quantity, Reason(reason, obstacle=obstacle, effects=("base_tilt",)))
    plan: Any = SimpleNamespace(limits=[], releases=[release("P1")], inseparable=[])
    acceptance = with_recordings(Acceptance("not decidable", "", (limit, replace(limit, answer="pass"))), plan)
    assert acceptance.limits[0].reason.startswith(reason)
    assert remedy in acceptance.limits[0].reason
    assert acceptance.limits[0].reason.endswith(acceptance.limits[0].remedy)
    assert acceptance.limits[1].reason == reason


def test_a_limit_that_a_second_release_tests_asks_for_no_bench_check() -> None:
    reason = Reason("the probability is 64 %, because one release does not test its form", "record a second release")
    limit = undecided("spring_joint1.stiffness", reason)
    pair = Inseparable(causes=("spring_joint1", "encoder_scale_joint1"), check="Turn the rod.")
    plan: Any = SimpleNamespace(limits=[], releases=[], inseparable=[pair])
    assert with_recordings(Acceptance("not decidable", "", (limit,)), plan).limits == (limit,)


def test_no_release_is_expected_to_decide_a_limit_before_the_diagnosis_explains_the_gap() -> None:
    (limit,) = judge(with_friction([3e-3] * 2).model_copy(update={"verdict": "unexplained"}), friction(4e-3)).limits
    assert (limit.remedy, limit.obstacle) == (FIND_CAUSE, "diagnosis")
    assert planned(limit) == Acceptance("not decidable", "", (limit,))


def free_run(largest: float, errors: Sequence[float], horizon_s: float = 1.0, **gap: object) -> JudgedLimit:
    """Return the test of a limit for free runs; chaos dominates the second run after 2 s."""
    limits = Limits.model_validate({"free_run": {"max": largest, "horizon_s": horizon_s, "unit": "rad"}})
    runs = [RunBudget.model_construct(until_s=2.0 + k, reaches_horizon=k == 0) for k in range(2)]
    evidence = Evidence.model_construct(budget=Budget.model_construct(runs=runs))
    result = made(verdict="no_gap").model_copy(update={"evidence": evidence, "hints": []})
    result = result.model_copy(update={"gap": result.gap.model_copy(update=gap)})
    return judge(result, limits, {f"X{k}": error for k, error in enumerate(errors)}).limits[0]


def test_an_undecided_free_run_states_the_number_of_releases_that_decide_it() -> None:
    """With n = 5 the half width of ln(median) is 2.132 / sqrt(5) = 0.95 < 1, with n = 4 2.353 / 2 = 1.18."""
    limit = free_run(np.e * 1e-3, [np.e * 1e-3, 1e-3, 1e-3 / np.e])
    assert limit.reason == (
        "the limit lies within the interval: 2 further releases with the same mean and spread of the errors would"
        " decide it"
    )


@pytest.mark.parametrize(
    ("horizon_s", "remainder", "cause"),
    [
        (1.0, {}, "factor of 7.4"),
        (
            1.0,
            {"joint1": 1e-3},
            "; the unexplained remainder contributes to them, and further releases do not reduce it",
        ),
        (2.5, {"joint1": 1e-3}, "; small initial errors dominate them after 2 s: choose a shorter horizon_s"),
    ],
)
def test_a_free_run_that_no_number_of_releases_decides_states_the_obstacle(
    horizon_s: float, remainder: dict[str, float], cause: str
) -> None:
    limit = free_run(1e-3, [np.e * 1e-3, 1e-3, 1e-3 / np.e], horizon_s, remainder_Nm=remainder)
    assert limit.reason.startswith("the limit lies within the interval, and 20 further releases would probably not")
    assert limit.reason.endswith(cause)


def test_a_free_run_without_any_error_states_the_obstacle() -> None:
    """The geometric mean of 1e-12, the smallest error, 1e-3 and 1e-2 is 2.2e-6."""
    assert free_run(2.2e-6, [0.0, 1e-3, 1e-2]).reason.endswith("factor of 1e+10")


def forecast(rig: Rig, errors: Sequence[float], largest: float, durations_s: Sequence[float]) -> LimitForecast:
    """Return the forecast of a limit for free runs of 1 s after releases of the given durations."""
    limits = Limits.model_validate({"free_run": {"max": largest, "horizon_s": 1.0, "unit": "rad"}})
    known = replace(known_before(rig), free_run_rad=tuple(errors))
    return limit_forecasts(known, known.prior, limits, [CandidateRelease(2.0, 2.0, s) for s in durations_s])[0]


def test_a_plan_forecasts_a_free_run_from_the_median_of_the_recordings(paper: Rig) -> None:
    """The number of releases that decide is that of `accept`: 2 for a limit of e times the median."""
    errors = [np.e * 1e-3, 1e-3, 1e-3 / np.e]
    one, two = (forecast(paper, errors, np.e * 1e-3, [1.0] * count) for count in (1, 2))
    assert (one.decides, two.decides) == (False, True)
    assert two.reach == pytest.approx(1e-3 * (np.exp(2.1318 / np.sqrt(5)) - 1), rel=1e-3)
    assert not forecast(paper, [0.97e-3, 1.00e-3, 1.04e-3], 1e-3, [1.0] * 20).decides
    assert forecast(paper, [1e-5, 1e-4, 1e-3], 1.0, []).decides


def test_a_release_shorter_than_the_horizon_does_not_decide_a_free_run(paper: Rig) -> None:
    errors = [np.e * 1e-3, 1e-3, 1e-3 / np.e]
    assert not forecast(paper, errors, np.e * 1e-3, [1.0] + [0.99] * 5).decides


@pytest.mark.parametrize(
    ("errors", "reason"),
    [
        ([], "unknown until there are two recordings of at least 1 s"),
        ([1e-3], "unknown until there are two recordings of at least 1 s"),
        ([1e-3, np.inf], "unknown: the simulation of a recording fails before 1 s"),
    ],
)
def test_a_plan_states_why_it_does_not_forecast_a_free_run(paper: Rig, errors: list[float], reason: str) -> None:
    limit = forecast(paper, errors, 1e-3, [1.0] * 3)
    assert limit.reach is None
    assert limit_forecast_table(Plan.model_construct(limits=[limit])).rows[0][-1] == reason

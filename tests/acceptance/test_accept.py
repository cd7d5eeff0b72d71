"""Test limits on simulated recordings of a known effect."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from dpr_lab.acceptance import free_run
from dpr_lab.acceptance.free_run import free_run_errors
from dpr_lab.acceptance.judge import judge
from dpr_lab.acceptance.limits import Limits, load_limits
from dpr_lab.effects import param_index
from dpr_lab.errors import ConfigError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.result.causes import EffectSize
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Evidence, Exclusion, JointFriction
from dpr_lab.gap.screen import as_diagnosed
from dpr_lab.gap.transfer.free_run import FreeRunError
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.run import Run
from tests.a_diagnosis import made

TORQUE_NM = 1.5e-3
UNCORRECTED = {"exact_torques": False, "torques_earlier": 0.0, "shutter": None}
"""Fields of a diagnosis that corrected no recording."""


@pytest.fixture(scope="module")
def diagnosis(recorded: Callable[..., list], paper: Rig) -> Diagnosis:
    return diagnose(recorded({"coulomb_joint1": {"torque_Nm": TORQUE_NM}}), paper)


def limit(effect: str, parameter: str, size: float, unit: str) -> Limits:
    return Limits.model_validate({"effects": {effect: {parameter: {"max": size, "unit": unit}}}})


def answer(diagnosis: Diagnosis, size: float) -> str:
    return judge(diagnosis, limit("coulomb_joint1", "torque_Nm", size, "N m")).answer


@pytest.mark.slow
def test_an_effect_just_above_its_limit_does_not_pass(diagnosis: Diagnosis) -> None:
    assert answer(diagnosis, TORQUE_NM / 1.02) != "pass"


@pytest.mark.slow
def test_a_named_effect_is_judged_by_its_interval(diagnosis: Diagnosis) -> None:
    (named,) = diagnosis.effects
    low, high = named.parameters["torque_Nm"].interval90_with_scale or (0.0, 0.0)
    assert 0 < low < TORQUE_NM < high
    assert answer(diagnosis, 1.1 * high) == "pass"
    alone = named.model_copy(update={"members": [named.name], "odds": {}})
    assert answer(diagnosis.model_copy(update={"effects": [alone]}), 0.9 * low) == "fail"


@pytest.mark.slow
def test_an_effect_does_not_fail_where_another_may_be_the_cause(diagnosis: Diagnosis) -> None:
    (named,) = diagnosis.effects
    low, _ = named.parameters["torque_Nm"].interval90_with_scale or (0.0, 0.0)
    shared = named.model_copy(update={"members": [named.name, "stribeck_joint1"], "odds": {}})
    shared_cause = diagnosis.model_copy(update={"effects": [shared]})
    (judged,) = judge(shared_cause, limit("coulomb_joint1", "torque_Nm", 0.9 * low, "N m")).limits
    assert judged.answer == "not decidable"
    assert "the probability that this effect is the cause" in judged.reason


@pytest.mark.slow
def test_an_effect_that_was_not_named_passes_only_by_its_interval(diagnosis: Diagnosis) -> None:
    (seen,) = judge(diagnosis, limit("latency_joint2", "delay_s", 1e-3, "s")).limits
    assert seen.answer == "pass"
    assert seen.interval90 is not None
    low, high = seen.interval90
    assert low < 0 < high
    (strict,) = judge(diagnosis, limit("latency_joint2", "delay_s", (high - low) / 20, "s")).limits
    assert strict.answer == "not decidable"
    assert strict.reason


@pytest.mark.slow
def test_a_cable_is_judged_with_its_other_amplitudes_free(diagnosis: Diagnosis) -> None:
    """Each interval of stiffness, hardening and constant torque holds for any values of the other amplitudes."""
    (loose,) = judge(diagnosis, limit("spring_joint2", "stiffness_Nm_per_rad", 1.0, "N m/rad")).limits
    assert loose.answer == "pass"
    assert loose.interval90 is not None
    low, high = loose.interval90
    assert diagnosis.evidence is not None
    alone = next(
        e for e in diagnosis.evidence.exclusions if (e.effect, e.parameter) == ("spring_joint2", "stiffness_Nm_per_rad")
    )
    assert high - low > 2 * 1.645 * alone.size / SIGMAS
    (strict,) = judge(diagnosis, limit("spring_joint2", "stiffness_Nm_per_rad", (high + low) / 2, "N m/rad")).limits
    assert strict.answer == "not decidable"


@pytest.mark.slow
def test_absent_cogging_is_judged_in_every_order(diagnosis: Diagnosis) -> None:
    """A limit that is passed in the order of the scan need not be passed in the other orders."""
    (loose,) = judge(diagnosis, limit("detent_joint2", "cos1_Nm", 1.0, "N m")).limits
    assert (loose.answer, loose.reason) == ("pass", "")
    assert loose.interval90 is not None
    assert diagnosis.evidence is not None
    alone = next(e for e in diagnosis.evidence.exclusions if (e.effect, e.parameter) == ("detent_joint2", "cos1_Nm"))
    low, high = loose.interval90
    assert high - low > 2 * 1.645 * alone.size / SIGMAS
    (strict,) = judge(diagnosis, limit("detent_joint2", "cos1_Nm", max(-low, high) / 2, "N m")).limits
    assert strict.answer == "not decidable"


@pytest.mark.slow
def test_nothing_passes_where_the_gap_is_not_explained(diagnosis: Diagnosis) -> None:
    unexplained = diagnosis.model_copy(update={"verdict": "unexplained"})
    (judged,) = judge(unexplained, limit("latency_joint2", "delay_s", 1e-3, "s")).limits
    assert judged.answer == "not decidable"
    assert "no effect explains" in judged.reason


@pytest.mark.slow
def test_an_alternative_of_the_named_effect_does_not_pass(diagnosis: Diagnosis) -> None:
    named = diagnosis.effects[0].model_copy(update={"members": ["coulomb_joint1", "latency_joint2"]})
    (judged,) = judge(
        diagnosis.model_copy(update={"effects": [named]}), limit("latency_joint2", "delay_s", 1e-3, "s")
    ).limits
    assert judged.answer == "not decidable"
    assert "coulomb_joint1" in judged.reason


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "expected"), [(0.0, "pass"), (10.0, "fail"), (1.0, "not decidable")])
def test_a_ratio_is_judged_by_its_interval(diagnosis: Diagnosis, factor: float, expected: str) -> None:
    (wide,) = judge(diagnosis, Limits.model_validate({"ratios": {"c2/b": {"min": 0.0, "unit": "1/s"}}})).limits
    low, high = wide.interval90 or (0.0, 0.0)
    width = high - low
    nominal = (low + high) / 2 + factor * width
    within = {"nominal": nominal, "tolerance": width, "unit": "1/s"}
    assert judge(diagnosis, Limits.model_validate({"ratios": {"c2/b": within}})).answer == expected


@pytest.mark.slow
def test_a_ratio_that_the_recordings_do_not_determine_is_not_decidable(diagnosis: Diagnosis) -> None:
    alone = diagnosis.model_copy(update={"determined": {"e1/a": diagnosis.ratios["e1/b"]}})
    wide = Limits.model_validate({"ratios": {"c2/b": {"min": 0.0, "unit": "1/s"}}})
    (judged,) = judge(alone, wide).limits
    assert (judged.answer, judged.reason) == (
        "not decidable",
        "these recordings determine e1/a, not c2/b: record releases of both rods",
    )


@pytest.mark.slow
def test_an_amplitude_that_the_fit_left_out_does_not_pass(diagnosis: Diagnosis) -> None:
    (named,) = diagnosis.effects
    left_out = EffectSize(value=0.0, interval90=(0.0, 0.0), interval90_with_scale=(0.0, 0.0))
    without = named.model_copy(update={"parameters": {"torque_Nm": left_out}})
    without = diagnosis.model_copy(update={"effects": [without]})
    (judged,) = judge(without, limit("coulomb_joint1", "torque_Nm", 1.0, "N m")).limits
    assert (judged.answer, judged.interval90) == ("not decidable", None)
    assert "this amplitude was not fitted" in judged.reason


@pytest.mark.slow
def test_a_ratio_of_one_rod_or_of_the_arm_is_judged(diagnosis: Diagnosis, tmp_path: Path) -> None:
    arm = {"e1/a": diagnosis.ratios["e1/b"], "A/a": diagnosis.ratios["a/b"], "kt/(R a)": diagnosis.ratios["c2/b"]}
    wide = "".join(
        f'"{name}" = {{min = 0.0, unit = "{unit}"}}\n'
        for name, unit in zip(arm, ("1/s^2", "1", "1/(s^2 V)"), strict=True)
    )
    (tmp_path / "limits.toml").write_text(f"[ratios]\n{wide}")
    acceptance = judge(diagnosis.model_copy(update={"determined": arm}), load_limits(tmp_path / "limits.toml", Limits))
    assert [limit.answer for limit in acceptance.limits] == ["pass"] * 3


@pytest.mark.slow
def test_a_ratio_is_not_decidable_where_the_cause_is_unsure(diagnosis: Diagnosis) -> None:
    (named,) = diagnosis.effects
    unsure = diagnosis.model_copy(update={"effects": [named.model_copy(update={"probability": 0.8})]})
    wide = Limits.model_validate({"ratios": {"c2/b": {"min": 0.0, "unit": "1/s"}}})
    assert judge(diagnosis, wide).answer == "pass"
    (judged,) = judge(unsure, wide).limits
    assert judged.answer == "not decidable"
    assert "depend on the cause" in judged.reason


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "contains no limits"),
        ('[effects.coulomb_jont2]\ntorque_Nm = {max = 1, unit = "N m"}', "coulomb_joint2"),
        ("[effects.coulomb_jont2]\ntorque_Nm = {max = 1}", "no effect named coulomb_jont2; nearest of"),
        ("[effects.coulomb_joint2]\ntorque = {max = 1}", "no amplitude of coulomb_joint2 named torque"),
        ('[ratios]\n"c3/b" = {max = 1.0}', "no ratio named c3/b"),
        ('[effects.coulomb_joint2]\ntorque = {max = 1.0, unit = "N m"}', "torque_Nm"),
        ('[effects.coulomb_joint2]\ntorque_Nm = {max = 1.0, unit = "mN m"}', 'must be "N m"'),
        ('[effects.coulomb_joint2]\ntorque_Nm = {max = -1.0, unit = "N m"}', "torque_Nm.max = -1.0"),
        ('[effects.coulomb_joint2]\ntorque_Nm = {max = nan, unit = "N m"}', "torque_Nm.max = nan"),
        ('[effects.coulomb_joint2]\ntorque_Nm = {max = "1", unit = "N m"}', "torque_Nm.max = '1'"),
        ('[ratios]\n"c3/b" = {max = 1.0, unit = "1/s"}', "no ratio named c3/b"),
        ('[ratios]\n"c2/b" = {nominal = 1.0, unit = "1/s"}', "give both nominal and tolerance"),
        ('[ratios]\n"c2/b" = {unit = "1/s"}', "needs either"),
        ('[free_run]\nmax = 0.1\nhorizon_s = 1.0\nunit = "deg"', 'must be "rad"'),
        ("[ratios", "not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_with_its_key_and_value(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        load_limits(path, Limits)
    assert str(path) in str(refused.value)
    assert words in str(refused.value)


def test_a_unit_may_have_a_superscript(tmp_path: Path) -> None:
    """Tables of `identify` print 1/s²."""
    path = tmp_path / "limits.toml"
    path.write_text('[ratios]\n"e1/b" = {max = 1.0, unit = "1/s²"}', encoding="utf-8")
    assert load_limits(path, Limits).ratios["e1/b"].max == 1.0


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_limits(tmp_path / "none.toml", Limits)


@pytest.mark.slow
def test_a_free_run_is_judged_by_its_spread_over_releases(diagnosis: Diagnosis) -> None:
    limit = {"max": 0.05, "horizon_s": 2.0, "unit": "rad"}
    kept = Limits.model_validate({"free_run": limit})
    answers = {
        name: judge(diagnosis, kept, dict(enumerate_runs(errors))).answer
        for name, errors in {"small": (0.010, 0.012, 0.011), "large": (0.2, 0.25, 0.3), "wide": (0.01, 0.2)}.items()
    }
    assert answers == {"small": "pass", "large": "fail", "wide": "not decidable"}
    (alone,) = judge(diagnosis, kept, {"X1": 0.01}).limits
    assert alone.answer == "not decidable"
    assert "fewer than two recordings" in alone.reason


def test_a_free_run_that_the_model_cannot_simulate_does_not_pass() -> None:
    kept = Limits.model_validate({"free_run": {"max": 0.05, "horizon_s": 1.0, "unit": "rad"}})
    (judged,) = judge(made(), kept, {"X1": 0.010, "X2": 0.011, "X3": np.inf}).limits
    assert judged.answer == "not decidable"
    assert judged.reason == "the simulation of X3 fails before 1 s: choose a shorter horizon_s"


@pytest.mark.parametrize(("fixed_by", "width"), [("data", 1e-3), ("bound", 1.2e-3)])
def test_the_error_of_a_fitted_scale_counts_once(fixed_by: Literal["data", "bound"], width: float) -> None:
    excluded = Exclusion(
        effect="coulomb_joint1", parameter="torque_Nm", size=2e-3, estimate=0.0, confidence=1.0, interval90=(0.0, 1e-3)
    )
    scale = Scale(b=0.01, interval90=(0.008, 0.012), fixed_by=fixed_by)
    result = made(effects=[], scale=scale, evidence=Evidence.model_construct(exclusions=[excluded]))
    (judged,) = judge(result, limit("coulomb_joint1", "torque_Nm", 1.1e-3, "N m")).limits
    assert judged.interval90 == pytest.approx((0.0, width))
    assert judged.answer == ("pass" if fixed_by == "data" else "not decidable")


def test_a_kick_before_the_horizon_leaves_a_run_out(paper: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    ends = {"kicked": 1.2, "whole": 1.97}
    errors = {name: FreeRunError(np.arange(0.3, end, 0.005), np.ones(1)) for name, end in ends.items()}
    monkeypatch.setattr(free_run, "free_runs", lambda *_: SimpleNamespace(errors=errors))
    monkeypatch.setattr(as_diagnosed, "record", lambda run, _: run)
    monkeypatch.setattr(free_run, "without_disturbances", lambda recordings, _: recordings)
    runs: list[Any] = [SimpleNamespace(name=name, t=np.arange(0.0, 2.001, 0.005)) for name in ends]
    gap = SimpleNamespace(closed_held_out=SimpleNamespace(per_run={}))
    result: Any = SimpleNamespace(unknowns=nominal_ratios(paper), model_effects={}, gap=gap, **UNCORRECTED)
    assert free_run_errors(runs, paper, result, 2.0) == {"whole": 1.0}


def enumerate_runs(errors: tuple[float, ...]) -> list[tuple[str, float]]:
    return [(f"X{number}", error) for number, error in enumerate(errors, 1)]


@pytest.mark.slow
def test_free_run_errors_grow_with_the_horizon(recorded: Callable[..., list], diagnosis: Diagnosis, paper: Rig) -> None:
    runs = recorded({"coulomb_joint1": {"torque_Nm": TORQUE_NM}})
    short, long = (free_run_errors(runs, paper, diagnosis, horizon) for horizon in (0.6, 2.0))
    assert short.keys() == long.keys() == {run.name for run in runs}
    assert sum(short.values()) < sum(long.values()) < 0.5
    assert free_run_errors(runs, paper, diagnosis, 59.0) == {}


def test_missed_counts_of_one_run_are_not_applied_to_another_run(paper: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[float] = []

    def simulated(_: object, estimate: Estimate, __: float) -> SimpleNamespace:
        compared.append(estimate.params[param_index("missed_counts", "counts")])
        return SimpleNamespace(errors={})

    monkeypatch.setattr(free_run, "free_runs", simulated)
    monkeypatch.setattr(as_diagnosed, "record", lambda run, _: run)
    monkeypatch.setattr(free_run, "without_disturbances", lambda recordings, _: recordings)
    runs: list[Any] = [SimpleNamespace(name=f"R{i}", t=np.array([0.0, end])) for i, end in enumerate((0.5, 2.0, 2.0))]
    gap = SimpleNamespace(closed_held_out=SimpleNamespace(per_run={run.name: 1.0 for run in runs}))
    effects = {"missed_counts": {"counts": 20.0, "joint": 1.0, "run": 1.0, "time_s": 0.2}}
    result: Any = SimpleNamespace(unknowns=nominal_ratios(paper), model_effects=effects, gap=gap, **UNCORRECTED)
    for horizon in (0.4, 1.0):
        free_run_errors(runs, paper, result, horizon)
    assert compared == [20.0, 0.0]


def test_runs_of_one_name_are_judged_separately(paper: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        free_run,
        "free_runs",
        lambda recordings, *_: SimpleNamespace(
            errors={run.name: FreeRunError(np.array([2.0]), np.ones(1)) for run in recordings.records}
        ),
    )
    monkeypatch.setattr(as_diagnosed, "record", lambda run, _: run)
    monkeypatch.setattr(free_run, "without_disturbances", lambda recordings, _: recordings)
    t = np.linspace(0.0, 2.0, 9)
    run = Run("X1", t, np.zeros((9, 3)), None, None, paper.name, "", 4.0)
    gap = SimpleNamespace(closed_held_out=SimpleNamespace(per_run={}))
    result: Any = SimpleNamespace(unknowns=nominal_ratios(paper), model_effects={}, gap=gap, **UNCORRECTED)
    assert free_run_errors([run, run], paper, result, 2.0) == {"X1": 1.0, "X1 (2)": 1.0}


def friction(size: float, speed: float = 3.0) -> Limits:
    return Limits.model_validate({"friction": {"joint1": {"max": size, "speed_rad_s": speed, "unit": "N m"}}})


@pytest.mark.slow
def test_the_friction_torque_of_a_joint_is_limited_up_to_a_speed(diagnosis: Diagnosis, paper: Rig) -> None:
    viscous = float(paper.nominal[PARAMETERS.index("c1")])
    true = TORQUE_NM + 3.0 * viscous
    answers = [judge(diagnosis, friction(size * true)).answer for size in (0.5, 1 / 1.02, 2.0)]
    assert answers[0] == "fail"
    assert answers[1] != "pass"
    assert answers[2] == "pass"
    (fast,) = judge(diagnosis, friction(2.0, 500.0)).limits
    assert fast.answer == "not decidable"
    assert "joint1 reaches" in fast.reason


@pytest.mark.slow
def test_the_friction_torque_is_undecided_where_its_law_may_be_another_effect(diagnosis: Diagnosis) -> None:
    named = diagnosis.effects[0].model_copy(
        update={"name": "load_friction_joint1", "members": ["load_friction_joint1"]}
    )
    (other,) = judge(diagnosis.model_copy(update={"effects": [named]}), friction(1.0)).limits
    assert other.answer == "not decidable"
    assert "does not depend on the speed alone" in other.reason
    doubted = diagnosis.effects[0].model_copy(update={"probability": 0.5})
    (other,) = judge(diagnosis.model_copy(update={"effects": [doubted], "rivals": []}), friction(1.0)).limits
    assert "is a friction law of joint 1 is 50 %" in other.reason


@pytest.mark.slow
@pytest.mark.parametrize(("back_emf", "above"), [(False, "fail"), (True, "not decidable")])
def test_the_friction_of_an_arm_with_back_emf_can_pass_its_limit_but_not_fail(
    diagnosis: Diagnosis, back_emf: bool, above: str
) -> None:
    speeds, torques = [-3.0, -1.0, 1.0, 3.0], [-0.3, -0.1, 0.1, 0.3]
    curve = JointFriction(
        speed_rad_per_s=speeds, torque_Nm=torques, std_Nm=[1e-3] * 4, coefficients=2, back_emf=back_emf
    )
    assert diagnosis.evidence is not None
    with_arm = diagnosis.evidence.model_copy(update={"friction": {"joint0": curve}})
    of_arm = diagnosis.model_copy(update={"evidence": with_arm})
    for size, expected in ((0.1, above), (1.0, "pass")):
        limit = {"friction": {"joint0": {"max": size, "speed_rad_s": 3.0, "unit": "N m"}}}
        (judged,) = judge(of_arm, Limits.model_validate(limit)).limits
        assert judged.answer == expected
        assert ("back-EMF" in judged.reason) is (expected == "not decidable")


def test_accept_takes_the_limits_file_of_a_plan(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text('[recording]\nlongest_s = 20.0\n[friction.joint2]\nmax = 1.0\nspeed_rad_s = 3.0\nunit = "N m"\n')
    assert load_limits(path, PlanLimits).friction["joint2"].max == 1.0
    path.write_text("[recording]\nlongest_s = 20.0\n")
    with pytest.raises(ConfigError, match="contains no limits"):
        load_limits(path, PlanLimits)
    path.write_text("[effects.coulomb_joint2]\ntorque_Nm = 0.005\n")
    with pytest.raises(ConfigError, match=r"torque_Nm = 0\.005: must be a table of keys and values"):
        load_limits(path, PlanLimits)

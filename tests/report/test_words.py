"""Descriptions before identifiers, and sizes in practical units."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Budget, Evidence, RunBudget
from dpr_lab.report.angles import DEGREES, RADIANS
from dpr_lab.report.gap.sections.curves import curves_words
from dpr_lab.report.gap.sections.friction import friction_words
from dpr_lab.report.run_names import recorded, run_label
from dpr_lab.report.words import in_words, named, parameter_words, size_words
from dpr_lab.shown import percent


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_words_followed_by_its_identifier(name):
    words = EFFECTS[name].words
    assert words
    assert "_" not in words
    assert "{" not in words
    assert named(name) == f"{words} [{name}]"
    for parameter in EFFECTS[name].parameters:
        assert "_" not in parameter.words
        assert parameter.words == parameter_words(name, parameter.name)


def test_the_words_of_a_rise_of_friction_give_its_speeds():
    assert parameter_words("friction_curve_joint1", "rise1_Nm") == "rise (0 to 0.3 rad/s)"
    assert parameter_words("stribeck_joint1", "extra_at_rest_Nm") == "extra at rest"
    assert parameter_words("arm_compliance", "frequency_hz") == "frequency"


def test_words_are_unique():
    assert len({effect.words for effect in EFFECTS.values()}) == len(EFFECTS)


def test_a_sentence_gets_words_once():
    text = "By coulomb_joint2 and load_friction_joint2 of joint2, not friction_joint2."
    once = in_words(text)
    assert once == (
        f"By {named('coulomb_joint2')} and {named('load_friction_joint2')} of joint 2, not friction_joint2."
    )
    assert in_words(once) == once
    assert in_words("Two stay. base_tilt goes.") == "Two stay. Base tilt [base_tilt] goes."


@pytest.mark.parametrize(
    ("effect", "parameter", "values", "expected"),
    [
        ("coulomb_joint2", "torque_Nm", (0.0008,), "0.800 mN m"),
        ("coulomb_joint2", "torque_Nm", (0.0008, 0.0007, 0.0009), "0.800 mN m (0.700 to 0.900)"),
        ("clock_rate", "excess", (0.001,), "0.100 %"),
        ("base_tilt", "tilt_rad", (0.005,), "5.00 mrad"),
        ("detent_joint1", "order", (12.0,), "12"),
        ("rotor_inertia_joint1", "inertia_kgm2", (1e-4,), "1.00 kg cm²"),
        ("stribeck_joint1", "speed_rad_per_s", (0.3,), "0.300 rad/s"),
        ("spring_joint1", "rest_angle_rad", (0.3, 0.2, 0.4), "300 mrad (200 to 400)"),
        ("gone", "torque_Nm", (0.5,), "0.500"),
        ("clock_rate", "excess", (-6.4812e-4, -6.4843e-4, -6.4779e-4), "-0.064812 % (-0.064843 to -0.064779)"),
    ],
)
def test_a_size_is_shown_in_a_practical_unit(effect, parameter, values, expected):
    assert size_words(effect, parameter, RADIANS, *values) == expected


def test_angles_are_in_the_requested_unit():
    assert size_words("base_tilt", "tilt_rad", DEGREES, 0.005) == "0.286 °"
    assert size_words("stribeck_joint1", "speed_rad_per_s", DEGREES, 0.3) == "17.2 °/s"


def test_a_share_that_rounds_to_zero_has_no_sign() -> None:
    assert [percent(-0.001), percent(0.001), percent(-0.0004, 1), percent(-0.012)] == ["0 %", "0 %", "0.0 %", "-1 %"]


def test_the_report_explains_why_its_free_run_errors_differ_from_the_printed_ones() -> None:
    run = RunBudget.model_construct(run="first", error_before_rad=0.02, error_after_rad=0.005)
    evidence = Evidence.model_construct(budget=Budget.model_construct(runs=[run]))
    (words,) = curves_words(Diagnosis.model_construct(evidence=evidence))
    assert "the errors that `dpr-lab diagnose` prints cover 2.6 s, also beyond the horizon" in words
    assert "in first: 20.0 mrad, compared with 5.00 mrad of the corrected model" in words


def test_without_a_friction_curve_no_sentence_refers_to_one() -> None:
    hysteresis = SimpleNamespace(name="hysteresis_joint1")
    made = Diagnosis.model_construct(evidence=Evidence.model_construct(friction={}), effects=[hysteresis])
    assert friction_words(made) == ["No joint moves fast enough in both directions."]


def test_a_run_has_the_same_name_in_sentences_and_in_tables() -> None:
    name = "20261121T101500Z_X1_1a2b3c4d"
    assert in_words(f"The free run of {name} has an error.") == f"The free run of {run_label(name)} has an error."
    assert in_words(f"dpr-lab diagnose runs/{name}.mcap") == f"dpr-lab diagnose runs/{name}.mcap"
    assert in_words(f"dpr-lab diagnose {name}.mcap") == f"dpr-lab diagnose {name}.mcap"


def test_a_sentence_after_the_name_of_a_run_starts_with_a_capital() -> None:
    name = "20261121T101500Z_X1_1a2b3c4d"
    words = in_words(f"The run {name} ends. base_tilt acts. base_tilt is small.")
    assert words == f"The run {run_label(name)} ends. Base tilt [base_tilt] acts. Base tilt [base_tilt] is small."


def test_each_run_has_a_label_that_no_other_run_has() -> None:
    names = [f"20261121T1015{rest}" for rest in ("00Z_X1_1a2b3c4d", "07Z_X1_1a2b3c4d", "07Z_X1_1a2b3c4d-2")]
    assert len({run_label(name) for name in names}) == 3
    assert "15:07 " in run_label(names[1])
    assert run_label(names[2]).endswith(", number 2)")


@pytest.mark.parametrize("name", ["X1_1a2b3c4d-2", "X1_1a2b3c4d-12", "side-left_1a2b3c4d", "45.5-deg_1a2b3c4d-2"])
def test_the_whole_name_of_a_run_is_replaced_by_its_label(name: str) -> None:
    run = f"20261121T101507Z_{name}"
    assert in_words(f"The swings {run}, {run} and {run}.") == "The swings {0}, {0} and {0}.".format(run_label(run))
    assert in_words(f"dpr-lab diagnose {run}.mcap") == f"dpr-lab diagnose {run}.mcap"


def test_two_runs_of_one_minute_have_different_times() -> None:
    first, second = (Path(f"20261121T1015{s}Z_X1_1a2b3c4d.mcap") for s in ("07", "52"))
    assert recorded(first) == recorded(second)
    assert ":15:07" in recorded(first, seconds=True)
    assert ":15:52" in recorded(second, seconds=True)

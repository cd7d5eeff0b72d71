"""Words before identifiers, and sizes in units that a person reads."""

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.report.angles import DEGREES, RADIANS
from dpr_lab.report.words import in_words, named, parameter_words, size_words


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_is_named_in_words_with_its_identifier_beside_them(name):
    words = EFFECTS[name].words
    assert words
    assert "_" not in words
    assert "{" not in words
    assert named(name) == f"{words} [{name}]"
    for parameter in EFFECTS[name].parameters:
        assert "_" not in parameter_words(parameter.name)
        assert parameter_words(parameter.name)


def test_words_are_unique():
    assert len({effect.words for effect in EFFECTS.values()}) == len(EFFECTS)


def test_a_sentence_gets_words_and_sizes_once():
    said = "By coulomb_joint2 and load_friction_joint2 of joint2, not friction_joint2."
    once = in_words(said, {"coulomb_joint2": "0.80 mN m"})
    assert once == (
        "By Coulomb friction, joint 2 (0.80 mN m) [coulomb_joint2] and load-dependent friction, joint 2"
        " [load_friction_joint2] of joint 2, not friction_joint2."
    )
    assert in_words(once) == once
    assert in_words("Two stay. base_tilt goes.") == "Two stay. Base tilt [base_tilt] goes."


@pytest.mark.parametrize(
    ("effect", "parameter", "values", "said"),
    [
        ("coulomb_joint2", "torque_Nm", (0.0008,), "0.800 mN m"),
        ("coulomb_joint2", "torque_Nm", (0.0008, 0.0007, 0.0009), "0.800 mN m (0.700 to 0.900)"),
        ("clock_rate", "excess", (0.001,), "0.100 %"),
        ("base_tilt", "tilt_rad", (0.005,), "5.00 mrad"),
        ("detent_joint1", "order", (12.0,), "12.0"),
        ("rotor_inertia_joint1", "inertia_kgm2", (1e-4,), "1.00 kg cm²"),
        ("stribeck_joint1", "speed_rad_per_s", (0.3,), "0.300 rad/s"),
        ("gone", "torque_Nm", (0.5,), "0.500"),
    ],
)
def test_a_size_is_read_in_its_own_unit(effect, parameter, values, said):
    assert size_words(effect, parameter, RADIANS, *values) == said


def test_angles_are_in_the_unit_asked_for():
    assert size_words("base_tilt", "tilt_rad", DEGREES, 0.005) == "0.286 °"
    assert size_words("stribeck_joint1", "speed_rad_per_s", DEGREES, 0.3) == "17.2 °/s"

"""Probability of a cause outside the library: by the remaining share, its size, and the share of the effect."""

from types import SimpleNamespace
from typing import Any

import pytest

from dpr_lab.gap.classes.posterior import CALIBRATION, odds_outside, outside
from dpr_lab.gap.conclusion.notes import motor_in_backlash
from dpr_lab.gap.which.selected import Selection


def test_even_odds_where_a_remainder_as_large_as_the_noise_is_the_stated_share():
    assert odds_outside(CALIBRATION.half_unexplained, 1.0) == pytest.approx(1.0)


@pytest.mark.parametrize("left", [0.01, 0.05, 0.2])
def test_the_same_share_is_less_suspicious_near_the_noise_than_far_above_it(left):
    near, far = odds_outside(left, 0.5), odds_outside(left, 5.0)
    assert far == pytest.approx(10 * near)
    assert odds_outside(left, 50.0) == pytest.approx(odds_outside(left, 20.0))


def test_small_causes_below_the_noise_leave_a_dominant_one_certain_and_an_unknown_law_does_not():
    """6 % left by small causes of half the noise; 25 % left by a wrong law, 15 times the noise (blind trials)."""
    small, unknown = odds_outside(0.06, 0.5), odds_outside(0.25, 15.0)
    assert 1 / (1 + small) > 0.9
    assert 1 / (1 + unknown) < 0.4


def test_an_effect_no_larger_than_what_remains_far_above_the_noise_is_less_sure_than_the_dominant_one():
    """7 % remain at eight times the noise: cogging of 5 % did not exist, the spring of 74 % did (simulated rigs)."""
    dominant, small = odds_outside(0.065, 8.0, unique=0.735), odds_outside(0.065, 8.0, unique=0.045)
    assert 1 / (1 + dominant) > 0.9
    assert 1 / (1 + small) < 0.8
    assert odds_outside(0.065, 0.5, unique=0.045) < 0.05  # near the noise, every rig has small causes


def test_a_small_effect_that_another_form_of_a_large_one_explains_as_well_is_unsure():
    """A spring with slack was named as a spring, cogging of 0.1 % and an offset of the centre of mass of 0.4 %."""
    compensating, other = (odds_outside(1e-4, 0.0, unique=0.004, own_share=own) for own in (0.001, 0.5))
    assert 1 / (1 + compensating) < 0.3
    assert 1 / (1 + other) > 0.95


def selected(shares: dict[str, float]) -> Selection:
    """A set of effects with these shares of the gap, which leaves only noise."""
    noise = SimpleNamespace(effects=tuple(shares), residuals=SimpleNamespace(excess=0.0, z=0.0, noise_ratio=1.0))
    base = SimpleNamespace(residuals=SimpleNamespace(excess=1.0))
    without = {name: SimpleNamespace(residuals=SimpleNamespace(excess=share)) for name, share in shares.items()}
    parts: dict[str, Any] = dict.fromkeys(("fitted", "final_test", "without", "tests_without", "path"))
    return Selection(**{**parts, "base": base, "chosen": noise, "without_substitute": without, "own_shares": {}})


@pytest.mark.parametrize("name", ["input_delay", "hysteresis_joint0", "friction_curve_joint0", "coulomb_joint0"])
def test_a_small_effect_of_the_arm_next_to_a_backlash_of_its_gear_may_be_the_motor(name: str) -> None:
    both = selected({"backlash_joint0": 0.9, name: 0.03})
    assert outside(both, name) >= 0.5
    assert outside(both, "backlash_joint0") < 0.1
    assert "cannot separate" in next(motor_in_backlash(both))


def test_a_large_effect_one_of_the_rods_or_one_without_a_backlash_is_not_the_motor() -> None:
    for shares in (
        {"backlash_joint0": 0.5, "coulomb_joint0": 0.4},
        {"backlash_joint0": 0.9, "coulomb_joint1": 0.03},
        {"coulomb_joint0": 0.9, "input_delay": 0.03},
    ):
        other = selected(shares)
        assert outside(other, list(shares)[1]) < 0.1
        assert not list(motor_in_backlash(other))

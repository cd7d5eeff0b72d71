"""Probability of a cause outside the library, from the remaining share, its size, and the share of the effect."""

import pytest

from dpr_lab.gap.hypothesis.calibration import CALIBRATION, odds_outside


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
    odds = [CALIBRATION.odds_of_compensation(own) for own in (0.001, 0.5)]
    compensating, other = (odds_outside(1e-4, 0.0, unique=0.004, compensation=c) for c in odds)
    assert 1 / (1 + compensating) < 0.6
    assert 1 / (1 + other) > 0.95

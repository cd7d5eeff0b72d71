"""Rules of the search, for sets of effects with given residuals; the expected limits are calculated by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON
from dpr_lab.gap.conclusion.verdict import small_effects
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.imitation import (
    curve_follows_remainder,
    follows_decay,
    follows_swing,
    substitute_curve,
)
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.hypothesis.significance import (
    accepted,
    adds_less_than_remains,
    evidence_ratio,
    explains_as_much,
    form_indifference,
    most_excess,
    promising_gain,
    segment_scatter,
    significance,
)

DOF = 10_000
"""Degrees of freedom; the excess of noise has the standard deviation 100."""
EFFECT = ("coulomb_joint1",)


def fitted(
    excess: float, effects: tuple[str, ...] = EFFECT, *, segments=(), rho: float = 0.0, cost=None, parameters: int = 0
) -> Hypothesis:
    """A set with an excess chi-square, and its predictive loss if it differs from chi2."""
    chi2 = DOF + excess
    residuals = ResidualStatistics(chi2, DOF, level=1.0, autocorrelation=rho)
    by_segment = np.array([chi2]) if len(segments) == 0 else np.asarray(segments, dtype=float)
    fit: Any = SimpleNamespace(free=(None,) * parameters, linear=SimpleNamespace(chi2_by_segment=by_segment))
    priors = dict.fromkeys(effects, 1.0)
    return Hypothesis(effects, fit, residuals, chi2 if cost is None else cost, {}, priors=priors)


BARE = fitted(90_000.0, ())


@pytest.mark.parametrize(
    ("before", "limit"),
    [(1300.0, 1000.0), (13_000.0, 10_000.0), (39_000.0, 35_400.0), (90_000.0, 86_400.0), (200.0, 400.0 / 1.3)],
)
def test_an_effect_must_remove_a_third_of_the_remainder_or_4_percent_of_the_gap(before: float, limit: float) -> None:
    assert most_excess(BARE, fitted(before)) == pytest.approx(limit)


def test_while_a_residual_remains_the_excess_must_be_below_its_maximum() -> None:
    before = fitted(13_000.0)
    assert accepted(BARE, before, fitted(9_999.0))
    assert not accepted(BARE, before, fitted(10_001.0))
    assert not accepted(BARE, before, fitted(9_000.0, cost=before.cost - 50.0))  # not significant
    assert accepted(BARE, fitted(450.0), fitted(399.0))  # only noise remains, so significance is sufficient


@pytest.mark.parametrize(
    ("before", "after", "limit"),
    [
        (BARE, fitted(20_000.0), 30 * 3.0),  # the first effect: 30 times the inflation
        (BARE, fitted(0.0), 30.0),
        (fitted(20_000.0), fitted(10_000.0), 30 * 2.0),
        (fitted(20_000.0), fitted(0.0), 30.0),  # 5e-5 of 90 000 is less
        (fitted(300.0), fitted(0.0), 90.0),
        (fitted(300.0), fitted(0.0, rho=0.5), 3 * 90.0),
        (fitted(0.0, rho=0.5, parameters=4), fitted(0.0), 90.0 + (3 - 1) * 4 * 9.0),  # penalty of 4 parameters
        (fitted(500.0, rho=0.5, parameters=4), fitted(0.0), 30.0),  # more than noise remains without the effect
    ],
)
def test_a_reduction_is_significant_beyond_chance(before: Hypothesis, after: Hypothesis, limit: float) -> None:
    assert significance(BARE, before, after) == pytest.approx(limit)


def test_the_step_of_the_integrator_limits_a_reduction_of_a_large_gap() -> None:
    bare = fitted(1e7, ())
    assert significance(bare, fitted(20_000.0), fitted(0.0)) == pytest.approx(5e-5 * 1e7)
    zero, friction = ("encoder_offset_joint1",), ("encoder_offset_joint1", "coulomb_joint1")
    detent = ("encoder_offset_joint1", "detent_joint1")
    assert significance(bare, fitted(300.0, zero), fitted(0.0, detent)) == pytest.approx(5e-4 * 1e7)
    assert significance(bare, fitted(300.0, zero), fitted(0.0, friction)) == pytest.approx(5e-5 * 1e7)
    assert significance(bare, fitted(300.0), fitted(0.0)) == pytest.approx(5e-4 * 1e7)
    assert significance(bare, fitted(40_000.0), fitted(20_000.0)) == pytest.approx(5e-4 * (1e7 - 20_000.0))


def test_a_reduction_in_every_segment_is_significant_however_small_it_is() -> None:
    """Reductions of 9 and 11 in turn in ten segments have the variance 10 / 9, and their sum the variance 100 / 9."""
    reductions = np.tile([9.0, 11.0], 5)
    before = fitted(20_100.0, segments=3000.0 + reductions)
    after = fitted(20_000.0, segments=np.full(10, 3000.0))
    assert segment_scatter(before, after) == pytest.approx(4 * 10 / 3)
    assert segment_scatter(before, after, 1.0) == pytest.approx(10 / 3)
    assert significance(BARE, before, after) == pytest.approx(40 / 3)
    noise = fitted(0.0, segments=np.full(10, 3000.0))
    assert significance(BARE, before, noise) == 30.0  # noise of every reading is independent
    few = fitted(0.0, segments=np.ones(9))
    assert segment_scatter(few, few) == np.inf
    failed = fitted(0.0, segments=[np.inf, *np.ones(9)])
    assert segment_scatter(failed, after) == np.inf


@pytest.mark.parametrize(
    ("smaller", "model", "expected"),
    [
        (fitted(360.0), fitted(0.0), 360.0 / 30.0),
        (fitted(13_000.0), fitted(1000.0), 13 / 1.3),  # 12 000 of 90 000 is a large effect
        (fitted(4000.0), fitted(1000.0), 4 / 3.0),
        (fitted(1800.0), fitted(1000.0), 0.0),  # less than 1 % of the gap, and less than 30 times
        (fitted(4000.0, segments=np.full(10, 1e3)), fitted(1000.0, segments=np.full(10, 700.0)), 4 / 1.3),
    ],
)
def test_an_effect_is_needed_by_the_growth_of_the_excess_without_it(
    smaller: Hypothesis, model: Hypothesis, expected: float
) -> None:
    assert evidence_ratio(BARE, model, smaller) == pytest.approx(expected)


def test_small_effects_add_less_than_one_percent_of_the_gap_together() -> None:
    path = [("a", fitted(5000.0)), ("b", fitted(1850.0)), ("c", fitted(1500.0)), ("d", fitted(1000.0))]
    assert small_effects(BARE, path) == {"c", "d"}  # 1850 and 1500 are below 1000 + 900


VIBRATION, DRIFT, CURVE = "base_vibration", "friction_drift_joint1", "friction_curve_joint1"


@pytest.mark.parametrize(("excess", "follows"), [(45_199.0, True), (45_200.0, False), (45_201.0, False)])
def test_a_vibration_on_a_swing_line_follows_a_residual_that_another_set_halves(excess: float, follows: bool) -> None:
    """The vibration explains 89 600, up to the floor of 400; half of it leaves 45 200."""
    vibrating = replace(fitted(0.0, (VIBRATION,)), harmonic_vibrations=frozenset({VIBRATION}))
    assert follows_swing(BARE, vibrating, fitted(excess)) is follows
    assert not follows_swing(BARE, vibrating, fitted(excess, ()))
    assert not follows_swing(BARE, vibrating, fitted(0.0, (VIBRATION,)))
    assert not follows_swing(BARE, fitted(0.0, (VIBRATION,)), fitted(0.0))


@pytest.mark.parametrize(("excess", "follows"), [(9_359.0, True), (9_360.0, False)])
def test_a_drift_follows_a_decay_that_a_set_of_its_size_nearly_explains(excess: float, follows: bool) -> None:
    drifting = replace(fitted(0.0, (DRIFT,), parameters=3), decay_drifts=frozenset({DRIFT}))
    assert follows_decay(BARE, drifting, fitted(excess, parameters=3)) is follows
    assert not follows_decay(BARE, drifting, fitted(excess, parameters=4))
    assert not follows_decay(BARE, drifting, fitted(excess, ()))
    assert not follows_decay(BARE, drifting, fitted(0.0, (DRIFT,)))
    assert not follows_decay(BARE, fitted(0.0, (DRIFT,)), fitted(0.0))


@pytest.mark.parametrize(
    ("excess", "gain", "follows"),
    [
        (1_000.0, 32.0, True),  # 30 times the inflation of 1.1 is 33
        (1_000.0, 33.0, False),
        (9_359.0, 32.0, True),
        (9_361.0, 32.0, False),  # explains less than 0.9 of what the curve explains
    ],
)
def test_a_curve_follows_a_small_remainder_unless_it_is_significant(excess: float, gain: float, follows: bool) -> None:
    simple = fitted(excess, cost=2_000.0)
    curved = replace(fitted(0.0, (CURVE,), cost=2_000.0 - gain), curves={CURVE: 0.05})
    assert curve_follows_remainder(BARE, curved, simple) is follows
    assert not curve_follows_remainder(BARE, replace(curved, priors={CURVE: 5.1}), simple)  # much more probable
    assert curve_follows_remainder(BARE, replace(curved, priors={CURVE: 4.9}), simple) is follows
    assert not curve_follows_remainder(BARE, curved, fitted(excess, (), cost=2_000.0))
    assert not curve_follows_remainder(BARE, curved, replace(simple, effects=(CURVE,)))
    assert not curve_follows_remainder(BARE, curved, fitted(10_001.0, cost=2_000.0))  # larger than the noise


def test_a_curve_that_grows_when_an_effect_is_removed_is_its_substitute() -> None:
    model = replace(fitted(0.0, (CURVE, *EFFECT)), curves={CURVE: 0.2})
    for size, curve in ((0.39, None), (0.4, None), (0.41, CURVE)):
        assert substitute_curve(model, replace(fitted(100.0, (CURVE,)), curves={CURVE: size})) == curve
    assert substitute_curve(model, replace(fitted(-100.0, (CURVE,)), curves={CURVE: 1.0})) is None  # not better
    ordinary = replace(model, curves={CURVE: 0.01})  # sizes below the ordinary one are equal
    assert substitute_curve(ordinary, replace(fitted(100.0, (CURVE,)), curves={CURVE: 0.19})) is None
    assert substitute_curve(model, fitted(100.0)) is None


def test_a_set_with_fewer_parameters_explains_as_much_within_the_indifference() -> None:
    rich = fitted(0.0, parameters=6, cost=1_000.0)
    for cost, as_much in ((1_053.0, True), (1_054.0, False)):  # a penalty of 9, and 5e-4 of the explained 90 000
        assert explains_as_much(BARE, fitted(0.0, parameters=5, cost=cost), rich) is as_much
    assert not explains_as_much(BARE, fitted(0.0, parameters=6, cost=0.0), rich)
    assert not explains_as_much(BARE, fitted(9_361.0, parameters=5, cost=0.0), rich)  # less than 0.9


def test_a_richer_form_must_add_more_while_a_residual_remains() -> None:
    assert form_indifference(BARE, fitted(0.0)) == pytest.approx(45.0)
    assert form_indifference(BARE, fitted(10_000.0)) == pytest.approx(240.0)


@pytest.mark.parametrize(("simpler", "less"), [(1_999.0, True), (2_000.0, False), (2_001.0, False)])
def test_a_richer_form_that_removes_less_than_it_leaves_is_no_better(simpler: float, less: bool) -> None:
    assert adds_less_than_remains(fitted(1_000.0), fitted(simpler)) is less
    assert not adds_less_than_remains(fitted(1_000.0), None)
    assert not adds_less_than_remains(fitted(0.0), fitted(100.0))


def test_a_candidate_is_promising_from_the_chance_level_or_from_half_of_the_excess() -> None:
    assert promising_gain(fitted(0.0)) == 30.0
    assert promising_gain(fitted(40.0)) == 30.0
    assert promising_gain(fitted(90_000.0, rho=0.9)) == pytest.approx(30.0 * 10.0 / GAUSS_NEWTON.exceeded)
    few = replace(fitted(0.0), residuals=ResidualStatistics(75.0, 5, level=1.0, autocorrelation=0.9))
    assert promising_gain(few) == pytest.approx(0.5 * 70.0)

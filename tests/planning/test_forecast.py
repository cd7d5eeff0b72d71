"""Forecast of a decision: simulated score tests, held-out data, placement errors, and causes outside the library."""

from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from dpr_lab.arrays import Array
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.hypothesis.hypothesis import PENALTY
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.planning.forecast import FORECAST, settled_probabilities
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import Knowledge, known_before
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import worthwhile
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.planning.sequence import SequenceStep
from dpr_lab.planning.stopping import Causes, causes_of
from dpr_lab.planning.summary import summed_up
from dpr_lab.planning.worth.criteria import OpenAmplitudes, OpenPairs, detectable
from dpr_lab.planning.worth.objective import Objective
from dpr_lab.rig import Rig
from tests.one_cause import latency, of_runs, one_cause


def forecasts(*sizes: float, gains: Sequence[float], cosine: float = 0.0) -> list[float]:
    """Forecasts for a latency and further effects, whose signatures have this cosine with each other.

    The information is multiplied by `gains`.
    """
    names = [("latency_joint2", "delay_s"), ("base_tilt", "tilt_rad"), ("com_offset_link2", "offset_m")][: len(sizes)]
    tested = tuple(
        latency(size).model_copy(update={"effect": effect, "parameter": parameter})
        for size, (effect, parameter) in zip(sizes, names, strict=True)
    )
    before = np.full((len(tested), len(tested)), cosine) + (1 - cosine) * np.eye(len(tested))
    path = [OpenAmplitudes(tested, before, gain * before) for gain in gains]
    return settled_probabilities([path] * 40)


def settled(*sizes: float, gain: float = 2.5, cosine: float = 0.0) -> float:
    """Forecast for one further release."""
    return forecasts(*sizes, gains=[gain], cosine=cosine)[0]


@pytest.mark.parametrize("sizes", [2.5, 4.0, 5.5])
def test_the_forecast_without_a_visible_gap_is_the_share_of_draws_that_exclude_or_decide_an_effect(
    sizes: float,
) -> None:
    gain, count, rng, limit = 2.5, 200_000, np.random.default_rng(0), 5.0 - NormalDist().inv_cdf(0.95)
    present = rng.random(count) < 1 / (1 + np.exp(-0.5 * (sizes**2 - PENALTY.parameter)))
    true = present * (sizes + rng.standard_normal(count))  # a flat prior of the size
    further = true * (gain - 1) ** 0.5 + rng.standard_normal(count)
    both = (sizes + (gain - 1) ** 0.5 * further) / gain**0.5
    assert settled(sizes, gain=gain) == pytest.approx(np.mean((both < limit) | (both > 39**0.5)), abs=0.03)


def test_the_forecast_without_a_visible_gap_considers_effects_that_are_excluded_now() -> None:
    """An effect of 3 standard deviations is excluded, but if it is present, its estimate grows."""
    assert 1.0 == settled() > settled(1.0) > settled(3.0) > settled(4.0)
    grown = [settled(5.0, gain=gain) for gain in (1.0, 2.0, 4.0, 16.0)]
    assert grown == sorted(grown)
    assert grown[0] < 0.05
    assert grown[-1] > 0.99


def test_an_effect_that_becomes_visible_is_decided_only_if_its_alternatives_are_excluded() -> None:
    """Two effects with the same signature count as one, because only a bench check separates them."""
    apart, similar, same = (settled(5.0, 5.0 * cosine, gain=4.0, cosine=cosine) for cosine in (0.0, 0.9, 1.0))
    assert min(apart, same) > 0.95
    assert similar < 0.6
    assert settled(5.0, 4.5, gain=16.0, cosine=0.9) > similar + 0.2


def test_a_richer_form_of_the_best_effect_does_not_keep_it_undecided() -> None:
    """Its amplitudes contain the signature of the effect, even if its most significant amplitude is another one."""
    offset, drift = "encoder_offset_joint1", "encoder_drift_joint1"
    amplitudes = [(offset, "offset_rad", 5.0), (drift, "offset_rad", 5.0), (drift, "rate_rad_per_s", 5.1)]
    tested = tuple(
        latency(size).model_copy(update={"effect": effect, "parameter": parameter})
        for effect, parameter, size in amplitudes
    )
    before = np.array([[1.0, 1.0, 0.9], [1.0, 1.0, 0.9], [0.9, 0.9, 1.0]])
    (richer,) = settled_probabilities([[OpenAmplitudes(tested, before, 4.0 * before)]] * 40)
    (apart,) = settled_probabilities(
        [[OpenAmplitudes((tested[0], tested[2]), before[1:, 1:], 4.0 * before[1:, 1:])]] * 40
    )
    assert richer > apart + 0.1


def test_a_forecast_uses_the_prior_odds_of_common_effects() -> None:
    """A diagnosis decides a common effect against a rare one of nearly the same signature and significance."""
    sizes, similar = (5.5, 4.4), np.array([[1.0, 0.8], [0.8, 1.0]])
    made = []
    for names in (
        ("base_tilt", "com_offset_link2"),
        ("latency_joint2", "com_offset_link2"),
        ("base_tilt", "encoder_offset_joint1"),
    ):
        tested = tuple(latency(z).model_copy(update={"effect": name}) for z, name in zip(sizes, names, strict=True))
        made += settled_probabilities([[OpenAmplitudes(tested, similar, 2.0 * similar)]] * 40)
    common, both_rare, both_common = made
    assert common > both_rare + 0.1
    assert both_common == pytest.approx(both_rare, abs=1e-9)


def test_a_question_that_a_release_settles_stays_settled() -> None:
    """A second release could show an estimate of 3 standard deviations again, but it is not recorded."""
    later = forecasts(3.2, gains=[1.001, 2.0])
    assert later[0] > 0.9
    assert later[1] >= later[0]
    assert settled(3.2, gain=2.0) < later[0] - 0.1


def test_a_forecast_considers_the_errors_of_manual_placement(paper: Rig) -> None:
    """The information of a swing that starts near the upright position depends on the exact start pose."""
    nothing, known = one_cause(verdict="no_gap", effects=[]), known_before(paper)
    recorded, swing = informed([CandidateRelease(0.3, 5.6, 5.0), CandidateRelease(0.02, 0.02, 5.0)], known.model)
    known = replace(known, information=known.information + recorded.information)
    step = SequenceStep(swing.release, swing.information, 1.0, 0.0)
    made = []
    for std in (1e-9, known.model.placement_rad):
        after = replace(known, model=replace(known.model, placement_rad=std))
        after = replace(after, diagnosis=of_runs(nothing, "P1", exclusions=[latency(5.0)]))
        made += summed_up(Objective.of(after), [step], PlanLimits(), 0.0).forecast
    assert abs(made[0] - made[1]) > 0.01


def test_without_a_visible_gap_only_the_simulated_score_tests_determine_the_forecast(paper: Rig) -> None:
    nothing, known = one_cause(verdict="no_gap", effects=[]), known_before(paper)
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    known = replace(known, information=known.information + swing.information)
    step = SequenceStep(swing.release, swing.information, 1.0, 0.0)
    known = replace(known, model=replace(known.model, placement_rad=1e-9))  # each simulated release has the same pose
    made = []
    for runs in (("P1", "P2"), ("P1", "P2", "P3", "P4")):
        after = replace(known, diagnosis=of_runs(nothing, *runs, exclusions=[latency(4.0)]))
        made += summed_up(Objective.of(after), [step], PlanLimits(), 0.0).forecast
    tested = OpenAmplitudes.of(after, after.information + swing.information, excluded=True)
    assert made[0] == pytest.approx(settled_probabilities([[tested]] * FORECAST.placements)[0])
    assert made[1] == made[0]
    assert summed_up(Objective.of(after), [], PlanLimits(), 0.0).forecast == []


def test_a_cause_without_alternatives_lowers_the_forecast_if_it_may_be_outside_the_library(paper: Rig) -> None:
    known = known_before(paper)
    causes = Causes("coulomb_joint1", {"coulomb_joint1": 0.8}, 0.2)
    known = replace(known, causes=(causes,), named=frozenset({causes.about}), diagnosis=of_runs(one_cause(8.0), "P1"))
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    objective = Objective.of(known)
    step = SequenceStep(swing.release, swing.information, 1.0, 0.0)
    made = summed_up(objective, [step], PlanLimits(), 0.0)
    assert made.forecast == [pytest.approx(0.8 * FORECAST.confirmed)]
    assert made.releases[0].pairs == []


def test_a_failed_test_on_the_quarters_of_one_release_is_no_cause_outside_the_library() -> None:
    """A second release replaces this test; afterwards the missing probability counts."""
    effect = {"probability": 0.49, "outside": 0.02}
    failed = one_cause(verdict="partly_explained", rivals=[])
    failed = failed.model_copy(update={"effects": [failed.effects[0].model_copy(update=effect)]})
    (one,), (two,) = (list(causes_of(of_runs(failed, *runs))) for runs in (("P1",), ("P1", "P2")))
    assert (one.outside, two.outside) == (0.02, pytest.approx(0.51))


def test_causes_count_as_one_if_the_plan_after_the_release_will_recommend_the_bench_check(paper: Rig) -> None:
    """Six repeated releases separate the drift from the offset before the next release, but not after it.

    The first release has 0.3 times the information of the next one. The d^2 of six releases is then 6 / (0.3 T) from
    the uncertainty of the drift rate, and 6 / (1.3 T) after the next release.
    """
    pair = ("encoder_offset_joint1", "encoder_drift_joint1")
    class_of = {"name": pair[0], "members": [*pair], "odds": dict.fromkeys(pair, 0.5)}
    effect, known = one_cause().effects[0].model_copy(update=class_of), known_before(paper)
    diagnosis = one_cause().model_copy(update={"effects": [effect]})
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    step, plans = SequenceStep(swing.release, swing.information, 1.0, 0.0), list[Plan]()
    for share, runs in ((0.3, ["P1"]), (1.3, ["P1", "P2"])):
        result = of_runs(diagnosis, *runs)
        information, causes = known.information + share * swing.information, tuple(causes_of(result))
        after = replace(known, information=information, causes=causes, named=frozenset(pair[:1]), diagnosis=result)
        objective = Objective.of(after)
        (d2,) = objective.gained(information + FORECAST.repeats * swing.information)
        assert d2.max() == pytest.approx(FORECAST.repeats / share / CALIBRATION.temperature, rel=0.01)
        plans.append(summed_up(objective, [step], PlanLimits(), 0.0))
    assert [made.state for made in plans] == ["record", "bench check"]
    assert not plans[0].inseparable
    assert plans[0].forecast == [pytest.approx(FORECAST.confirmed * effect.probability)]
    assert f"decided, except between {pair[0]} and {pair[1]}," in plans[0].sentence


def test_a_candidate_without_a_column_counts_against_a_decision(paper: Rig) -> None:
    known = known_before(paper)
    pairs = OpenPairs.of(known, Causes("coulomb_joint1", {"coulomb_joint1": 0.5, "missed_counts": 0.4}, 0.1))
    assert pairs.names == ("coulomb_joint1",)
    assert pairs.outside == pytest.approx(0.5)


def test_a_remainder_above_the_noise_lowers_the_forecast(paper: Rig) -> None:
    known, partly = known_before(paper), one_cause(verdict="partly_explained")
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    step = SequenceStep(swing.release, swing.information, 1.0, 0.0)
    for remainder, expected in (({}, FORECAST.confirmed), ({"joint1": 1e-4}, FORECAST.revealed)):
        gap = partly.gap.model_copy(update={"remainder_Nm": remainder})
        after = replace(known, diagnosis=of_runs(partly.model_copy(update={"gap": gap}), "P1"))
        assert summed_up(Objective.of(after), [step], PlanLimits(), 0.0).forecast == [pytest.approx(expected)]


def test_a_remainder_at_the_limit_of_noise_disappears_by_chance_about_as_often_as_the_forecast_assumes() -> None:
    """The unit of an excess is the standard deviation of the noise in one release."""
    rng, limit, chances = np.random.default_rng(0), THRESHOLDS.noise_floor, list[float]()
    for recorded in (1, 2, 3):
        excess = limit * recorded**0.5
        of_one = (excess + recorded**0.5 * rng.standard_normal(100_000)) / recorded  # a flat prior of the remainder
        later = (excess + of_one + rng.standard_normal(len(of_one))) / (recorded + 1) ** 0.5
        chances.append(float(np.mean(later < limit)))
    assert chances == pytest.approx([0.05, 0.10, 0.14], abs=0.01)
    assert chances[0] < FORECAST.revealed < chances[-1]


def with_friction(known: Knowledge, pair: tuple[str, str], torque_Nm: float) -> Objective:
    """Return the objective if Coulomb friction is named and the other effect may be the cause instead."""
    params, now = effect_params({pair[0]: {"torque_Nm": torque_Nm}}), known.model.estimate
    model = replace(known.model, estimate=Estimate.of(now.vector[: -len(params)], params, now.initial))
    causes = (Causes(pair[0], dict(zip(pair, (0.64, 0.34), strict=True)), 0.02),)
    return Objective.of(replace(known, model=model, named=frozenset(pair[:1]), causes=causes))


def hidden_torque(known: Knowledge, F: Array) -> float:
    """Return the torque of Coulomb friction at which additional Stribeck friction becomes detectable."""
    named = replace(known, named=frozenset({"coulomb_joint2"}))
    sizes = detectable(named, F, SIGMAS, ["stribeck_joint2"], at_assumed_scale=True)["stribeck_joint2"]
    return min(filter(None, sizes.values())) / CALIBRATION.hidden


@pytest.mark.parametrize(("share", "separates"), [(1.1, True), (0.9, False)])
def test_a_richer_form_is_separated_as_soon_as_its_additional_amplitude_is_detectable(
    share: float, separates: bool, paper: Rig
) -> None:
    """A diagnosis leaves the form out if this amplitude is detectable at half the size of the named effect."""
    known = known_before(paper)
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    F = known.information + swing.information
    objective = with_friction(known, ("coulomb_joint2", "stribeck_joint2"), share * hidden_torque(known, F))
    (d2,), (before,) = objective.separated(F), objective.gained(F)
    assert before[0, 1] < FORECAST.separable
    assert bool(d2[0, 1] > FORECAST.separable) is separates
    assert d2[1, 0] == before[1, 0]


def test_a_plan_keeps_the_release_that_separates_a_richer_form(paper: Rig) -> None:
    """The additional amplitude is detectable only after the third release; then the fourth one is useless."""
    known, pair = known_before(paper), ("coulomb_joint2", "stribeck_joint2")
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    torque = hidden_torque(known, known.information + 52.5 * swing.information)
    recorded = replace(known, information=known.information + 50 * swing.information)
    objective = with_friction(recorded, pair, torque)
    steps = [SequenceStep(swing.release, swing.information, 1.0, 1.0)] * 4
    assert len(worthwhile(objective, steps, PlanLimits())) == 3
    reasons = [release.reason for release in summed_up(objective, steps, PlanLimits(), 0.0).releases]
    assert ["separates" in reason for reason in reasons] == [False, False, True, False]


def test_a_plan_leaves_out_releases_that_inform_only_about_inseparable_causes(paper: Rig) -> None:
    known = known_before(paper)
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    recorded = replace(known, information=known.information + 200 * swing.information)
    objective = with_friction(recorded, ("coulomb_joint2", "air_drag_both"), 1e-5)
    steps = [SequenceStep(swing.release, swing.information, 1.0, 1.0)] * 4
    assert summed_up(objective, steps, PlanLimits(), 0.0).inseparable
    assert len(worthwhile(objective, steps, PlanLimits())) == 2
    assert worthwhile(objective, [], PlanLimits()) == []

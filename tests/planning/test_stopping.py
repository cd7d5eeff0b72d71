"""Stopping rule: causes decided by one release, by a second release, or only by a bench check."""

from dataclasses import replace
from statistics import NormalDist
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.gap.conclusion.causes import to_rule_out
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.result.diagnosis import UNCERTAIN
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.planning.forecast import FORECAST
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import known_before
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import usual_count, worthwhile
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Inseparable, PairBits, PlannedRelease
from dpr_lab.planning.sequence import Planner, SequenceStep
from dpr_lab.planning.stopping import Causes, causes_of, decided, possible, reservation, significance, undecided
from dpr_lab.planning.summary import (
    NOTICEABLE,
    inseparable,
    inseparable_pairs,
    only_ratios_sentence,
    plan_sentence,
    reason_for,
    summed_up,
)
from dpr_lab.planning.worth.criteria import open_bits
from dpr_lab.planning.worth.objective import Gain, Objective
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.report.gap.sections.exclusions import exclusion_words
from dpr_lab.report.gap.tables import effect_table
from dpr_lab.rig import Rig
from tests.one_cause import of_runs, one_cause


@pytest.mark.parametrize(
    ("sizes", "runs", "expected"),
    [
        (20.0, ["P1"], True),
        (6.0, ["P1"], False),
        (6.0, ["P1", "P2"], True),
        (6.0, ["P1 0-10 s", "P1 10-20 s", "P1 20-30 s"], False),  # pieces share the conditions of one release
    ],
)
def test_one_release_decides_a_cause_with_a_margin(sizes: float, runs: list[str], expected: bool) -> None:
    assert decided(of_runs(one_cause(sizes), *runs)) is expected


@pytest.mark.parametrize(("correlation", "expected"), [(0.99, True), (0.0, False)])
def test_correlated_amplitudes_of_an_effect_are_judged_together(correlation: float, expected: bool) -> None:
    """The stiffness and the cubic term of a spring may each be uncertain although the spring is certain."""
    half_width = 1.645 / 2.0
    size = {"value": 1.0, "interval90": [1.0 - half_width, 1.0 + half_width]}
    names = ("stiffness_Nm_per_rad", "cubic_Nm_per_rad3")
    fitted = PosteriorComponent(
        probability=1.0,
        ratios={},
        effects={"spring_joint1": {names[0]: 1.0, names[1]: -1.0}},
        free=["a/b", *(f"spring_joint1.{name}" for name in names)],
        covariance=[[1.0, 0.0, 0.0], [0.0, 0.25, 0.25 * correlation], [0.0, 0.25 * correlation, 0.25]],
    )
    (friction,) = one_cause().effects
    spring = {"name": "spring_joint1", "members": ["spring_joint1"], "parameters": dict.fromkeys(names, size)}
    spring = friction.model_copy(update=spring | {"odds": {"spring_joint1": 1.0}})
    result = of_runs(one_cause().model_copy(update={"effects": [spring], "posterior": [fitted]}), "P1")
    assert significance(result, spring) == pytest.approx(2.0 * np.sqrt(2.0 / (1.0 - correlation)))
    assert decided(result) is expected
    at_bound = fitted.model_copy(update={"covariance": [[1.0, 0.0, 0.0], [0.0, 0.25, 0.0], [0.0, 0.0, 0.0]]})
    bounded = result.model_copy(update={"posterior": [at_bound]})
    assert significance(bounded, spring) == pytest.approx(2.0), "the cubic term has no variance"


def test_the_file_of_an_older_version_counts_releases_by_its_validation() -> None:
    assert [decided(one_cause(6.0, basis=basis)) for basis in ("one release", "held-out runs")] == [False, True]


def test_several_causes_and_no_gap_need_a_second_release() -> None:
    two = one_cause()
    two = two.model_copy(
        update={"effects": [*two.effects, two.effects[0].model_copy(update={"name": "spring_joint1"})]}
    )
    nothing = one_cause(verdict="no_gap", effects=[])
    for diagnosis in (two, nothing):
        for runs, expected in ((["P1"], False), (["P1 0-10 s", "P1 10-20 s"], False), (["P1", "P2"], True)):
            assert decided(of_runs(diagnosis, *runs)) is expected


@pytest.mark.parametrize(
    ("name", "parameter", "sizes", "expected"),
    [
        ("latency_joint2", "delay_s", 3.0, True),
        ("latency_joint2", "delay_s", 3.8, False),
        ("base_vibration", "cos_m_per_s2", 3.8, True),  # the largest of many frequencies
        ("base_vibration", "cos_m_per_s2", 4.2, False),
        ("missed_counts", "counts", 4.2, True),  # does not recur
    ],
)
def test_no_gap_is_decided_only_if_every_effect_is_excluded_at_its_detectable_size(
    name: str, parameter: str, sizes: float, expected: bool
) -> None:
    confidence = NormalDist().cdf(5.0 - sizes)
    tested = Exclusion(effect=name, parameter=parameter, size=5e-4, estimate=1e-4 * sizes, confidence=confidence)
    nothing = of_runs(one_cause(verdict="no_gap", effects=[], advice=[]), "P1", "P2", exclusions=[tested])
    assert decided(nothing) is expected
    assert possible(nothing) == [name] * (not expected)
    assert ("dpr-lab plan" in next_steps(nothing)[0]) is not expected
    listed_in_report = "Not excluded" in " ".join(exclusion_words(nothing))
    assert listed_in_report is (not expected or name == "missed_counts")


def test_a_possible_cause_is_not_listed_as_excluded() -> None:
    names = ("coulomb_joint1", "stribeck_joint1", "base_tilt")
    tested = [Exclusion(effect=name, parameter="x", size=1.0, estimate=0.0, confidence=1.0) for name in names]
    result = of_runs(one_cause(advice=[]), "P1", exclusions=tested)
    (cause,) = result.effects
    twin = cause.model_copy(update={"members": list(names[:2])})
    words = exclusion_words(result.model_copy(update={"effects": [twin], "detectable": {name: {} for name in names}}))
    assert words[0].startswith("Excluded effects of the library: 1.")


def test_a_report_without_excluded_effects_refers_to_no_table() -> None:
    assert (
        exclusion_words(of_runs(one_cause(advice=[]), "P1", exclusions=[]))[0]
        == "No effect of the library is excluded."
    )


@pytest.mark.parametrize(
    ("sizes", "runs", "expected"), [(3.0, ["P1"], True), (4.5, ["P1"], False), (4.5, ["P1", "P2"], True)]
)
def test_a_single_release_decides_a_cause_only_if_every_other_effect_is_excluded(
    sizes: float, runs: list[str], expected: bool
) -> None:
    """A release can show the smaller one of two causes without naming it."""
    confidence = NormalDist().cdf(5.0 - sizes)
    names = ("latency_joint2", "spring_joint2", "base_tilt", "clock_rate")
    tested = [
        Exclusion(effect=name, parameter="amplitude", size=5.0, estimate=sizes + 0.1 * k, confidence=confidence)
        for k, name in enumerate(names)
    ]
    result = of_runs(one_cause(advice=[]), *runs, exclusions=tested)
    assert decided(result) is expected
    assert ("must test clock_rate, base_tilt and 2 others," in undecided(result)) is not expected


def test_enough_names_the_effects_that_are_not_excluded_and_offers_an_optional_release(paper: Rig) -> None:
    """Plan and report state the same about causes that two releases decided."""
    tested = Exclusion(
        effect="spring_joint2", parameter="stiffness_Nm_per_rad", size=1e-5, estimate=9e-6, confidence=0.69
    )
    known = known_before(paper)
    (turn,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    words = "Not excluded at the minimum detectable size: "
    for exclusions, is_listed in (([], False), ([tested], True)):
        two = of_runs(one_cause(advice=[]), "P1", "P2", exclusions=exclusions)
        known = replace(known, diagnosis=two)
        assert usual_count(known) == is_listed
        steps = [SequenceStep(turn.release, turn.information, 1.0, 1.0)] * is_listed
        made = summed_up(Objective.of(known), steps, PlanLimits(), 0.0)
        assert (made.state, made.forecast) == ("enough", [])
        assert (f"(coulomb_joint1). {words}spring_joint2. Optional: record release 1" in made.sentence) is is_listed
        (step,) = next_steps(two)
        assert (f"The causes are decided. {words}" in step) is is_listed
        assert ("No further recording" in step) is not is_listed
    assert "tests the effects that are not excluded yet" in made.releases[0].reason
    open_limit = replace(known, open_limits=("c2/b",))
    made = summed_up(Objective.of(open_limit), steps, PlanLimits(), 0.0)
    assert usual_count(open_limit) == 3
    assert made.sentence.endswith("to test this. Not decided by these recordings: the limits of c2/b.")
    assert not reservation(of_runs(one_cause(), "P1", exclusions=[tested]))  # one release: not decided


@pytest.mark.parametrize(("odds", "rule_out"), [(0.99, False), (0.91, True)])
def test_remedy_stop_and_next_step_agree_on_a_class_that_the_prior_decides(
    odds: float, rule_out: bool, paper: Rig
) -> None:
    """A length error looks like a clock error, which is improbable for a crystal."""
    length, clock = "wrong_length_L1", "clock_rate"
    (cause,) = one_cause(advice=[]).effects
    fields = {"name": length, "members": [length, clock], "odds": {length: odds, clock: 1 - odds}, "probability": 0.98}
    twins = cause.model_copy(update=fields)
    two = of_runs(one_cause(advice=[]).model_copy(update={"effects": [twins]}), "P1", "P2")
    made = summed_up(Objective.of(replace(known_before(paper), diagnosis=two)), [], PlanLimits(), 0.0)
    assert (made.state == "enough") is not rule_out
    assert ("first rule out clock_rate" in to_rule_out(twins)) is rule_out
    words = "excludes clock_rate, because these recordings cannot distinguish it from wrong_length_L1."
    assert (words in made.sentence) is not rule_out
    assert ("Only a small prior probability excludes clock" in next_steps(two)[0]) is not rule_out


def test_a_plan_tests_the_effects_that_keep_no_gap_undecided(paper: Rig) -> None:
    """A turn of joint 2 shows its spring much better than a small swing does."""
    nothing, known = one_cause(verdict="no_gap", effects=[]), known_before(paper)
    swings = [CandidateRelease(np.pi, np.pi + 0.3, 5.0), CandidateRelease(0.3, 5.6, 5.0)]
    small, large = (known.information + swing.information for swing in informed(swings, known.model))
    for sizes, is_open in ((3.0, False), (3.8, True)):
        tested = Exclusion(
            effect="spring_joint2",
            parameter="stiffness_Nm_per_rad",
            size=1e-5,
            estimate=sizes * 2e-6,
            confidence=NormalDist().cdf(5.0 - sizes),
        )
        after_one = replace(known, diagnosis=of_runs(nothing, "P1", exclusions=[tested]))
        assert open_bits(after_one, known.information) == pytest.approx(0.0, abs=1e-12)
        assert bool(open_bits(after_one, large) > 2 * open_bits(after_one, small)) is is_open


@pytest.mark.parametrize(
    ("changed", "question"),
    [({"effects": []}, "cannot show a gap"), ({}, "cannot determine the cause of the gap")],
)
def test_an_inconclusive_diagnosis_leaves_the_question_of_its_verdict(changed: dict[str, Any], question: str) -> None:
    assert undecided(one_cause(verdict="inconclusive", **changed)) == f"the recordings {question}"


@pytest.mark.parametrize("verdict", ["named", "partly_explained"])
def test_a_second_release_tests_the_form_of_an_uncertain_effect_first(verdict: str, paper: Rig) -> None:
    sentence = UNCERTAIN if verdict == "partly_explained" else ""
    result = of_runs(one_cause(verdict=verdict, sentence=sentence), "P1")
    (friction,) = result.effects
    assert not friction.untested, "the file of an older version"
    limited = friction.model_copy(update={"probability": 0.62, "untested": True})
    result = result.model_copy(update={"effects": [limited]})
    question = "a second release must test the form of coulomb_joint1"
    assert undecided(result) == undecided(result, ["coulomb_joint1", "stribeck_joint1"]) == question
    made = summed_up(Objective.of(replace(known_before(paper), diagnosis=result)), [], PlanLimits(), 0.0)
    assert made.state == "record"
    first, *others = next_steps(result)
    assert first.startswith("Record a second release from another angle")
    assert "to test the form of " in first
    assert not any("The causes are uncertain" in step for step in others)
    confirmed = result.model_copy(update={"effects": [limited.model_copy(update={"probability": 0.97})]})
    assert undecided(confirmed) != question, "a bench check has confirmed the effect"
    remainder = result.model_copy(update={"verdict": "partly_explained", "sentence": "A remainder of 9."})
    assert undecided(remainder) == "part of the gap is unexplained"
    assert next_steps(remainder)[0] == first
    described = result.model_copy(update={"hints": ["the clock"]})
    assert not any(step.startswith("Record a second release") for step in next_steps(described))
    assert effect_table(result).rows[0][2] == "62 % (form untested)"


@pytest.mark.parametrize("changed", [{"verdict": "partly_explained"}, {"hints": ["the clock"]}])
def test_a_remainder_or_a_wrong_description_is_never_enough(changed: dict[str, Any]) -> None:
    assert not decided(of_runs(one_cause(**changed), "P1", "P2", "P3"))


def test_inseparable_causes_count_as_one() -> None:
    rival = {"name": "stribeck_joint1", "class": ["stribeck_joint1"], "probability": 0.4, "cosine": 1.0}
    alone = of_runs(one_cause(rivals=[rival | {"instead_of": "coulomb_joint1"}]), "P1", "P2")
    divided = alone.model_copy(update={"effects": [alone.effects[0].model_copy(update={"probability": 0.58})]})
    assert not decided(divided)
    assert decided(divided, {"coulomb_joint1", "stribeck_joint1"})
    assert not decided(divided, {"coulomb_joint1", "spring_joint1"})
    uncertain = divided.model_copy(update={"verdict": "partly_explained", "sentence": UNCERTAIN})
    assert not decided(uncertain)
    assert decided(uncertain, {"coulomb_joint1", "stribeck_joint1"})
    remainder = uncertain.model_copy(update={"sentence": "A remainder has another cause."})
    assert not decided(remainder, {"coulomb_joint1", "stribeck_joint1"})


@pytest.mark.slow
@pytest.mark.parametrize(("probability", "listed"), [(0.947, True), (0.96, False)])
def test_a_cause_just_below_a_decision_gets_its_bench_check(paper: Rig, probability: float, listed: bool) -> None:
    known = known_before(paper)
    candidates = {"encoder_offset_joint1": probability, "base_tilt": 0.98 - probability}
    causes = Causes("encoder_offset_joint1", candidates, 0.02)
    objective = Objective.of(replace(known, causes=(causes,), named=frozenset({"encoder_offset_joint1"})))
    assert len(objective.pairs) == 1
    step = Planner(objective, PlanLimits(), np.random.default_rng(0)).sequence(1, None)
    stuck = inseparable(objective, inseparable_pairs(objective, step))
    assert [pair.causes for pair in stuck] == [("encoder_offset_joint1", "base_tilt")] * listed


@pytest.mark.slow
def test_a_plan_forecasts_a_decision_up_to_causes_that_no_release_separates(paper: Rig) -> None:
    pair = ("encoder_offset_joint1", "base_tilt")
    class_of = {"name": pair[0], "members": list(pair), "odds": dict.fromkeys(pair, 0.5)}
    small = one_cause(8.0)
    result = of_runs(small.model_copy(update={"effects": [small.effects[0].model_copy(update=class_of)]}), "P1")
    (causes,) = causes_of(result)
    known = replace(known_before(paper), causes=(causes,), named=frozenset({pair[0]}), diagnosis=result)
    objective = Objective.of(known)
    steps = Planner(objective, PlanLimits(), np.random.default_rng(0)).sequence(1, None)
    made = summed_up(objective, steps, PlanLimits(), 0.0)
    assert made.state == "record"
    assert made.forecast == [pytest.approx(FORECAST.confirmed, abs=0.02)]
    assert f"A second release must confirm {pair[0]}" in made.sentence
    assert f"decided, except between {pair[0]} and {pair[1]}," in made.sentence


@pytest.mark.parametrize(
    ("only_ratios", "undecided", "words"),
    [
        ((False, True, True), True, "Releases 2 and 3 are necessary only if causes are still undecided before them."),
        ((False, False, True), False, "Release 3 only improves the accuracy of the ratios."),
        ((False, True, True, True), False, "Releases 2 to 4 only improve the accuracy of the ratios."),
        ((True, False, True, True), False, "Releases 1, 3 and 4 only improve the accuracy of the ratios."),
        ((True, True), True, "Releases 1 and 2 only improve the accuracy of the ratios."),
        ((False, False), True, ""),
    ],
)
def test_a_sentence_names_the_releases_that_may_not_be_necessary(
    only_ratios: tuple[bool, ...], undecided: bool, words: str
) -> None:
    reasons = ["" if only else "tests the limits" for only in only_ratios]
    assert only_ratios_sentence(reasons, undecided).strip() == words


def test_the_first_sentence_counts_only_the_releases_that_distinguish_effects() -> None:
    releases = [PlannedRelease.model_construct(library_bits=bits) for bits in (0.97, 0.99, 0.99)]
    reasons = ["distinguishes effects", "verifies the result", ""]
    text = plan_sentence("first", Mock(diagnosis=None), releases, [[]], reasons)
    assert text.startswith("Before any recording: 2 releases are expected to distinguish 99 % of the effects")
    assert text.endswith("Release 3 only improves the accuracy of the ratios.")


@pytest.mark.parametrize(("bits", "answered"), [(0.2, True), (0.01, False)])
def test_a_plan_states_which_check_its_first_release_also_answers(bits: float, answered: bool) -> None:
    causes = ("coulomb_joint1", "stribeck_joint1")
    release = {"theta1_rad": 3.05, "theta2_rad": 3.05, "duration_s": 30.0}
    check = {"id": "1-ab12", "kind": "recording", "text": "Record it.", "about": causes[0], "expected_bits": 0.4}
    diagnosis = of_runs(one_cause(6.0, checks=[check | {"splits": causes, "release": release}]), "P1")
    planned = PlannedRelease.model_construct(decided=0.9, pairs=[PairBits(causes=causes, bits=bits)])
    stuck = [Inseparable(causes=causes, check="Do it.")]
    for inseparable_now in ([], stuck):
        stated = plan_sentence("record", Mock(diagnosis=diagnosis), [planned], [inseparable_now, []], ["separates"])
        answers = "The recording of release 1 is also the result of check 1-ab12 (dpr-lab check)." in stated
        assert answers is (answered and not inseparable_now)


def test_the_first_sentence_lists_each_class_of_inseparable_causes_separately() -> None:
    tilt = [("base_tilt", other) for other in ("encoder_offset_joint1", "com_offset_link1")]
    stuck = [Inseparable(causes=pair, check="") for pair in (*tilt, ("coulomb_joint1", "stribeck_joint1"))]
    planned = PlannedRelease.model_construct(decided=0.9, pairs=[])
    text = plan_sentence("record", Mock(diagnosis=of_runs(one_cause(6.0), "P1")), [planned], [[], stuck], ["separates"])
    classes = "base_tilt, encoder_offset_joint1 and com_offset_link1 and between coulomb_joint1 and stribeck_joint1"
    assert f"decided, except between {classes}, is 0.90" in text


def test_a_release_separates_causes_in_its_reason_only_if_the_plan_counts_them_as_separable(paper: Rig) -> None:
    """Six releases with d^2 = 0.95 do not reach the d^2 of separable causes, although each has 0.05 bits.

    A pair that the first release separates is not inseparable after it, even if the next ones add little.
    """
    pair = ("encoder_offset_joint1", "encoder_drift_joint1")
    class_of = {"name": pair[0], "members": [*pair], "odds": dict.fromkeys(pair, 0.5)}
    effect, known = one_cause().effects[0].model_copy(update=class_of), known_before(paper)
    result = of_runs(one_cause().model_copy(update={"effects": [effect]}), "P1", "P2")
    (swing,) = informed([CandidateRelease(0.3, 5.6, 5.0)], known.model)
    information = known.information + swing.information
    causes = tuple(causes_of(result))
    after = replace(known, information=information, causes=causes, named=frozenset(pair[:1]), diagnosis=result)
    for d2 in (0.95, 100.0):
        step = SequenceStep(swing.release, d2 * CALIBRATION.temperature * swing.information, 1.0, 0.0)
        made = summed_up(Objective.of(after), [step], PlanLimits(), 0.0)
        separates = f"separates {pair[0]} from {pair[1]}" in made.releases[0].reason
        assert made.releases[0].pairs[0].bits > NOTICEABLE.causes
        assert separates is not bool(made.inseparable)
        assert separates is (d2 == 100.0)
        assert "except between" not in made.sentence


@pytest.mark.parametrize(
    ("shares", "words"), [((0.009, 0.987), "distinguishes 99 % of"), ((0.624, 0.676), "distinguishes 6 % more of")]
)
def test_a_reason_agrees_with_the_rounded_shares_of_the_table(shares: tuple[float, float], words: str) -> None:
    before, after = (Gain({}, *np.array([0.0, share, 0.0, 0.0])) for share in shares)
    assert words in reason_for(before, after)


def test_a_plan_leaves_out_releases_without_a_noticeable_benefit(paper: Rig) -> None:
    """A thousandth of the information of a recorded release adds nothing to it; the next one includes its mounting."""
    known, limits = known_before(paper), PlanLimits()
    objective = Objective.of(known)
    swings = [CandidateRelease(0.3, 5.6, 5.0), CandidateRelease(2.0, 0.0, 5.0, mounting="inner")]
    wide, inner = [SequenceStep(one.release, one.information, 1.0, 1.0) for one in informed(swings, known.model)]
    useless, last = [replace(inner, information=factor * inner.information) for factor in (1e-3, 30.0)]
    kept = worthwhile(objective, [wide, wide, useless, last, useless], limits)
    assert [step.information for step in kept] == [wide.information, wide.information, last.information]
    place = limits.minutes.place + 5 / 60
    assert [step.minutes for step in kept] == pytest.approx([place, place, place + limits.minutes.mount])
    assert len(worthwhile(objective, [useless, useless], limits)) == 2

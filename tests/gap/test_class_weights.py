"""Probabilities of classes and alternatives, from given costs."""

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.gap.classes import posterior
from dpr_lab.gap.classes.posterior import (
    Alternative,
    _added_cost,
    _adds_nothing,
    _alternatives,
    _class_members,
    _in_one_class,
    _Replacements,
    effect_posterior,
    outside,
    prior_odds,
    probabilities,
)
from dpr_lab.gap.hypothesis.calibration import CALIBRATION, probability_outside

NAME, INFLATION = "coulomb_joint2", 5.0
UNIT = 2 * INFLATION * CALIBRATION.temperature
"""Difference of cost at which the probability decreases by the factor e."""


@pytest.mark.parametrize(("odds", "probability"), [(1.0, 0.5), (3.0, 0.75), (0.25, 0.2), (0.0, 0.02), (0.01, 0.02)])
def test_odds_of_a_cause_outside_the_library_become_a_probability(odds: float, probability: float) -> None:
    assert probability_outside(odds) == pytest.approx(probability)


def test_alternatives_are_weighted_by_their_costs_and_the_prior_of_a_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weights 1, 1 (no better than the named effect), 1/4, 1/2 times 1/10, and 1/5 without an effect: 2.5 in total."""
    costs = {
        "viscous_ground_link2": -50.0,
        "base_tilt": UNIT * np.log(4.0),
        "friction_drift_joint2": UNIT * np.log(2.0),
        "latency_joint2": UNIT * 40.0,
    }
    alternatives = [Alternative(name, 0.5, 100.0 + cost) for name, cost in costs.items()]
    monkeypatch.setattr(posterior, "_class_members", lambda *_: ({"stribeck_joint2": 0.3}, ("friction_curve_joint2",)))
    monkeypatch.setattr(posterior, "_alternatives", lambda *_: alternatives)
    monkeypatch.setattr(posterior, "prior_odds", lambda _, model, members: 0.1 if "drift" in model else 1.0)
    monkeypatch.setattr(posterior, "outside", lambda *_, **__: 0.2)
    selection: Any = Mock(
        chosen=Mock(priors={NAME: 0.1}, inflation=INFLATION, cost=100.0),
        without={NAME: Mock(key=frozenset())},
        fitted={frozenset({name}): name for name in costs},
        tests_without={NAME: Mock(ranking=[])},
        without_substitute={NAME: Mock(cost_at=lambda inflation: 100.0 + inflation / INFLATION * UNIT * np.log(5.0))},
    )
    result = effect_posterior(selection, NAME)
    assert result.probability == pytest.approx(0.8 / 2.5)
    assert {one.name: one.probability for one in result.alternatives} == pytest.approx(
        {"viscous_ground_link2": 0.8 / 2.5, "base_tilt": 0.2 / 2.5, "friction_drift_joint2": 0.04 / 2.5}
    )
    assert (result.members, result.forms) == ((NAME, "stribeck_joint2"), ("friction_curve_joint2",))
    assert result.odds == pytest.approx((0.25, 0.75))
    selection.without_substitute[NAME].cost_at = lambda _: 50.0  # no effect is at most as probable as the named effect
    assert effect_posterior(selection, NAME).probability == pytest.approx(0.8 / 3.3)


def test_an_alternative_of_two_effects_has_its_larger_probability(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(posterior, "outside", lambda _: 0.1)
    tilt = [Alternative("base_tilt", 0.9, 1.0, probability) for probability in (0.3, 0.05)]
    of_both: Any = (
        Mock(alternatives=tilt[:1], probability=0.6),
        Mock(alternatives=[*tilt[1:], Alternative("latency_joint2", 0.1, 1.0, 0.2)], probability=0.65),
    )
    for one, name in zip(of_both, ("coulomb_joint1", NAME), strict=True):
        one.name = name
    named = {"coulomb_joint1": 0.6, NAME: 0.65, "base_tilt": 0.3, "latency_joint2": 0.2}
    assert probabilities(Mock(), of_both, "named") == {"no_gap": 0.0, "unexplained": 0.1, **named}
    for kind, no_gap in (("no_gap", 0.98), ("inconclusive", 0.5), ("unexplained", 0.02)):
        assert probabilities(Mock(), (), kind) == pytest.approx({"no_gap": no_gap, "unexplained": 1 - no_gap})


def replacements(fitted: dict[frozenset[str], Any] | None = None, **selection: Any) -> _Replacements:
    """Replacements of an effect in a set of two; the selected set has a cost of 100 and an inflation of 5."""
    chosen = Mock(cost=100.0, inflation=INFLATION, chance=30 * INFLATION, key=frozenset({NAME, "base_tilt"}))
    without = Mock(cost=1000.0, key=frozenset({"base_tilt"}), inflation=2.0)
    values: dict[str, Any] = {"chosen": chosen, "without": {NAME: without}, "fitted": fitted or {}, "bare": Mock()}
    return _Replacements(Mock(**values | selection), NAME)


def test_an_alternative_is_an_effect_that_replaces_the_named_one_in_a_fitted_set() -> None:
    """Costs are computed with the inflation of the selected set."""
    names = ("detent_joint1", "latency_joint2", "clock_rate", "spring_joint1", "air_drag_outer")
    keys = {name: frozenset({"base_tilt", name}) for name in names}
    fitted = {
        keys[name]: Mock(key=keys[name], cost_at=lambda inflation, size=size: size * inflation)
        for size, name in enumerate(names[:4], 7)
    }
    test = Mock(cosine=lambda *_: 0.5)
    fields = {"impossible": {keys["clock_rate"]}, "misleading": ("spring_joint1",), "tests_without": {NAME: test}}
    alternatives = _alternatives(
        replacements(fitted, **fields), score(NAME, 1.0), {name: score(name, 1.0) for name in names}
    )
    assert alternatives == [Alternative("detent_joint1", 0.5, 35.0), Alternative("latency_joint2", 0.5, 40.0)]


@pytest.mark.parametrize(("decay", "odds"), [(True, CALIBRATION.drifting), (False, 1.0)])
def test_a_drift_along_one_decay_is_improbable(monkeypatch: pytest.MonkeyPatch, decay: bool, odds: float) -> None:
    monkeypatch.setattr(posterior, "follows_decay", lambda *_: decay)
    key = frozenset({"spring_joint2"})
    assert prior_odds(Mock(chosen=Mock(key=key)), Mock(key=key), ("detent_joint1",)) == odds


@pytest.mark.parametrize(
    ("added", "member", "odds"),
    [
        ("encoder_offset_joint2", "detent_joint1", 10.0),
        ("encoder_offset_joint2", "encoder_offset_joint1", 1.0),
        ("spring_joint2", "detent_joint1", 1.0),
        ("load_friction_joint1", "coulomb_joint1", 0.1),
    ],
)
def test_a_common_effect_is_more_probable(
    monkeypatch: pytest.MonkeyPatch, added: str, member: str, odds: float
) -> None:
    monkeypatch.setattr(posterior, "follows_decay", lambda *_: False)
    selection: Any = Mock(chosen=Mock(key=frozenset({member, "base_tilt"})))
    model: Any = Mock(key=frozenset({added, "base_tilt"}))
    assert prior_odds(selection, model, (member,)) == pytest.approx(odds)


def test_a_richer_form_is_charged_the_indifference_beyond_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(posterior, "form_indifference", lambda *_: 400.0)
    assert _added_cost(replacements(), Alternative("latency_joint2", 0.5, 130.0)) == 30.0
    assert _added_cost(replacements(), Alternative("latency_joint2", 0.5, 70.0)) == -30.0
    assert _added_cost(replacements(), Alternative("stribeck_joint2", 0.5, 130.0)) == 30.0 + 400.0 - 30.0 * 5.0
    assert _added_cost(replacements(), Alternative("stribeck_joint2", 0.5, 70.0)) == 400.0 - 30.0 * 5.0


def score(name: str, gain: float, *nested: str, absorbed: Any = None) -> Any:
    """Score of an effect that contains some simpler forms."""
    effect = Mock(nested=nested)
    effect.name = name
    return Mock(effect=effect, gain=gain, absorbed=absorbed or {})


@pytest.mark.parametrize(
    ("alike", "cost", "gain", "member"),
    [
        (False, 100.0, 500.0, False),
        (True, 109.9, 0.0, True),
        (True, 110.0, 500.0, False),
        (True, None, 490.1, True),  # not fitted: the scores are compared
        (True, None, 490.0, False),
    ],
)
def test_an_effect_with_the_same_signature_and_cost_is_in_the_class(
    monkeypatch: pytest.MonkeyPatch, alike: bool, cost: float | None, gain: float, member: bool
) -> None:
    """The indifference margin is 10."""
    monkeypatch.setattr(posterior, "indifference", lambda *_: 10.0)
    monkeypatch.setattr(posterior, "adds_less_than_remains", lambda *_: False)
    fits = {} if cost is None else {frozenset({"base_tilt", "latency_joint2"}): Mock(cost=cost)}
    test = Mock(indistinguishable=lambda *_: alike)
    of_set = replacements(fits, final_test=Mock(absorbs=lambda *_: False), tests_without={NAME: test})
    named, other = score(NAME, 500.0), score("latency_joint2", gain)
    assert _in_one_class(of_set, named, other) is member
    assert not _in_one_class(of_set, named, score("latency_joint2", gain, NAME))  # a richer form
    if cost is None:
        assert not _in_one_class(of_set, score(NAME, 500.0, "latency_joint2"), other)  # a simpler form
        monkeypatch.setattr(of_set.selection.final_test, "absorbs", lambda *_: True)
        assert _in_one_class(of_set, named, other)
        assert not _in_one_class(of_set, named, score("latency_joint2", 0.0, absorbed={"a": "b"}))
    monkeypatch.setattr(posterior, "adds_less_than_remains", lambda *_: True)
    assert _in_one_class(of_set, score(NAME, 500.0, "latency_joint2"), other)


@pytest.mark.parametrize(
    ("excluded", "cost", "nothing"),
    [([], 200.0, False), ([True, True], 200.0, True), ([True, False], 200.0, False), ([True], 99.0, False)],
)
def test_a_richer_form_adds_nothing_if_all_its_amplitudes_are_excluded(
    monkeypatch: pytest.MonkeyPatch, excluded: list[bool], cost: float, nothing: bool
) -> None:
    monkeypatch.setattr(posterior, "linear_exclusions", lambda *_: [Mock(is_excluded=one) for one in excluded])
    richer = Mock(cost_at=lambda _: cost)
    of_set = replacements({frozenset({"base_tilt", "stribeck_joint2"}): richer}, final_test=Mock(), detectable={})
    monkeypatch.setattr(of_set.selection.chosen, "effects", ("base_tilt", NAME))
    assert _adds_nothing(of_set, "stribeck_joint2") is nothing
    monkeypatch.setattr(of_set.selection.final_test, "best_score", lambda _: None)
    assert not _adds_nothing(of_set, "stribeck_joint2")


@pytest.mark.parametrize("undetectable", [True, False])
def test_undetectably_richer_forms_are_members_and_others_that_add_nothing_are_forms(
    monkeypatch: pytest.MonkeyPatch, undetectable: bool
) -> None:
    """The friction curve was not tested, so it is neither."""
    others = {name: score(name, 1.0) for name in ("stribeck_joint2", "latency_joint2", "air_drag_outer")}
    sizes = {"stribeck_joint2": 0.2, "latency_joint2": 0.4}
    monkeypatch.setattr(posterior, "_in_one_class", lambda _, named, other: other is others["latency_joint2"])
    richer = ("stribeck_joint2", "friction_curve_joint2") if undetectable else ()
    monkeypatch.setattr(posterior, "_undetectably_richer", lambda *_: richer)
    monkeypatch.setattr(posterior, "_adds_nothing", lambda *_: True)
    monkeypatch.setattr(posterior, "_plausibility", lambda _, other: sizes[other.effect.name])
    members, forms = _class_members(replacements(), score(NAME, 1.0), others)
    assert list(members) == (["latency_joint2", "stribeck_joint2"] if undetectable else ["latency_joint2"])
    assert forms == (() if undetectable else ("stribeck_joint2",))


def test_a_compensation_is_possible_unless_every_rig_has_a_member_of_the_class() -> None:
    selection: Any = Mock(
        chosen=Mock(at_noise_floor=False, residuals=Mock(noise_ratio=2.0)),
        share_explained=0.9,
        compensation_odds={NAME: 0.81},
    )
    selection.unique_share = lambda name: 0.5
    unexplained = (0.1 / 0.35) ** 4 * 2.0 + 0.25 * 0.1 / 0.5 * 2.0 / 8.0
    odds = unexplained + 0.81
    assert outside(selection, NAME) == pytest.approx(odds / (1 + odds))
    assert outside(selection, NAME, members=["viscous_ground_link2"]) == pytest.approx(odds / (1 + odds))
    assert outside(selection, NAME, members=["encoder_offset_joint1"]) == pytest.approx(unexplained / (1 + unexplained))

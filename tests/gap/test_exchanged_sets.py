"""Sets of effects that the search has fitted and that lack a named effect reduce its probability."""

from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import pytest

from dpr_lab.gap.which.selected import Selection

SCALE, COGGING, TILT, OFFSET = "encoder_scale_joint1", "detent_joint1", "base_tilt", "encoder_offset_joint2"
ECCENTRICITY, SPRING, DRIFT = "encoder_eccentricity_joint1", "spring_joint1", "encoder_drift_joint1"
CHOSEN = frozenset({SCALE, COGGING, TILT})
REMOVED = 900.0
"""Cost of the selected set without the effect."""


def costing(cost: float) -> Any:
    return Mock(cost=cost, cost_at=lambda _: cost)


def selection(*other: str, cost: float = 120.0, **fields: Any) -> Selection:
    """Result of a search that selected `CHOSEN` at a cost of 100 and also fitted one other set."""
    chosen = Mock(key=CHOSEN, cost=100.0, inflation=1.0)
    nothing: Any = dict.fromkeys(("bare", "final_test", "detectable", "without", "tests_without", "own_shares", "path"))
    fitted = {frozenset(other): costing(cost)}
    without: Any = {SCALE: costing(REMOVED)}
    return Selection(chosen=chosen, fitted=fitted, without_substitute=without, **nothing, **fields)


def test_an_exchange_of_several_effects_is_evidence_against_each_of_them() -> None:
    assert selection(COGGING, ECCENTRICITY).cost_without(SCALE) == 120.0


@pytest.mark.parametrize(
    ("other", "fields"),
    [
        ((SCALE, ECCENTRICITY), {}),  # it contains the effect
        ((COGGING, TILT, SPRING), {}),  # a single effect replaces it: an alternative
        ((COGGING, SPRING), {"cost": 99.0}),  # a rule of the search has rejected it
        ((COGGING, SPRING), {"impossible": frozenset({frozenset({COGGING, SPRING})})}),
        ((COGGING, SPRING), {"misleading": (SPRING,)}),
        ((COGGING, SPRING, OFFSET, DRIFT), {"max_effects": 3}),
    ],
)
def test_other_sets_do_not_count(other: tuple[str, ...], fields: dict[str, Any]) -> None:
    assert selection(*other, **fields).cost_without(SCALE) == REMOVED


def test_known_effects_of_the_rig_do_not_count_as_effects_of_an_exchange() -> None:
    larger = selection(COGGING, SPRING, OFFSET, DRIFT, max_effects=3, expected=frozenset({OFFSET}))
    assert larger.cost_without(SCALE) == 120.0


def test_a_simpler_form_with_another_effect_is_evidence_against_the_richer_form() -> None:
    simple = "encoder_offset_joint1"
    fitted: Any = {frozenset({simple, SCALE}): costing(120.0)}
    without: Any = {DRIFT: costing(REMOVED)}
    chosen: Any = Mock(key=frozenset({DRIFT}), cost=100.0, inflation=1.0)
    richer = replace(selection(), chosen=chosen, fitted=fitted, without_substitute=without)
    assert richer.cost_without(DRIFT) == 120.0
    assert richer.cost_without(DRIFT, [simple]) == REMOVED  # both forms are one class


@pytest.mark.parametrize("member", [DRIFT, "encoder_offset_joint1"])
def test_a_member_of_the_class_and_its_richer_form_count_as_the_effect(member: str) -> None:
    exchanged = selection(COGGING, DRIFT)
    assert exchanged.cost_without(SCALE) == 120.0
    assert exchanged.cost_without(SCALE, [member]) == REMOVED

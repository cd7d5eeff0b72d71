"""Probabilities of classes and alternatives, from given costs."""

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.gap.classes import posterior
from dpr_lab.gap.classes.posterior import CALIBRATION, Alternative, effect_posterior, probabilities, probability_outside

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
    monkeypatch.setattr(posterior, "_prior_odds", lambda _, other: 0.1 if "drift" in other else 1.0)
    monkeypatch.setattr(posterior, "plausibility", lambda *_: 0.1)
    monkeypatch.setattr(posterior, "outside", lambda *_, **__: 0.2)
    selection: Any = Mock(
        chosen=Mock(fit=Mock(estimate=Mock(params=effect_params({}))), residuals=Mock(inflation=INFLATION), cost=100.0),
        without={NAME: None},
        tests_without={NAME: Mock(ranking=[])},
        without_substitute={NAME: Mock(cost=100.0 + UNIT * np.log(5.0))},
    )
    result = effect_posterior(selection, NAME)
    assert result.probability == pytest.approx(0.8 / 2.5)
    assert {one.name: one.probability for one in result.alternatives} == pytest.approx(
        {"viscous_ground_link2": 0.8 / 2.5, "base_tilt": 0.2 / 2.5, "friction_drift_joint2": 0.04 / 2.5}
    )
    assert (result.members, result.forms) == ((NAME, "stribeck_joint2"), ("friction_curve_joint2",))
    assert result.odds == pytest.approx((0.25, 0.75))


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

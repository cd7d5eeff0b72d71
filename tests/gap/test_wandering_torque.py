"""A torque that wanders is no law with constant parameters: the sets of effects compete with it."""

from collections.abc import Callable
from typing import Any

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes.posterior import effect_posterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.wandering import WANDERING, wandering
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.search import SearchState, apply
from dpr_lab.gap.which.select import forward, refined
from dpr_lab.gap.which.wandering_torque import WANDERING_TORQUE
from tests.background_rigs import law, recordings

FRICTION, WRONG = "coulomb_joint1", "encoder_eccentricity_joint1"


@pytest.fixture(scope="module")
def sets(bare: Callable[..., Any], screened: Callable[..., Any]) -> FittedSets:
    """A rod with friction and a torque that wanders; friction and an encoder error to choose from."""
    rig, runs, _ = recordings(7, [law("coulomb", 0, 3.6), law("wander", 0, 0.7, 7)], rods=1)
    problem, base = bare(runs, rig)
    library = {name: EFFECTS[name] for name in (FRICTION, WRONG)}
    return FittedSets(screened(runs, rig), problem, library, base, lambda event: None)


def with_one(sets: FittedSets, name: str) -> Hypothesis:
    score = sets.test(sets.bare).of(name)
    assert score is not None
    return sets.with_one(sets.bare, score)


@pytest.mark.slow
def test_a_wandering_torque_is_likelier_than_a_law_that_follows_it(sets: FittedSets) -> None:
    right, wrong = with_one(sets, FRICTION), with_one(sets, WRONG)
    assert wrong.residuals.chi2 < right.residuals.chi2  # independent residuals prefer the encoder error
    torques = wandering(sets.problem, wrong)
    assert torques is not None
    assert torques.cost(wrong) == torques.least_cost(wrong)
    assert WANDERING.levels[torques.levels[0]] > 1.0  # more than the noise
    assert torques.least_cost(right) < torques.least_cost(sets.bare) < torques.least_cost(wrong)


@pytest.mark.slow
def test_the_search_replaces_a_law_that_follows_a_wandering_torque(sets: FittedSets) -> None:
    wrong = with_one(sets, WRONG)
    with_one(sets, FRICTION)
    last = apply(WANDERING_TORQUE, sets, SearchState(wrong, sets.fits, sets.tests, 4))
    assert last.current.effects == (FRICTION,)
    assert "likelier where torques wander" in last.trace[-1].reason


@pytest.mark.slow
def test_an_effect_that_only_follows_a_wandering_torque_is_improbable(sets: FittedSets) -> None:
    library = {WRONG: EFFECTS[WRONG]}
    selection = refined(forward(sets.recordings, sets.problem, sets.bare, library))
    posterior = effect_posterior(selection, WRONG)
    assert posterior.probability < 1e-4
    assert posterior.outside > 0.99


@pytest.mark.slow
def test_without_a_residual_no_torque_wanders(bare: Callable[..., Any]) -> None:
    rig, runs, _ = recordings(8, [], rods=1)
    assert wandering(*bare(runs, rig)) is None

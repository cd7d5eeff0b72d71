"""Posterior of sets of effects: weights follow the costs, and no set is more probable than the selected set."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace as Fake
from typing import Any, cast
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.gap.classes.posterior import _undetectably_richer, effect_posterior, outside
from dpr_lab.gap.conclusion.components import components
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import comparable_size
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.select import forward, refined
from dpr_lab.gap.which.selected import Selection
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests.background_rigs import law, recordings

OTHER = frozenset({"air_drag_outer"})


def costing(model: Hypothesis, cost: float) -> Hypothesis:
    """The same fit with another predictive cost."""
    return replace(model, predictive_loss=model.predictive_loss + cost - model.cost)


@pytest.mark.slow
def test_a_set_of_lower_cost_is_as_probable_as_the_selected_one_at_most(
    paper: Rig, bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    runs = recorded({"coulomb_joint2": {"torque_Nm": 2e-3}}, duration=2.0)
    problem, base = bare(runs)
    library = {name: EFFECTS[name] for name in ("coulomb_joint2", "air_drag_outer", "base_tilt")}
    fitted_sets = FittedSets(screened(runs), problem, library, base)
    result = refined(forward(fitted_sets))
    chosen = result.chosen
    assert chosen.effects == ("coulomb_joint2",)
    unit = 2 * chosen.inflation * CALIBRATION.temperature
    drag = replace(chosen, effects=tuple(OTHER), curves={})
    worse, other = (costing(drag, chosen.cost + sign * np.log(4.0) * unit) for sign in (1, -1))

    def weighed(selection: Selection) -> list[PosteriorComponent]:
        fitted: Any = Fake(problem=problem, recordings=Fake(rig=paper))
        state: Any = Fake(fitted=fitted, selection=selection, remainder=None)
        return components(state)

    def of(selection: Selection) -> dict[frozenset[str], float]:
        return {frozenset(one.effects): one.probability for one in weighed(selection)}

    both = replace(result, fitted={chosen.key: chosen, OTHER: other})
    for fitted, expected in ((worse, [0.8, 0.2]), (other, [0.5, 0.5])):  # the other is not significantly better
        made = weighed(replace(both, fitted={chosen.key: chosen, OTHER: fitted}))
        assert [one.probability for one in made] == pytest.approx(expected)
    gap = replace(base.residuals, chi2=1e4 * base.residuals.dof, autocorrelation=0.99)
    lacking = costing(replace(base, residuals=gap), chosen.cost + 20 * unit + gap.inflation * base.penalty)
    assert lacking.cost_at(gap.inflation) < chosen.cost_at(gap.inflation)
    assert of(replace(result, fitted={chosen.key: chosen, lacking.key: lacking})) == {chosen.key: 1.0}
    drifting = replace(both, fitted={chosen.key: chosen, OTHER: replace(other, decay_drifts=OTHER)})
    assert [one.probability for one in weighed(drifting)] == pytest.approx([1 / 1.4, 0.4 / 1.4])  # 0.1 * 4
    impossible = replace(both, impossible=frozenset({OTHER}))
    assert of(impossible) == {chosen.key: 1.0}
    larger = costing(replace(chosen, effects=(*chosen.effects, "base_tilt")), chosen.cost - unit)
    weights = [one.probability for one in weighed(replace(result, fitted={larger.key: larger}))]
    assert max(weights) == weights[0] > 0.9  # what hundreds of candidates explain by chance is no evidence


@pytest.mark.slow
def test_a_richer_form_of_the_named_effect_is_no_alternative_if_it_may_follow_the_integrator(
    bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    runs = recorded({"coulomb_joint2": {"torque_Nm": 2e-3}}, duration=2.0)
    problem, base = bare(runs)
    name, richer = "coulomb_joint2", "friction_curve_joint2"
    fitted_sets = FittedSets(screened(runs), problem, {each: EFFECTS[each] for each in (name, richer)}, base)
    result = refined(forward(fitted_sets))
    chosen = result.chosen
    assert chosen.effects == (name,)
    better = costing(replace(chosen, effects=(richer,), curves={}), chosen.cost - 20 * chosen.inflation)
    near, far = (
        replace(result, bare=replace(base, residuals=replace(base.residuals, chi2=chi2)), fitted={better.key: better})
        for chi2 in (chosen.residuals.chi2 + 1e3, 1e8)
    )
    (alternative,) = effect_posterior(near, name).alternatives
    assert effect_posterior(far, name).alternatives == ()  # of probability zero
    named = effect_posterior(near, name).probability
    assert alternative.probability == pytest.approx(0.1 * named)  # the prior odds against a common effect
    assert effect_posterior(far, name).probability > 0.95


@pytest.mark.slow
def test_an_effect_that_every_rig_has_compensates_for_nothing(
    bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    runs = recorded({"coulomb_joint2": {"torque_Nm": 2e-3}}, duration=2.0)
    problem, base = bare(runs)
    name = "coulomb_joint2"
    fitted_sets = FittedSets(screened(runs), problem, {name: EFFECTS[name]}, base)
    result = replace(refined(forward(fitted_sets)), compensation_odds={name: 0.81})
    assert outside(result, name) > 0.4
    assert outside(result, name, members=("encoder_offset_joint2",)) == CALIBRATION.outside_when_closed


@pytest.mark.slow
def test_a_drift_of_rate_zero_is_no_separate_cause(
    bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    """Such a drift fits as well as the offset, or the tilt, and costs one parameter for any number of releases."""
    tilt, offset, drift = "base_tilt", "encoder_offset_joint1", "encoder_drift_joint1"
    runs = recorded({offset: {"offset_rad": 0.01}}, duration=2.0)
    problem, base = bare(runs)
    library = {name: EFFECTS[name] for name in (tilt, offset, drift)}
    fitted_sets = FittedSets(screened(runs), problem, library, base, expected=frozenset({tilt}))
    result = refined(forward(fitted_sets))
    assert result.chosen.effects == (tilt,)
    for lower, forms in ((0.0, (drift,)), (1.0, ())):
        of_drift = replace(result.chosen, effects=(drift,), curves={}, priors={drift: 1.0})
        drifting = costing(of_drift, result.chosen.cost - lower)
        posterior = effect_posterior(replace(result, fitted={**result.fitted, frozenset({drift}): drifting}), tilt)
        assert posterior.forms == forms
        assert set(posterior.members) == {tilt, offset} | ({drift} - {*forms})
        assert posterior.alternatives == ()


@pytest.mark.slow
def test_both_forms_are_in_the_class_if_the_richer_one_adds_less_than_remains() -> None:
    rig, runs, _ = recordings(2, [law("encoder_offset", 0, 5.0), law("wander", 0, 0.5, 2)], rods=1)
    names = ("encoder_drift_joint1", "encoder_offset_joint1")  # the wandering torque is in no library
    named = diagnose(runs, rig, library={name: EFFECTS[name] for name in names}).effects
    assert [sorted(effect.members) for effect in named] == [sorted(names)]


def test_a_drift_is_compared_with_an_offset_by_their_typical_sizes() -> None:
    """5 mrad correspond to 0.5 mrad/s, so a drift of 1 mrad/s that is undetectable is in the class of the offset."""
    offset, drift = EFFECTS["encoder_offset_joint1"], EFFECTS["encoder_drift_joint1"]
    params = effect_params({"encoder_offset_joint1": {"offset_rad": 5e-3}})
    assert [comparable_size(params, offset, p) for p in drift.amplitudes] == pytest.approx([5e-3, 5e-4])
    chosen = Mock(estimate=Mock(params=params))
    selection = Mock(chosen=chosen, final_test=Mock(ranking=[Mock(effect=drift)]))
    half = CALIBRATION.hidden * comparable_size(params, offset, drift.amplitudes[1])
    for rate, richer in ((1e-3, (drift.name,)), (2e-4, ()), (half, ())):
        selection.detectable = {drift.name: {"offset_rad": None, "rate_rad_per_s": rate}}
        assert _undetectably_richer(selection, offset) == richer


def test_an_effect_that_the_fit_without_it_cannot_show_has_no_alternatives() -> None:
    """Orders of cogging are proposed for the arc that the fitted swing covers, which is shorter in another fit."""
    name = "detent_joint1"
    selection = Mock(
        chosen=Mock(priors={name: 0.9}, inflation=1.0, cost=10.0, at_noise_floor=True),
        without={name: None},
        tests_without={name: ScoreTest(*[cast(Any, None)] * 5)},
        without_substitute={name: Mock(cost_at=lambda _: 1000.0)},
        compensation_odds={},
        share_explained=1.0,
    )
    selection.unique_share.return_value = 1.0
    posterior = effect_posterior(selection, name)
    assert (posterior.members, posterior.alternatives, posterior.odds) == ((name,), (), (1.0,))
    assert posterior.probability == pytest.approx(1 - CALIBRATION.outside_when_closed)

"""Fit of the common effects alone, for diagnoses without a claimed cause."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import SimpleNamespace as Fake
from typing import Any

import pytest

from dpr_lab.effects import without_effect
from dpr_lab.gap.conclusion import common_fit as module
from dpr_lab.gap.conclusion.causes import effect_sizes
from dpr_lab.gap.conclusion.common_fit import CommonSet, common_fit, common_note
from dpr_lab.gap.hypothesis.refits import refit
from dpr_lab.gap.result.causes import CommonEffect
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.run import Run

ZERO, FRICTION = "encoder_offset_joint2", "coulomb_joint2"
TESTED = frozenset({ZERO, FRICTION, "encoder_offset_joint1", "air_drag_outer", "spring_joint2"})


described = partial(effect_sizes, Scale(b=0.005, interval90=(0.004, 0.006), fixed_by="bound"))


@pytest.fixture(scope="module")
def state(
    paper: Rig, bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> Any:
    """State of a diagnosis that selected no effect, of a rig with a zero error and dry friction."""
    runs = recorded({ZERO: {"offset_rad": 0.02}, FRICTION: {"torque_Nm": 2e-3}}, duration=1.0)
    problem, model = bare(runs)
    return Fake(
        fitted=Fake(problem=problem, recordings=screened(runs), request=Fake(rig=paper)),
        selection=Fake(bare=model, chosen=model, final_test=Fake(tested=TESTED), fitted={}),
        posteriors=(),
        description=Fake(withholds=False),
    )


def test_without_a_claimed_cause_the_common_effects_have_their_sizes_and_shares(state: Any) -> None:
    fit = common_fit("unexplained", state, described)
    assert fit is not None
    assert {effect.name for effect in fit} == {ZERO, FRICTION}
    assert 0.04 < fit[0].share < fit[1].share
    assert fit[1].share > 0.99
    sizes = {name: size for effect in fit for name, size in effect.parameters.items()}
    for name, true in {"offset_rad": 0.02, "torque_Nm": 2e-3}.items():
        low, high = sizes[name].interval90
        assert low < sizes[name].value < high
        assert sizes[name].value == pytest.approx(true, rel=0.2)  # at the inertia of the rig file


def test_an_effect_that_a_later_step_moves_to_zero_is_left_out(state: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    effects = ("coulomb_joint1", ZERO, FRICTION)
    model = refit(state.fitted.problem, state.selection.bare.estimate, effects, iterations=5)
    zero = model.estimate.changed(params=without_effect(model.estimate.params, "coulomb_joint1"))
    model = replace(model, fit=replace(model.fit, estimate=zero))
    monkeypatch.setattr(module, "common_steps", lambda *_: [CommonSet(model, (name,)) for name in effects])
    fit = common_fit("unexplained", state, described)
    assert fit is not None
    assert [effect.name for effect in fit] == [ZERO, FRICTION]


def test_the_fit_is_omitted_if_a_cause_is_claimed_or_no_gap_is_visible(state: Any) -> None:
    def shown(kind: Any, *causes: tuple[float, bool], **other: Any) -> bool:
        posteriors = tuple(Fake(probability=p, untested=untested) for p, untested in causes)
        changed: Any = Fake(**vars(state) | {"posteriors": posteriors} | other)
        return common_fit(kind, changed, described) is not None

    few = Fake(**vars(state.selection) | {"final_test": Fake(tested=frozenset({"spring_joint2"}))})
    assert shown("too_short", (0.49, False), selection=few)
    assert shown("partly_explained", (0.63, True), selection=few)  # the form of the only claimed cause is untested
    assert not shown("partly_explained", (0.5, False), selection=few)
    assert not shown("named", (0.64, True), (0.98, False), selection=few)
    assert not shown("no_gap", selection=few)
    assert not shown("inconclusive", selection=few)
    assert not shown("unexplained", selection=few, description=Fake(withholds=True))


def test_the_note_states_cumulative_shares_and_confirms_no_cause() -> None:
    members = {ZERO: [ZERO, "base_tilt"], FRICTION: [FRICTION]}
    first, second = (
        CommonEffect.model_validate({"name": name, "class": members[name], "parameters": {}, "share": share})
        for name, share in ((ZERO, 0.44), (FRICTION, 0.72))
    )
    assert common_note([]) == "Fit of the common effects alone: no fitted effect explains more than 4 % of the excess."
    assert common_note([first, second]) == (
        f"Fit of the common effects alone: {ZERO} or base_tilt explains 44 % of the excess; with {FRICTION} added,"
        " 72 %. This fit does not confirm a cause."
    )

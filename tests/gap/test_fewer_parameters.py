"""Of two sets that explain about the same, the one with fewer parameters is preferred."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics
from dpr_lab.gap.hypothesis.significance import explains_as_much
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which import replacements, select
from dpr_lab.gap.which.compensations import _smallest_own_share, compensation_odds
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.forms import own_share
from dpr_lab.gap.which.removals import DROP, SMALLEST_ADEQUATE
from dpr_lab.gap.which.replacements import LARGER_PRIOR, SEVERAL_CAUSES
from dpr_lab.gap.which.restarts import escaped
from dpr_lab.gap.which.search import Decision, Move, Proposal, SearchState, apply_move
from tests.background_rigs import law, recordings

SCALE, COGGING, LENGTH, FRICTION = "encoder_scale_joint1", "detent_joint1", "wrong_length_L1", "coulomb_joint1"
HYSTERESIS = "hysteresis_joint1"


@pytest.fixture(scope="module")
def fitted(bare: Callable[..., Any], screened: Callable[..., Any]) -> Callable[..., FittedSets]:
    """(laws, effects, rods, L1 relative to the true one) -> sets of these effects; only the bare model is fitted."""

    def sets_of(laws: Any, effects: Any, rods: int = 1, length: float = 1.0) -> FittedSets:
        rig, runs, _ = recordings(5, laws, rods=rods)
        rig = rig.model_copy(update={"rig": rig.rig.model_copy(update={"L1": length * rig.L1})})
        problem, base = bare(runs, rig)
        return FittedSets(screened(runs, rig), problem, {n: EFFECTS[n] for n in effects}, base)

    return sets_of


def grown(fitted_sets: FittedSets, *effects: str) -> Hypothesis:
    """The set of some effects, added one by one."""
    model = fitted_sets.bare
    for name in effects:
        score = fitted_sets.test(model).best_score(name)
        assert score is not None
        model = fitted_sets.with_one(model, score)
    return escaped(fitted_sets, model)


@pytest.mark.slow
def test_a_curve_that_follows_a_scale_error_does_not_displace_it(fitted: Callable[..., FittedSets]) -> None:
    fitted_sets = fitted([law("encoder_scale", 0, 9.0), law("third", 0, 0.5), law("wander", 0, 0.5)], (COGGING, SCALE))
    both = grown(fitted_sets, COGGING, SCALE)
    curve, scale = fitted_sets.without(both, SCALE), fitted_sets.without(both, COGGING)
    assert not both.at_noise_floor
    own = own_share(fitted_sets.problem, curve, fitted_sets.test(curve), SCALE)
    assert own is not None
    assert own < THRESHOLDS.own_share  # free functions in place of the cogging follow the scale error
    assert explains_as_much(fitted_sets.bare, scale, curve)
    assert not explains_as_much(fitted_sets.bare, curve, scale)
    assert odds_against(fitted_sets, both)[COGGING] > 1
    assert odds_against(fitted_sets, both).get(SCALE, 0.0) < 0.3


@pytest.mark.slow
def test_a_real_curve_stays(fitted: Callable[..., FittedSets]) -> None:
    fitted_sets = fitted([law("detent", 0, 6.0), law("encoder_scale", 0, 0.5), law("wander", 0, 0.5)], (COGGING, SCALE))
    both = grown(fitted_sets, COGGING, SCALE)
    assert odds_against(fitted_sets, both).get(COGGING, 0.0) < 0.1


def odds_against(fitted_sets: FittedSets, model: Hypothesis) -> dict[str, float]:
    """The odds that the effects of a set are compensations."""
    return compensation_odds(fitted_sets, model, {name: fitted_sets.without(model, name) for name in model.effects})


@pytest.mark.slow
def test_effects_are_compared_with_the_gap_that_the_right_length_leaves(fitted: Callable[..., FittedSets]) -> None:
    fitted_sets = fitted([law("coulomb", 0, 5.0)], (LENGTH, FRICTION), rods=2, length=1.01)
    both = grown(fitted_sets, LENGTH, FRICTION)
    assert fitted_sets.corrected_bare(both).effects == (LENGTH,)
    assert fitted_sets.corrected_bare(fitted_sets.without(both, LENGTH)) is fitted_sets.bare


@pytest.mark.slow
def test_wrong_counts_per_turn_do_not_make_another_cause_look_negligible(fitted: Callable[..., FittedSets]) -> None:
    laws = [law("encoder_scale", 0, 300.0), law("coulomb", 0, 10.0), law("third", 0, 1.0), law("wander", 0, 1.0)]
    fitted_sets = fitted(laws, (SCALE, FRICTION))
    both = grown(fitted_sets, SCALE, FRICTION)
    scale = fitted_sets.without(both, FRICTION)
    assert not both.at_noise_floor
    assert scale.bounded_excess < THRESHOLDS.necessary_factor * both.bounded_excess
    assert scale.bounded_excess - both.bounded_excess < THRESHOLDS.large * fitted_sets.bare.bounded_excess
    for move in (SMALLEST_ADEQUATE, DROP):
        assert apply_move(move, SearchState(both, fitted_sets, 4)).current.effects == (SCALE, FRICTION)


def set_without_compensation(
    monkeypatch: pytest.MonkeyPatch, chosen: Hypothesis, *others: Hypothesis
) -> frozenset[str] | None:
    """The set without the first compensation, if the own share of every effect is small; None without one."""
    monkeypatch.setattr("dpr_lab.gap.which.compensations.own_share", lambda *_: 0.03)
    monkeypatch.setattr("dpr_lab.gap.which.compensations.explains_as_much", lambda *_: False)
    bare = stated(5.5e6, 3)
    fits = {model.key: model for model in (bare, chosen, *others)}
    fitted = {key: model for key, model in fits.items() if not key < chosen.key}  # the smaller sets are fitted later
    fitted_sets = SimpleNamespace(fits=fitted, bare=bare, library=EFFECTS, problem=None, test=lambda model: None)

    def without(model: Hypothesis, name: str) -> Hypothesis:
        key = model.key - {name}
        return fitted.setdefault(key, fits[key])

    fitted_sets.unexpected, fitted_sets.as_possible = lambda model: list(model.effects), lambda model, other: True
    fitted_sets.possible, fitted_sets.without = lambda model: True, without
    smallest = _smallest_own_share(cast(Any, fitted_sets), chosen)
    return None if smallest is None else smallest[0].key


def stated(chi2: float, parameters: int, *effects: str) -> Hypothesis:
    """A fitted set with stated chi2 and number of parameters."""
    fit = SimpleNamespace(free=range(parameters), chi2=chi2)
    residuals = ResidualStatistics(chi2, dof=400, level=1.0, autocorrelation=0.0)
    return Hypothesis(effects, cast(Any, fit), residuals, chi2, {})


def test_an_effect_is_no_compensation_if_a_richer_form_that_explains_less_would_replace_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drift, richer = "encoder_drift_joint1", "friction_curve_joint1"
    fitted_sets = stated(1.33e5, 6, FRICTION, drift), stated(1.4e6, 5, drift), stated(6.7e5, 4, FRICTION)
    assert set_without_compensation(monkeypatch, *fitted_sets) == frozenset({drift})
    assert set_without_compensation(monkeypatch, *fitted_sets, stated(1.42e5, 13, richer)) is None
    assert set_without_compensation(monkeypatch, *fitted_sets, stated(6e4, 13, richer)) == frozenset({drift})


def test_no_effect_is_a_compensation_if_a_curve_that_explains_less_would_replace_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scale, offset, curve = "encoder_scale_joint2", "encoder_offset_joint1", "encoder_eccentricity_joint1"
    all_three = stated(4200.0, 6, scale, offset, SCALE)
    smaller = stated(4.2e4, 5, offset, SCALE), stated(4.1e4, 5, scale, offset), stated(4e4, 5, scale, SCALE)
    assert set_without_compensation(monkeypatch, all_three, *smaller) == smaller[0].key
    returned = stated(1e4, 9, scale, curve)
    assert set_without_compensation(monkeypatch, all_three, *smaller, returned) is None
    last = stated(9e3, 5, scale, offset)  # the set that is fitted last is better than the curve
    assert set_without_compensation(monkeypatch, all_three, smaller[0], last, returned) == smaller[0].key
    fewer = stated(1e4, 5, scale, curve)
    assert set_without_compensation(monkeypatch, all_three, *smaller, fewer) == smaller[0].key


def sets_of(*models: Hypothesis, impossible: frozenset[str] = frozenset()) -> Any:
    """Fitted sets with stated results; the set `impossible` has a size that is typical of another cause."""
    fits = {model.key: model for model in models}
    fitted_sets = SimpleNamespace(fits=fits, bare=models[0], library=EFFECTS, expected=frozenset())
    fitted_sets.corrected_bare, fitted_sets.unexpected = lambda model: models[0], lambda model: list(model.effects)
    fitted_sets.without = fitted_sets.without_substitute = lambda model, name: fits[model.key - {name}]
    fitted_sets.as_possible = lambda model, other: model.key != impossible or other.key == impossible
    fitted_sets.imitating = lambda model: model.effects if model.key == impossible else ()
    return fitted_sets


def test_no_removal_leads_to_a_size_that_is_typical_of_another_cause() -> None:
    spring = "spring_joint1"
    models = stated(1e6, 3), stated(410.0, 6, spring, SCALE), stated(400.0, 5, spring), stated(2e4, 4, SCALE)
    for move in (SMALLEST_ADEQUATE, DROP):
        (free,) = move.propose(sets_of(*models), models[1])
        assert free.model.effects == (spring,)
        proposed = list(move.propose(sets_of(*models, impossible=frozenset({spring})), models[1]))
        assert [proposal.model.effects for proposal in proposed] == ([(SCALE,)] if move is DROP else [])


@pytest.mark.parametrize(
    ("parameters", "effect", "tests", "proposed"),
    [(6, SCALE, 0, []), (5, SCALE, 1, [(SCALE,)]), (4, HYSTERESIS, 1, []), (3, HYSTERESIS, 1, [(HYSTERESIS,)])],
    ids=["no room", "room for one", "no room for a shape", "room for a shape"],
)
def test_only_effects_with_one_amplitude_replace_a_curve_and_only_if_parameters_are_saved(
    parameters: int, effect: str, tests: int, proposed: list[tuple[str, ...]]
) -> None:
    """The set with the curve has seven parameters, and the set without it `parameters`; a shape counts twice."""
    current, smaller = replace(stated(400.0, 6, COGGING), curves={COGGING: 0.0}), stated(9e3, parameters)
    drift, other = (SimpleNamespace(effect=EFFECTS[name], columns=range(n), gain=4e3)
                    for name, n in (("encoder_drift_joint1", 2), (effect, 1)))  # fmt: skip
    fitted_sets, tested = sets_of(smaller, current), list[Hypothesis]()
    fitted_sets.possible = lambda model: True
    fitted_sets.test = lambda model: tested.append(model) or SimpleNamespace(ranking=[drift, other])
    fitted_sets.with_one = lambda model, score: stated(
        300.0, len(model.fit.free) + len(score.effect.parameters), *model.effects, score.effect.name
    )
    assert current.parameters == 7
    assert [proposal.model.effects for proposal in SEVERAL_CAUSES.propose(fitted_sets, current)] == proposed
    assert len(tested) == tests


@pytest.mark.parametrize(
    ("replacing", "ratio", "start"),
    [
        ("stribeck_joint1", 1.0, "the richer form is not needed, because it explains about as much"),
        ("stribeck_joint1", 1e6, "indistinguishable"),
        (SCALE, 1.0, "indistinguishable"),
    ],
)
def test_a_rejected_richer_form_is_not_called_indistinguishable(replacing: str, ratio: float, start: str) -> None:
    """The table of effects lists no indistinguishable effect if the additional term of the richer form is excluded."""
    current, proposed = (cast("Hypothesis", SimpleNamespace(key=frozenset({name}))) for name in (FRICTION, replacing))
    decision = LARGER_PRIOR.accept(cast("FittedSets", None), current, Proposal(proposed, ratio))
    assert decision.accepted is (ratio > THRESHOLDS.tie)
    assert decision.reason.startswith(f"{start}; the ratio")


@pytest.mark.parametrize(
    ("current", "replacing", "ratio", "accepted"),
    [
        ("base_tilt", "encoder_offset_joint1", 0.9, True),
        ("encoder_offset_joint1", "base_tilt", 1.1, False),
        ("wrong_length_L1", "base_tilt", 1.0, True),
        ("base_tilt", "encoder_offset_joint1", 0.1, False),
        ("encoder_offset_joint1", "base_tilt", 10.0, True),
        ("com_offset_link1", SCALE, 1.0, False),
        ("com_offset_link1", SCALE, 1.6, True),
        ("base_tilt", "encoder_offset_joint1", 0.6, False),
    ],
)
def test_two_indistinguishable_common_effects_have_a_fixed_order(
    current: str, replacing: str, ratio: float, accepted: bool
) -> None:
    """Otherwise rounding decides which of them is named. The more probable effect is named if it is no tie."""
    before, proposed = (cast("Hypothesis", SimpleNamespace(key=frozenset({name}))) for name in (current, replacing))
    assert LARGER_PRIOR.accept(cast("FittedSets", None), before, Proposal(proposed, ratio)).accepted is accepted


@pytest.mark.parametrize("possible", [True, False])
def test_an_indistinguishable_effect_of_an_impossible_size_is_not_proposed(
    monkeypatch: pytest.MonkeyPatch, possible: bool
) -> None:
    """A spring that softens like a scale error has usual sizes, but is this scale error."""
    monkeypatch.setattr(replacements, "indifference", lambda *_: 30.0)
    scale, spring = (
        Mock(cost=cost, inflation=1.0, effects=(name,), key=frozenset({name}), priors={name: prior}, penalty=9.0)
        for name, cost, prior in ((SCALE, 100.0, 0.03), ("spring_joint1", 110.0, 1.0))
    )
    fitted_sets = Mock(fits={spring.key: spring}, predictive=lambda model: model, unexpected=lambda model: [SCALE])
    fitted_sets.without.return_value.key, fitted_sets.test.return_value.ranking = (
        frozenset(),
        [Mock(effect=EFFECTS["spring_joint1"])],
    )
    fitted_sets.as_possible.return_value = possible
    assert [proposal.model for proposal in LARGER_PRIOR.propose(fitted_sets, scale)] == [spring] * possible


@pytest.mark.parametrize("unclear", [True, False])
def test_a_more_probable_simpler_form_replaces_a_form_that_adds_less_than_remains(
    monkeypatch: pytest.MonkeyPatch, unclear: bool
) -> None:
    """The class contains both forms and is named after the more probable one. The criterion does not count."""
    monkeypatch.setattr(replacements, "indifference", lambda *_: 30.0)
    monkeypatch.setattr(replacements, "adds_less_than_remains", lambda *_: unclear)
    richer, simple = (
        Mock(cost=cost, key=frozenset({name}), priors={name: prior})
        for name, cost, prior in ((HYSTERESIS, 100.0, 1.0), (FRICTION, 400.0, 10.0))
    )
    fitted_sets = Mock(fits={simple.key: simple}, predictive=lambda model: model, unexpected=lambda model: [HYSTERESIS])
    fitted_sets.without.return_value.key, fitted_sets.test.return_value.ranking = (
        frozenset(),
        [Mock(effect=EFFECTS[FRICTION])],
    )
    proposals = list(LARGER_PRIOR.propose(fitted_sets, richer))
    assert [(proposal.model, proposal.value) for proposal in proposals] == [(simple, 10.0)] * unclear
    assert all(LARGER_PRIOR.accept(fitted_sets, richer, proposal).accepted for proposal in proposals)


@pytest.mark.parametrize(("parameters", "cost", "kept"), [(3, 427.0, True), (3, 431.0, False), (4, 401.0, False)])
def test_a_revision_that_ends_with_more_parameters_must_reduce_the_criterion(
    monkeypatch: pytest.MonkeyPatch, parameters: int, cost: float, kept: bool
) -> None:
    """A spring alone costs more parameters than a scale and a zero error. The indifference is 30."""
    before, after = stated(400.0, 3, SCALE, FRICTION), stated(cost, parameters, "spring_joint1")
    state = SearchState(before, cast("FittedSets", SimpleNamespace(bare=stated(1e6, 2))), 4)
    revised = replace(state, current=after)
    monkeypatch.setattr(select, "apply_move", lambda move, current: revised)
    monkeypatch.setattr(select, "apply_moves", lambda moves, current: current)
    monkeypatch.setattr(select, "indifference", lambda *_: 30.0)
    monkeypatch.setattr("dpr_lab.gap.which.search._caveat", lambda _: "")
    assert (select._revised(state).current is after) is kept


def test_after_the_last_revision_the_more_probable_form_is_named_and_its_fit_converges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The revision itself returns to the richer form, because its criterion is lower."""
    richer, simple, converged = (
        replace(stated(cost, parameters, name), priors={name: 1.0})
        for cost, parameters, name in ((400.0, 4, HYSTERESIS), (430.0, 3, FRICTION), (420.0, 3, FRICTION))
    )

    def to(*models: Hypothesis) -> Move:
        return Move("", "", lambda *_: [Proposal(model) for model in models], lambda *_: Decision(True, ""))

    stand_ins = {"REFINE": (), "REVISIONS": ((to(simple), (to(richer),)),), "HELD_OUT": to()}
    stand_ins |= {"LARGER_PRIOR": to(simple), "CONVERGE": to(converged), "_selection": lambda state, _: state}
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(select, name, stand_in)
    monkeypatch.setattr(select, "_better_bare_model", lambda *_: None)
    monkeypatch.setattr("dpr_lab.gap.which.search._caveat", lambda _: "")
    fitted_sets = SimpleNamespace(
        bare=stated(1e6, 2), problem=None, copied=lambda: fitted_sets, unexpected=lambda model: model.effects
    )
    state: Any = select.refined(SearchState(richer, cast("FittedSets", fitted_sets), 4))
    assert [step.tried for step in state.trace] == [[FRICTION], [HYSTERESIS], [FRICTION], [FRICTION]]
    assert state.current is converged


@pytest.mark.parametrize(
    ("pair", "noise", "fitted"),
    [
        (("spring_joint1", "base_vibration"), False, 2),
        ((FRICTION, "base_vibration"), False, 1),
        (("spring_joint1", "base_vibration"), True, 1),
    ],
)
def test_a_smaller_set_that_two_effects_replaced_is_also_fitted_to_full_segments(
    monkeypatch: pytest.MonkeyPatch, pair: tuple[str, str], noise: bool, fitted: int
) -> None:
    single, chosen = (
        Mock(effects=effects, key=frozenset(effects), at_noise_floor=noise) for effects in ((FRICTION,), pair)
    )
    short = Mock(fitted_sets=Mock(fits={model.key: model for model in (single, chosen)}))
    short.trace = [Mock(tried=list(model.effects), accepted=True) for model in (single, chosen)]
    monkeypatch.setattr(select, "apply_moves", lambda moves, state: Mock(current=chosen, trace=()))
    monkeypatch.setattr(select, "fitted_to_working_segments", lambda fitted_sets, model: model)
    proposals = select.short_segments(short).propose(Mock(), Mock())
    assert [proposal.model for proposal in proposals] == [chosen, single][:fitted]

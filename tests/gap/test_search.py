"""Search for the set of effects: the result depends only on the recordings, and the trace is complete."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.gauss_newton import StopReason, fit
from dpr_lab.fitting.whitening import Disturbance
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.result.diagnosis import Diagnosis, SearchStep
from dpr_lab.gap.screen.recordings import LENGTHS
from dpr_lab.gap.which import moves, removals, replacements, restarts
from dpr_lab.gap.which.effort import Effort
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.forward import Beam, forward_selection
from dpr_lab.gap.which.moves import START
from dpr_lab.gap.which.replacements import BETTER_ALTERNATIVE, fit_alternatives
from dpr_lab.gap.which.restarts import escaped
from dpr_lab.gap.which.search import Decision, Move, Proposal, SearchState, apply_move, apply_moves
from dpr_lab.gap.which.select import forward, short_segments
from dpr_lab.report.gap.trials_of_search import trial_table
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.plant.config import load_plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request
from tests.background_rigs import Law, law, recordings
from tests.thinned import candidates

Truth = Mapping[str, Mapping[str, float]]

LIBRARY = tuple(EFFECTS)
SIZE_TOLERANCE = 1e-5
"""Relative: permuted runs are summed in another order. 1.4e-7 was the largest difference seen on the rigs below."""

TRUTHS: dict[str, Truth] = {
    "clean": {},
    "two effects": {"coulomb_joint2": {"torque_Nm": 2e-3}, "encoder_offset_joint2": {"offset_rad": 0.01}},
    "friction and latency": {"coulomb_joint1": {"torque_Nm": 1.5e-3}, "latency_joint2": {"delay_s": 5e-4}},
    "three effects": {
        "coulomb_joint1": {"torque_Nm": 3e-3},
        "spring_joint1": {"stiffness_Nm_per_rad": 0.02},
        "air_drag_outer": {"coefficient_kg_per_m2": 4e-4},
    },
}

MOVES = {
    move.name: move
    for module in (moves, removals, replacements)
    for move in vars(module).values()
    if isinstance(move, Move)
}
EVERY_MOVE = (forward_selection(4), short_segments(Mock()), *MOVES.values())
LIKELY = ("coulomb", "stribeck", "load_friction", "encoder", "latency", "base_tilt")


def assert_order_does_not_matter(runs: list[Run], rig: Rig, seed: int, names: tuple[str, ...] = LIBRARY) -> None:
    """Diagnose as recorded, and with a permuted library and permuted runs: one answer."""
    library = {name: EFFECTS[name] for name in names}
    assert_same(permuted(runs, rig, seed, names), diagnose(runs, rig, library=library))


def permuted(runs: list[Run], rig: Rig, seed: int, names: tuple[str, ...]) -> Diagnosis:
    """Diagnosis with a permuted library and permuted runs."""
    names = np.random.default_rng(seed).permutation(names).tolist()
    return diagnose([*runs[1:], runs[0]], rig, library={name: EFFECTS[name] for name in names})


def assert_same(one: Diagnosis, other: Diagnosis) -> None:
    assert one.verdict == other.verdict
    assert sorted(effect.name for effect in one.effects) == sorted(effect.name for effect in other.effects)
    assert one.probabilities == pytest.approx(other.probabilities, abs=1e-6)
    assert not [p for p in one.probabilities.values() if 0.0 < p < CALIBRATION.least_listed]
    assert one.model_effects.keys() == other.model_effects.keys()
    for name, sizes in other.model_effects.items():
        assert one.model_effects[name] == pytest.approx(sizes, rel=SIZE_TOLERANCE)
    assert [trial_of(step) for step in one.search] == [trial_of(step) for step in other.search]


def trial_of(step: SearchStep) -> tuple[str, list[str], bool]:
    return step.move, sorted(step.tried), step.accepted


@pytest.fixture(scope="module")
def short_runs(recorded: Callable[..., list[Run]]) -> list[Run]:
    return recorded(TRUTHS["two effects"], duration=2.0)[:2]


@pytest.fixture(scope="module")
def diagnosed(short_runs: list[Run], paper: Rig) -> Diagnosis:
    return diagnose(short_runs, paper, library=candidates(*LIKELY))


@pytest.mark.slow
def test_the_order_of_runs_and_of_the_library_does_not_change_the_answer(
    short_runs: list[Run], diagnosed: Diagnosis, paper: Rig
) -> None:
    assert_same(permuted(short_runs, paper, 1, tuple(candidates(*LIKELY))), diagnosed)


@pytest.mark.long
@pytest.mark.parametrize("truth", TRUTHS)
def test_the_order_does_not_change_the_answer_in_longer_recordings(
    paper: Rig, recorded: Callable[..., list[Run]], truth: str
) -> None:
    assert_order_does_not_matter(recorded(TRUTHS[truth], duration=4.0), paper, seed=2)


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_order_does_not_change_the_answer_on_a_drawn_rig_with_two_effects() -> None:
    seed = 910_027
    plant, rig = weighed(load_plant("paper", seed), load_rig("paper"))
    assert_order_does_not_matter(record(draw_plant(parse_request("pair:clear"), plant, rig), rig), rig, seed)


@pytest.fixture(scope="module")
def sets(bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]) -> FittedSets:
    """The sets of a rig with two effects; only the bare model is fitted."""
    runs = recorded(TRUTHS["two effects"], duration=2.0)
    problem, base = bare(runs)
    # With a drift of the zero, so near the noise, several sets of two effects explain the runs equally well.
    omitted = {"encoder_drift_joint1", "encoder_drift_joint2"}
    library = {name: EFFECTS[name] for name in LIBRARY if EFFECTS[name].stage != "load" and name not in omitted}
    return FittedSets(screened(runs), problem, library, base)


def test_a_score_test_is_repeated_for_a_much_better_fit_of_its_set(
    bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    runs = recorded(TRUTHS["two effects"], duration=1.0)[:1]
    problem, base = bare(runs)
    ratios = base.fit.estimate.ratios.copy()
    sets = FittedSets(screened(runs), problem, {"coulomb_joint2": EFFECTS["coulomb_joint2"]}, base)
    for factor, repeated in ((1.02, True), (1 + 1e-9, False)):
        start = base.fit.estimate.changed(ratios=factor * ratios)
        worse = hypothesis(problem, (), fit(problem, start, base.fit.free, iterations=0))
        fresh = replace(sets, _tests={})
        assert fresh.test(worse).fit is worse.fit
        assert (fresh.test(base).fit is base.fit) == repeated


@pytest.mark.slow
def test_one_score_needs_no_test_of_the_whole_library(sets: FittedSets) -> None:
    name = "coulomb_joint2"
    alone, whole = (replace(sets, _fits=dict(sets.fits), _tests={}, expected=frozenset({name})) for _ in range(2))
    score, of_whole = alone.score(sets.bare, name), whole.test(sets.bare).best_score(name)
    assert score is not None
    assert of_whole is not None
    assert score.gain == pytest.approx(of_whole.gain, rel=1e-9)
    assert [proposal.model.effects for proposal in START.propose(alone, sets.bare)] == [(name,)]
    assert alone._tests[sets.bare.key].tested == {name}
    assert alone._tests[frozenset({name})].tested == sets.library.keys() - {name}
    ranked = [[other.effect.name for other in each.test(sets.bare).ranking] for each in (alone, whole)]
    assert ranked[0] == ranked[1]


@pytest.mark.slow
def test_a_move_does_not_change_the_state_and_is_repeatable(sets: FittedSets) -> None:
    start = SearchState(sets.bare, sets, 2)
    grown = apply_moves((forward_selection(2),), start)
    assert dict(start.fitted_sets.fits) == {frozenset(): sets.bare}
    fits, fitted_more = dict(grown.fitted_sets.fits), False
    for move in MOVES.values():
        one, other = apply_move(move, grown), apply_move(move, grown)
        assert dict(grown.fitted_sets.fits) == fits, move.name
        assert one.trace == other.trace, move.name
        assert one.fitted_sets.fits.keys() == other.fitted_sets.fits.keys(), move.name
        fitted_more = fitted_more or len(one.fitted_sets.fits) > len(fits)
    assert fitted_more


@pytest.mark.slow
def test_friction_and_drag_that_hide_each_other_are_found_together() -> None:
    """Next to viscous friction, each changes the decay in the opposite direction."""
    drag = Law("air_drag", 0, 2.5e-4, lambda t, angle, speed: -2.5e-4 * speed * abs(speed))
    rig, runs, _ = recordings(1, [law("coulomb", 0, 5.0), drag], rods=1, seconds=4.0)
    diagnosis = diagnose(runs, rig, library=candidates("coulomb", "stribeck", "friction", "air_drag"))
    assert diagnosis.model_effects.keys() == {"coulomb_joint1", "air_drag_both"}
    assert min(effect.probability for effect in diagnosis.effects) > 0.9


@pytest.mark.slow
def test_two_moves_that_request_the_same_fit_share_it(sets: FittedSets) -> None:
    score = sets.test(sets.bare).ranking[0]
    one, other = (replace(sets, _fits={}, _tests=dict(sets._tests)).with_one(sets.bare, score) for _ in range(2))
    assert one.effects == (score.effect.name,)
    assert one is other


@pytest.mark.slow
def test_of_two_fits_of_a_set_the_better_one_is_kept(sets: FittedSets) -> None:
    start = sets.bare.fit.estimate.changed(ratios=sets.bare.fit.estimate.ratios * 1.01)
    free = free_parameters(start, (), sets.problem)
    worse = hypothesis(sets.problem, (), fit(sets.problem, start, free, iterations=0))
    resumed = replace(sets, _fits={frozenset(): worse}, _tests={})
    assert resumed.fits[frozenset()] is sets.bare
    assert resumed.keep(worse) is sets.bare


@pytest.mark.slow
def test_a_search_ends_once_short_segments_refute_torque_noise(
    sets: FittedSets, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Hypothesis, "far_from_noise", True)
    torques = replace(sets, problem=replace(sets.problem, disturbance=Disturbance(*np.zeros((3, 0)))))
    assert forward(sets, 1).trace
    searched = forward(torques, 1)
    assert searched.current is sets.bare
    assert not searched.trace


@pytest.mark.slow
def test_short_segments_are_fitted_once_because_there_are_no_shorter_ones(
    sets: FittedSets, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Hypothesis, "far_from_noise", True)
    monkeypatch.setattr("dpr_lab.gap.which.fitted_sets.EFFORT", Effort(achieved=1e6))  # no fit reduces chi2 enough
    repeated: list[Hypothesis] = []

    def from_short(sets: FittedSets, model: Hypothesis, *arguments: object) -> Hypothesis:
        repeated.append(model)
        return model

    monkeypatch.setattr(FittedSets, "_from_short_segments", from_short)
    short = sets.on_short()
    raw = short.bare.fit.estimate.changed(initial=sets.recordings.cut(LENGTHS.first)[1])
    assert short.problem.chi2(
        short.bare.fit.estimate.changed(initial=short.bare.fit.estimate.initial)
    ) < short.problem.chi2(raw)
    for tried, times in ((short, 0), (replace(sets, _fits={}, _tests=dict(sets._tests)), 1)):
        tried.with_one(tried.bare, tried.test(tried.bare).ranking[0])
        assert len(repeated) == times


@pytest.mark.slow
def test_far_from_the_noise_a_candidate_that_decides_nothing_is_not_fitted(
    sets: FittedSets, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Hypothesis, "far_from_noise", True)
    few = apply_moves((forward_selection(2),), SearchState(sets.bare, sets, 2))
    monkeypatch.setattr("dpr_lab.gap.which.forward.BEAM", Beam(exceeded=1e9))
    every = apply_moves((forward_selection(2),), SearchState(sets.bare, sets, 2))
    assert few.fitted_sets.fits.keys() < every.fitted_sets.fits.keys()
    assert few.current.effects == every.current.effects
    assert few.current.cost == every.current.cost


@pytest.mark.slow
def test_torque_noise_is_refuted_after_one_fitted_effect(sets: FittedSets, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Hypothesis, "far_from_noise", True)
    monkeypatch.setattr("dpr_lab.gap.which.forward.accepted", lambda *models: False)
    monkeypatch.setattr("dpr_lab.gap.which.forward.no_effects_reach_noise", lambda sets, model: True)
    fresh = replace(sets, _fits={}, _tests=dict(sets._tests))  # without the fits of other tests
    grown = apply_moves((forward_selection(3, to_floor=True),), SearchState(fresh.bare, fresh, 3))
    assert {len(key) for key in grown.fitted_sets.fits} == {0, 1}


@pytest.mark.slow
def test_a_set_that_escaped_a_local_minimum_is_not_refitted_again(
    sets: FittedSets, monkeypatch: pytest.MonkeyPatch
) -> None:
    better = replace(sets.bare, fit=replace(sets.bare.fit, stop=StopReason.CONVERGED))
    monkeypatch.setattr(restarts, "_escaped", lambda sets, model: better)
    resumed = replace(sets, _fits={}, _tests={})
    assert escaped(resumed, sets.bare) is better
    monkeypatch.setattr(restarts, "_escaped", lambda sets, model: sets.bare)
    assert escaped(resumed, better) is better


@pytest.mark.slow
def test_an_indistinguishable_effect_fits_as_well_although_its_own_fit_was_stuck(
    bare: Callable[..., Any], screened: Callable[..., Any], recorded: Callable[..., list[Run]]
) -> None:
    dry, clock, length = "coulomb_joint1", "clock_rate", "wrong_length_L1"
    runs = recorded({dry: {"torque_Nm": 1.5e-3}, clock: {"excess": 2e-3}}, duration=2.0)
    problem, base = bare(runs)
    library = {name: EFFECTS[name] for name in (dry, clock, length)}
    sets = FittedSets(screened(runs), problem, library, base)
    chosen = base
    for name in (dry, clock):
        score = sets.test(chosen).best_score(name)
        assert score is not None
        chosen = sets.with_one(chosen, score)
    start, names = base.fit.estimate, (dry, length)
    stuck = hypothesis(problem, names, fit(problem, start, free_parameters(start, names, problem), iterations=0))
    sets.keep(stuck)
    assert stuck.fit.chi2 > 2 * chosen.fit.chi2
    assert fit_alternatives(sets, chosen)[stuck.key].fit.chi2 == pytest.approx(chosen.fit.chi2, rel=1e-3)


@pytest.mark.slow
def test_no_move_exceeds_the_maximum_number_of_effects(sets: FittedSets) -> None:
    state = apply_moves((forward_selection(2),), SearchState(sets.bare, sets, max_effects=1))
    assert len(state.current.effects) == 1
    assert "more effects than the maximum number of 1" in {trial.reason for trial in state.trace}


@pytest.mark.slow
def test_the_trace_leads_from_the_bare_model_to_the_chosen_set(diagnosed: Diagnosis) -> None:
    current: list[str] = []
    for step in diagnosed.search:
        assert step.move in {move.name for move in EVERY_MOVE}
        assert step.before == current or (step.move == "short segments" and not step.before)
        current = step.tried if step.accepted else step.before
    assert sorted(current) == sorted(diagnosed.model_effects)
    table = trial_table(diagnosed)
    rows = table.rows
    assert {len(row) for row in rows} == {len(table.columns)}
    assert any("+ Coulomb friction, joint 2" in row[1] for row in rows if "accepted" in row)


def test_a_set_whose_fit_ended_without_descent_is_reported(sets: FittedSets) -> None:
    state = SearchState(sets.bare, sets, 1)
    stuck = replace(sets.bare, fit=replace(sets.bare.fit, stop=StopReason.NO_DESCENT))
    reasons = [
        state.after(START, Proposal(model), Decision(False, "no")).trace[-1].reason for model in (sets.bare, stuck)
    ]
    assert reasons == ["no", "no; its fit may not have reached the minimum that the criterion assumes"]


@pytest.mark.parametrize(("prior", "accepted"), [(4.0, False), (6.0, False), (10.0, True)])
def test_fewer_parameters_are_not_preferred_if_their_prior_is_far_smaller(
    monkeypatch: pytest.MonkeyPatch, prior: float, accepted: bool
) -> None:
    """A spring of usual size replaces an unusual scale error, although this has fewer parameters and a lower cost."""
    monkeypatch.setattr(replacements, "significance", lambda *_: 8.0)
    monkeypatch.setattr(replacements, "explains_as_much", lambda *_: True)
    scale, spring = (
        Mock(cost=cost, inflation=1.0, effects=(name,), key=frozenset({name}), priors={name: weight})
        for name, cost, weight in (("encoder_scale_joint1", 100.0, 0.1), ("spring_joint1", 112.0, 0.1 * prior))
    )
    assert BETTER_ALTERNATIVE.accept(Mock(), scale, Proposal(spring)).accepted is accepted


def test_the_documentation_lists_every_move() -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-the-diagnosis-decides.md").read_text(encoding="utf-8")
    for move in EVERY_MOVE:
        assert f"| {move.name} | {move.purpose} |" in page


@pytest.mark.parametrize(("at_floor", "expected"), [(False, ["similar"]), (True, [])])
def test_a_similar_effect_with_nearly_the_score_is_fitted_while_a_residual_remains(
    monkeypatch: pytest.MonkeyPatch, at_floor: bool, expected: list[str]
) -> None:
    """The fit of `named` reduced the cost from 100 to 1, although its linear score promised a reduction of 20."""
    gains = {"better": 30.0, "second": 25.0, "named": 20.0, "similar": 19.0, "other shape": 19.0, "weaker": 10.0}
    cosines = {"similar": 0.95, "weaker": 0.95}
    scores = {
        name: SimpleNamespace(effect=SimpleNamespace(name=name, common=False), gain=gain)
        for name, gain in gains.items()
    }
    test = Mock(
        ranking=[*scores.values()], best_score=scores.get, cosine=lambda _, other: cosines.get(other.effect.name, 0.0)
    )
    sets, fitted = Mock(), list[str]()
    sets.without.return_value = SimpleNamespace(cost=100.0)
    sets.test.return_value = test
    sets.with_one = lambda _, score: fitted.append(score.effect.name)
    monkeypatch.setattr(replacements, "simpler_forms", lambda *_: [])
    monkeypatch.setattr(replacements, "_indistinguishable", lambda *_: [])
    fit_alternatives(sets, Mock(effects=("named",), at_noise_floor=at_floor, cost=1.0))
    assert fitted == expected


@pytest.mark.parametrize(
    ("before", "after", "cost", "accepted"),
    [
        ("spring_joint1", "coulomb_joint1", 113.0, True),
        ("spring_joint1", "coulomb_joint1", 114.0, False),
        ("spring_joint1", "detent_joint1", 99.0, False),
        ("spring_joint1", "detent_joint1", 91.0, True),
        ("coulomb_joint1", "spring_joint1", 91.0, False),
        ("coulomb_joint1", "spring_joint1", 86.0, True),
        ("coulomb_joint1", "encoder_offset_joint1", 91.0, True),
    ],
)
def test_prior_odds_of_ten_weigh_as_much_as_a_criterion_of_14(
    monkeypatch: pytest.MonkeyPatch, before: str, after: str, cost: float, accepted: bool
) -> None:
    """6 ln 10 = 13.8, with 6 the difference of the criterion for a factor e, if the readings are independent."""
    monkeypatch.setattr(replacements, "significance", lambda *_: 8.0)
    monkeypatch.setattr(replacements, "explains_as_much", lambda *_: False)
    current, model = (
        Mock(cost=criterion, inflation=1.0, effects=(name, "base_tilt"), key=frozenset((name, "base_tilt")),
             priors={name: EFFECTS[name].prior_odds, "base_tilt": 10.0})
        for criterion, name in ((100.0, before), (cost, after))
    )  # fmt: skip
    assert BETTER_ALTERNATIVE.accept(Mock(), current, Proposal(model)).accepted == accepted

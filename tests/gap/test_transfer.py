"""Transfer of named effects to recordings that were not fitted."""

import re
from collections.abc import Callable
from dataclasses import astuple, replace
from importlib import import_module
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.conclusion import sentence, verdict
from dpr_lab.gap.conclusion.notes import _small_effects
from dpr_lab.gap.conclusion.sentence import reduction_sentence
from dpr_lab.gap.conclusion.verdict import small_effects
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Basis
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.screen.pieces import whole
from dpr_lab.gap.screen.sensor_faults import screen
from dpr_lab.gap.transfer.free_run import FreeRunError
from dpr_lab.gap.transfer.out_of_sample import block_starts, reduction
from dpr_lab.gap.transfer.outcome import Transfer, WorseFreeRun
from dpr_lab.gap.transfer.transfer import _blocks, _helps, _signed_rank, judged
from dpr_lab.gap.transfer.worse_free_run import worse_free_run
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.shown import percent
from tests import one_rod
from tests.thinned import candidates, thinned

Recorded = Callable[..., list[Run]]

LIBRARY = {name: EFFECTS[name] for name in ("coulomb_joint1", "coulomb_joint2")}
DRY = {"coulomb_joint2": {"torque_Nm": 1e-3}}


@pytest.fixture(scope="module")
def dry(recorded: Recorded) -> list[Run]:
    return recorded(DRY, duration=5.0)


def test_the_prediction_of_held_out_runs_precedes_the_stage_where(
    dry: list[Run], paper: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages, during = [], []

    def predicted(*_: object) -> None:
        during.append(stages[-1])

    def located(*_: object) -> None:
        during.append(stages[-1])
        raise InterruptedError

    module = import_module("dpr_lab.gap.diagnose")
    monkeypatch.setattr(module, "held_out_prediction", predicted)
    monkeypatch.setattr(module, "locate", located)
    with pytest.raises(InterruptedError):
        diagnose(dry[:1], paper, held_out=dry[1:], on_progress=lambda event: stages.append(getattr(event, "name", "")))
    assert during == ["bare model", "where"]


@pytest.mark.slow
def test_a_diagnosis_of_one_release_states_that_it_was_not_validated_on_another(dry: list[Run], paper: Rig):
    diagnosis = diagnose(dry[:1], paper, library=LIBRARY)
    assert diagnosis.basis == "one release"
    assert "across the quarters of the only release" in diagnosis.sentence
    assert len(re.findall(r"\.(?= |$)", diagnosis.sentence)) <= 3


def test_a_single_recording_that_stays_unexplained_names_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"_classes": "an effect", "fitted_only": True, "reduction_sentence": "Not closed."}.items():
        monkeypatch.setattr(sentence, name, lambda *_, value=value: value)
    chosen = Mock(effects=("coulomb_joint1",), residuals=Mock(noise_ratio=3.0))
    selection = Mock(share_explained=0.96, expected=frozenset(), chosen=chosen)
    states = {b: Mock(selection=selection, posteriors=[Mock()]) for b in ("one release", "releases left out")}
    for basis, state in states.items():
        state.transfer.basis = basis
    result = {basis: sentence._unexplained(state, Mock()) for basis, state in states.items()}
    assert "but not in the quarters that were not fitted." in result["one release"]
    assert "but not in other recordings." in result["releases left out"]


@pytest.mark.slow
def test_each_effect_states_its_reduction_of_the_gap_on_each_held_out_run(dry: list[Run], paper: Rig):
    diagnosis = diagnose(dry, paper, library=LIBRARY)
    assert (diagnosis.verdict, diagnosis.basis, diagnosis.withdrawn) == ("named", "releases left out", [])
    shares = diagnosis.transfer["coulomb_joint2"]
    assert set(shares) == {run.name for run in dry}
    for share in shares.values():
        assert share.interval90[0] <= share.value <= share.interval90[1]
        assert share.value > 0.9


@pytest.mark.slow
def test_an_effect_that_does_not_transfer_to_a_held_out_run_is_withdrawn(dry: list[Run], recorded, paper: Rig):
    diagnosis = diagnose(dry[:2], paper, held_out=recorded({})[2:], library=LIBRARY)
    assert (diagnosis.verdict, diagnosis.basis, diagnosis.withdrawn) == (
        "unexplained",
        "held-out runs",
        ["coulomb_joint2"],
    )
    assert diagnosis.probabilities["coulomb_joint2"] <= 0.5
    assert "but not in other recordings" in diagnosis.sentence


@pytest.mark.slow
def test_an_effect_that_worsens_held_out_runs_is_left_out_of_the_model(dry: list[Run], recorded, paper: Rig):
    library = {name: EFFECTS[name] for name in ("coulomb_joint2", "spring_joint1")}
    sprung = recorded({**DRY, "spring_joint1": {"stiffness_Nm_per_rad": 4e-4}}, duration=5.0)
    diagnosis = diagnose(sprung[:2], paper, held_out=dry[2:], library=library)
    assert [effect.name for effect in diagnosis.effects] == ["coulomb_joint2"]
    assert diagnosis.assumptions[-1].startswith("spring_joint1 was excluded from the model")


def test_a_gap_that_grows_is_not_reported_to_close() -> None:
    grown = Transfer(
        "held-out runs", True, Interval(value=-0.51, interval90=(-0.74, -0.22)), 1.0, (), {}, {}, {}, (), (), (), None
    )
    assert reduction_sentence(grown) == "On held-out runs the gap does not close (-51 %, 90 % interval -74 % to -22 %)."


@pytest.mark.parametrize(
    ("low", "words"),
    [
        (0.0, "do not show how far the gap closes (97 %, 90 % interval 0 % to 100 %): record a second release."),
        (0.8, "of the only release the gap closes by 97 % (90 % interval 80 % to 100 %)."),
    ],
)
def test_a_single_release_whose_quarters_differ_shows_no_reduction(low: float, words: str) -> None:
    closed = Interval(value=0.97, interval90=(low, 1.0))
    transfer = Transfer("one release", True, closed, 1.0, (), {}, {}, {}, (), (), (), None)
    assert reduction_sentence(transfer).endswith(words)


@pytest.mark.parametrize(
    ("probabilities", "named"),
    [((0.98, 0.24), ["a"]), ((0.4, 0.24, 0.01), ["a", "b"]), ((0.98, 0.7), ["a", "b"])],
)
def test_the_sentence_names_improbable_causes_only_without_a_probable_one(
    probabilities: tuple[float, ...], named: list[str]
) -> None:
    causes = [EffectPosterior(name, (name,), (), p) for name, p in zip("abc", probabilities, strict=False)]
    selection = Mock(expected=frozenset(), bare=Mock(bounded_excess=1.0), path=())
    state = Mock(selection=selection, posteriors=causes, transfer=Mock(withdrawn=()))
    assert [cause.name for cause in verdict.causes_named(state)] == named


def test_the_sentence_states_a_probable_but_small_effect_next_to_a_large_one() -> None:
    base, large, both = (Mock(bounded_excess=excess) for excess in (1000.0, 8.0, 4.0))
    selection = Mock(expected=frozenset(), bare=base, path=[("a", large), ("b", both)])
    causes = [EffectPosterior(name, (name,), (), 0.98) for name in "ab"]
    state = Mock(selection=selection, posteriors=causes, transfer=Mock(withdrawn=(), tested=False))
    assert [cause.name for cause in verdict.causes_named(state)] == ["a"]
    assert "by a (probability 98 %). b explains less than 1 % of the gap." in sentence._sentence("named", state, Mock())
    assert list(_small_effects(state, "named")) == []
    state.posteriors[1] = replace(causes[1], probability=0.3)
    assert "by a (probability 98 %). " in sentence._sentence("named", state, Mock())
    assert list(_small_effects(state, "named")) == [
        "Small effects, together less than 1 % of the excess chi-square: b."
    ]


def test_an_effect_that_the_sentence_names_is_not_listed_as_a_small_effect() -> None:
    base, only = (Mock(bounded_excess=excess) for excess in (400.0, 400.0))  # the limit of noise
    selection = Mock(expected=frozenset(), bare=base, path=[("a", only)])
    causes = [EffectPosterior("a", ("a",), (), 0.98)]
    state = Mock(selection=selection, posteriors=causes, transfer=Mock(withdrawn=()))
    assert small_effects(base, selection.path) == {"a"}
    assert list(_small_effects(state, "named")) == []


def test_held_out_data_without_a_gap_of_their_own_refute_nothing() -> None:
    nothing_to_close = reduction(
        np.array([[3.0, -4.0, 2.0, -2.0], [1.0, -4.0, 0.0, -2.0]]), 1.0, np.random.default_rng(1), 1, np.zeros(4, int)
    )
    silent = Transfer("held-out runs", True, nothing_to_close, 0.3, (), {}, {}, {}, (), (), (), None)
    assert reduction_sentence(silent) == "On held-out runs the gap is too small to show a reduction."


def test_a_narrow_interval_is_stated_with_a_decimal() -> None:
    closed = Interval(value=0.9984, interval90=(0.9962, 1.0))
    outcome = Transfer("one release", True, closed, 30.0, (), {}, {}, {}, (), (), (), None)
    assert reduction_sentence(outcome).endswith("the gap closes by 99.8 % (90 % interval 99.6 % to 100.0 %).")
    nearly = replace(outcome, closed=Interval(value=0.9999, interval90=(0.99983, 0.99992)))
    assert reduction_sentence(nearly).endswith("the gap closes by more than 99.9 % (90 % interval above 99.9 %).")


@pytest.mark.slow
def test_a_cause_is_named_although_a_noisy_held_out_run_shows_no_gap(dry: list[Run], paper: Rig):
    rng = np.random.default_rng(2)
    blurred = replace(dry[2], theta=dry[2].theta + rng.normal(0, 0.03, dry[2].theta.shape))
    diagnosis = diagnose(dry[:2], paper, held_out=blurred, library=LIBRARY)
    assert diagnosis.verdict != "unexplained"
    assert diagnosis.probabilities["coulomb_joint2"] > 0.9


@pytest.mark.parametrize(("closed", "probability"), [(-0.42, 0.49), (0.31, 0.98)])
def test_no_effect_is_sure_if_all_together_increase_the_gap_of_the_quarters_left_out(closed, probability) -> None:
    """Although each carries over compared with the others alone."""
    quarters = Interval(value=closed, interval90=(closed - 0.3, closed + 0.46))
    tested = Transfer("one release", True, quarters, 1.0, (), {}, {}, {}, (), (), (), None)
    (posterior,) = judged(
        tested, [EffectPosterior("base_vibration", ("base_vibration",), (), 0.98)], forced=False, remainder=False
    )
    assert posterior.probability == pytest.approx(probability)


@pytest.mark.parametrize(
    ("basis", "tested", "worse", "probability"),
    [
        ("one release", True, None, 0.85),
        ("one release", False, None, 0.85),
        ("one release", True, WorseFreeRun(0.1, 0.2, 1.0), 0.49),
        ("releases left out", True, None, 0.49),
    ],
    ids=["quarters", "too short for quarters", "worse free run", "several releases"],
)
def test_a_failed_test_of_quarters_is_weak_evidence(
    basis: Basis, tested: bool, worse: WorseFreeRun | None, probability: float
) -> None:
    closed, failed, alone = Interval(value=0.6, interval90=(0.2, 0.8)), ("coulomb_joint1",), basis == "one release"
    withdrawn, unproven = ((), failed) if alone else (failed, ())
    outcome = Transfer(basis, tested, closed, 1.0, (), {}, {}, {}, withdrawn, unproven, (), worse)
    (posterior,) = judged(outcome, [EffectPosterior("coulomb_joint1", failed, (), 0.98)], forced=False, remainder=False)
    assert posterior.probability == pytest.approx(probability, abs=0.005)


@pytest.mark.slow
def test_the_headline_is_what_closes_on_the_runs_held_out(dry: list[Run], paper: Rig):
    diagnosis = diagnose(dry[:2], paper, held_out=dry[2:], library=LIBRARY)
    closed = diagnosis.gap.closed_held_out
    assert (diagnosis.verdict, diagnosis.basis) == ("named", "held-out runs")
    assert closed.estimate == pytest.approx(closed.held_out[dry[2].name])
    assert closed.estimate > 0.8
    assert set(closed.per_run) == {run.name for run in dry[:2]}
    assert f"the gap closes by {percent(closed.estimate)}" in diagnosis.sentence


@pytest.mark.slow
def test_a_long_record_is_cut_into_pieces_that_are_fitted_and_held_out(recorded: Recorded, paper: Rig):
    (run,) = recorded(DRY, duration=24.0)[:1]
    diagnosis = diagnose([run], paper, library=LIBRARY)
    assert (diagnosis.verdict, diagnosis.basis) == ("named", "held-out runs")
    assert list(diagnosis.gap.closed_held_out.held_out) == [f"{run.name} 12-24 s"]
    assert list(diagnosis.gap.closed_held_out.per_run) == [f"{run.name} 0-12 s"]
    assert {whole(name) for name in diagnosis.gap.closed_held_out.held_out} == {run.name}
    assert "cut into 2 pieces" in diagnosis.assumptions[0]
    assert diagnosis.gap.closed_held_out.estimate > 0.9


@pytest.mark.slow
def test_a_remainder_below_half_the_noise_is_no_gap(recorded: Recorded, bare, paper: Rig):
    runs = recorded({"coulomb_joint2": {"torque_Nm": 4e-5}})
    _, base = bare(runs)
    assert base.residuals.z > 4
    assert 0 < base.residuals.noise_ratio < 0.5
    diagnosis = diagnose(runs, paper, library={"encoder_scale_joint1": EFFECTS["encoder_scale_joint1"]})
    assert (diagnosis.verdict, diagnosis.effects) == ("no_gap", [])
    assert diagnosis.probabilities["no_gap"] > 0.9
    assert "No gap above the noise" in diagnosis.sentence


def test_counts_are_missed_only_where_there_are_counts(dry: list[Run], paper: Rig):
    (run,) = dry[:1]
    count = 2 * np.pi / 16384
    theta = run.theta + 12 * count * np.array([0.0, 1.0, 1.0]) * (run.t > 2.0)[:, None]
    on_grid = replace(run, theta=theta, counts=None)
    off_grid = replace(on_grid, theta=theta + np.random.default_rng(1).uniform(-0.5, 0.5, theta.shape) * count)
    assert screen(on_grid, paper).breaks
    assert screen(on_grid, paper).on_grid.all()
    assert not screen(off_grid, paper).breaks
    assert not screen(off_grid, paper).on_grid.any()


@pytest.mark.long
def test_an_effect_larger_than_any_rig_has_is_not_named_with_confidence(recorded: Recorded, paper: Rig):
    name = "encoder_eccentricity_joint1"
    library = {name: EFFECTS[name]}
    small, large = (
        diagnose(recorded({name: {"cos1_rad": size}}, duration=1.0), paper, library=library) for size in (5e-3, 0.3)
    )
    assert small.verdict == "named"
    assert large.verdict in ("partly_explained", "unexplained")
    assert all(effect.probability <= 0.5 for effect in large.effects)


def free_run_error(rad: float, grows_from_s: float = 3.0, lost_from_s: float = 3.0) -> FreeRunError:
    """A constant error, which becomes a radian at a time, and cannot be simulated from another."""
    t = np.arange(0.3, 2.6, 0.005)
    errors = np.where(t < grows_from_s, rad, 1.0)
    return FreeRunError(t, np.where(t < lost_from_s, errors, np.nan) ** 2)


@pytest.mark.parametrize(
    ("before", "after", "worse"),
    [
        (free_run_error(0.048), free_run_error(0.168), (0.048, 0.168, 2.595)),
        (free_run_error(0.048), free_run_error(0.012), None),
        (free_run_error(0.048), free_run_error(0.05), None),
        (free_run_error(0.104), free_run_error(0.127), (0.104, 0.127, 2.595)),
        (free_run_error(1.2), free_run_error(2.0), None),
        (free_run_error(0.048, lost_from_s=0.5), free_run_error(0.168), None),
        (free_run_error(0.048), free_run_error(0.048, lost_from_s=0.3), (0.048, np.pi, 2.595)),
        (free_run_error(0.1, 1.3), free_run_error(0.3, 1.0), (0.296, 0.643, 1.38)),
        (free_run_error(0.1, 1.0), free_run_error(0.05, 1.1), None),
    ],
    ids=[
        "worse",
        "better",
        "alike",
        "a fifth worse",
        "chaos at once",
        "too short",
        "not followed",
        "worse till chaos",
        "better till chaos",
    ],
)
def test_effects_that_worsen_the_free_run_of_a_held_out_run_are_detected(before, after, worse):
    little, much = free_run_error(0.001), free_run_error(2.0)
    judged = worse_free_run({"a": before}, {"a": after}, {"a": little}, ["a"])
    assert (judged and astuple(judged)) == (pytest.approx(worse, rel=5e-3) if worse else None)
    assert worse_free_run({"a": before}, {"a": after}, {"a": much}, ["a"]) is None
    assert worse_free_run({"a": before}, {"a": after}, {"a": little}, []) is None


def test_the_most_chaotic_of_several_free_runs_does_not_decide_alone() -> None:
    """A right spring: two runs improve by factors of 18 and 29, the third amplifies errors of its first readings."""
    before, after, noise = (
        {name: free_run_error(rad) for name, rad in zip("abc", values, strict=True)}
        for values in ((0.0092, 0.299, 0.185), (0.0005, 0.698, 0.0064), (0.0002, 0.087, 0.0005))
    )
    assert worse_free_run(before, after, noise, "abc") is None
    assert worse_free_run(before, after, noise, "b") is not None
    quiet = dict.fromkeys("ac", free_run_error(0.0092))
    judged = worse_free_run({**before, **quiet}, {**after, **quiet}, noise, "abc")
    assert judged is not None  # runs that are predicted equally well hide nothing
    assert judged.after_rad / judged.before_rad == pytest.approx((0.698 / 0.299) ** (1 / 3), rel=1e-3)


def test_the_interval_of_a_short_recording_has_a_width() -> None:
    rng = np.random.default_rng(0)
    above = np.array([[10.0, 20.0, 30.0, 40.0, 50.0], [1.0, 9.0, 4.0, 30.0, 8.0]])
    low, high = reduction(above, 0.0, rng, 5, np.zeros(above.shape[1], dtype=int)).interval90
    assert low < 1 - np.sqrt(52 / 150) < high
    assert reduction(above[:, :1], 0.0, rng, 1, np.zeros(1, dtype=int)).interval90 == (-1.0, 1.0)


def test_no_block_contains_segments_of_two_runs() -> None:
    assert block_starts(np.array([0, 0, 0, 1, 1, 2]), 2).tolist() == [0, 2, 3, 5]
    test = Mock(run=np.array([0, 0, 1, 1]), block=3)
    assert _blocks(test, np.array([1.0, 2.0, 4.0, 8.0])).tolist() == [3.0, 12.0]
    above, run = np.array([np.ones(9), np.eye(9)[0]]), np.array([0, *[1] * 8])
    of_run, across = (reduction(above, 0.0, np.random.default_rng(0), 2, runs) for runs in (run, 0 * run))
    assert of_run.interval90 != across.interval90


def test_signed_ranks_of_equal_and_zero_differences_do_not_depend_on_the_order() -> None:
    assert _signed_rank(np.array([1.0, -1.0, 1.0, -1.0])) == _signed_rank(np.array([-1.0, 1.0, 1.0, -1.0])) == 0.0
    assert _signed_rank(np.zeros(5)) == 0.0
    assert _signed_rank(np.array([0.0, 3.0, 0.0, -1.0, 2.0])) == _signed_rank(np.array([3.0, -1.0, 2.0]))
    assert _signed_rank(np.arange(1.0, 7.0)) == pytest.approx(21 / np.sqrt(91))


def test_a_short_held_out_run_shows_a_large_reduction_although_its_groups_are_few() -> None:
    """The first group has by far the largest reduction, and three groups have no significant rank sum."""
    chi2 = np.array([[9e5, 4e4, 7e3], [300.0, 250.0, 280.0]])
    test = Mock(run=np.zeros(3, dtype=int), block=1, runs=[("a", slice(None))], whole_runs=True)
    assert _helps(test, chi2)
    assert not _helps(test, np.array([[9e3, 400.0, 300.0], [900.0, 300.0, 300.0]]))  # a factor of 6.5
    test.whole_runs = False  # the quarters of a single recording have the same unknown causes
    assert not _helps(test, chi2)


def test_held_out_pieces_of_a_single_recording_are_not_called_runs() -> None:
    closed = Interval(value=0.51, interval90=(0.22, 0.74))
    cut = Transfer("held-out runs", True, closed, 1.0, (), {}, {"swing 10-19 s": closed}, {}, (), (), (), None)
    assert reduction_sentence(cut).startswith("On held-out pieces of the recording the gap closes by 51 %")
    assert reduction_sentence(replace(cut, held_out={"other": closed})).startswith("On held-out runs the gap")


@pytest.mark.long
@pytest.mark.parametrize("length", thinned([0.52, 0.29], 2))
def test_a_held_out_recording_of_a_rod_of_another_length_is_named_as_such(tmp_path: Path, length: float) -> None:
    """Its phase is lost within one swing, so that no long segment shows the other length."""
    steady = one_rod.Rod(dry=2e-4, noise=1e-3, counts=2400)
    rig, runs = one_rod.recorded(steady, 1, tmp_path)
    other = one_rod.recorded(replace(steady, length=length), 2, tmp_path)[1][0]
    likely = candidates("coulomb", "wrong_length", "clock", "encoder")
    diagnosis = diagnose(runs[1:], rig, held_out=replace(other, name="after"), library=likely)
    assert diagnosis.gap.budget is not None
    changed = diagnosis.gap.budget.changed_ratio
    assert changed is not None
    of_fitted, of_other = changed.values[runs[1].name], changed.values["after"]
    assert of_other / of_fitted == pytest.approx(steady.length / length, rel=0.1)
    assert any("differ in e1/a" in note and "diagnose them separately" in note for note in diagnosis.notes)

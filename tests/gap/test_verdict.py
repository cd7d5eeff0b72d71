"""Verdicts for given shares, probabilities and reductions on held-out data."""

from dataclasses import replace
from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from dpr_lab.gap.classes.posterior import Alternative, EffectPosterior
from dpr_lab.gap.conclusion.sentence import sentence
from dpr_lab.gap.conclusion.verdict import held_out_gap_invisible, verdict
from dpr_lab.gap.result.evidence import Budget, RunBudget
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.transfer.outcome import Transfer, WorseFreeRun


def free_run(error_rad: float, growth_per_s: float = 0.0) -> Any:
    """Free run of 2 s with an uncertainty of 1 mrad."""
    return RunBudget.model_construct(
        run="run", until_s=2.0, growth_per_s=growth_per_s, error_before_rad=error_rad, u_before_rad=1e-3
    )


PREDICTED = Budget.model_construct(runs=[free_run(1e-3)])
NOISE, SMALL, GAP = Fake(z=1.0, noise_ratio=0.01), Fake(z=8.0, noise_ratio=0.49), Fake(z=50.0, noise_ratio=3.0)


def transfer(closed: float = 0.9, upper: float = 1.0, **other: Any) -> Transfer:
    """Outcome of a test that all effects passed, with some fields replaced."""
    values: dict[str, Any] = {
        "basis": "releases left out",
        "tested": True,
        "closed": Interval(value=closed, interval90=(-1.0, upper)),
        "gap_ratio": 5.0,
        "closing": (),
        "left_out": {},
        "held_out": {},
        "effects": {},
        "withdrawn": (),
        "unproven": (),
        "oversized": (),
        "worse_free_run": None,
    }
    return Transfer(**values | other)


def kind(
    outcome: Transfer | None = None,
    *,
    share: float = 0.99,
    chosen: Any = NOISE,
    bare: Any = GAP,
    causes: tuple[tuple[float, float], ...] = ((0.9, 0.05),),
    expected: tuple[str, ...] = (),
    withholds: bool = False,
    visible: tuple[int, int] = (10, 10),
    budget: Any = PREDICTED,
) -> str:
    """Verdict for a set with some causes, each with its probability and that of a cause outside the library."""
    effects = tuple("abc"[: len(causes)])
    selection = Fake(
        chosen=Fake(effects=effects, residuals=chosen, at_noise_floor=chosen.z < 4.0),
        bare=Fake(residuals=bare, at_noise_floor=bare.z < 4.0),
        share_explained=share,
        expected=frozenset(expected),
    )
    posteriors = tuple(Fake(probability=probability, outside=outside) for probability, outside in causes)
    state: Any = Fake(
        selection=selection,
        posteriors=posteriors,
        transfer=outcome or transfer(),
        description=Fake(withholds=withholds),
    )
    return verdict(state, visible, budget)


def test_a_probable_set_that_leaves_noise_and_carries_over_is_named() -> None:
    assert kind() == "named"
    assert kind(visible=(0, 10)) == "named"
    assert kind(withholds=True) == "unexplained"
    assert kind(chosen=Fake(z=5.9, noise_ratio=1.0), share=0.93) == "named"
    assert kind(causes=((0.6, 0.0), (0.1, 0.0))) == "named"


@pytest.mark.parametrize(
    "doubt",
    [
        {"chosen": Fake(z=6.0, noise_ratio=1.0)},
        {"chosen": Fake(z=5.0, noise_ratio=1.0), "share": 0.92},
        {"causes": ((0.59, 0.0),)},
        {"outcome": transfer(0.49)},
        {"outcome": transfer(withdrawn=("a",)), "causes": ((0.9, 0.0), (0.9, 0.0))},
        {"outcome": transfer(worse_free_run=WorseFreeRun(1.0, 2.0, 3.0))},
        {"outcome": transfer(oversized=("a",))},
        {"outcome": transfer(0.0, 0.5)},  # the held-out data show no gap
        {"share": 0.5, "chosen": GAP},
        {"share": 0.5, "chosen": GAP, "causes": ((0.05, 0.5), (0.01, 0.9))},
    ],
)
def test_one_doubt_makes_the_explanation_partial(doubt: dict[str, Any]) -> None:
    assert kind(**doubt) == "partly_explained"


@pytest.mark.parametrize(
    "refuted",
    [
        {"outcome": transfer(0.0, 0.49)},
        {"outcome": transfer(withdrawn=("a",))},
        {"share": 0.49, "chosen": GAP},
        {"share": 0.5, "chosen": GAP, "causes": ((0.05, 0.51), (0.04, 0.1))},
        {"outcome": transfer(0.0, 0.49, basis="one release"), "causes": ((0.49, 0.0),)},
    ],
)
def test_effects_that_explain_too_little_or_only_the_fitted_recordings_leave_the_gap_unexplained(
    refuted: dict[str, Any],
) -> None:
    assert kind(**refuted) == "unexplained"


def test_quarters_of_one_release_and_untested_data_do_not_refute_a_probable_set() -> None:
    assert kind(transfer(0.0, 0.49, basis="one release")) == "named"
    assert kind(transfer(0.0, 0.49, tested=False)) == "named"
    assert kind(transfer(0.0, 0.49, tested=False), causes=((0.49, 0.0),)) == "partly_explained"


def test_a_release_that_is_too_short_for_a_test_does_not_decide_between_improbable_causes() -> None:
    short = transfer(0.0, 1.0, basis="one release", too_short=True)
    improbable = ((0.49, 0.0), (0.3, 0.0))
    assert kind(short, causes=improbable) == "too_short"
    assert kind(transfer(0.0, 1.0, basis="one release"), causes=improbable) == "partly_explained"
    assert kind(short, causes=((0.5, 0.0), (0.3, 0.0))) == "partly_explained"
    assert kind(short, causes=improbable, expected=("a", "b")) == "partly_explained"
    assert kind(short, causes=improbable, share=0.49, chosen=GAP) == "unexplained"
    assert kind(short, causes=improbable, withholds=True) == "unexplained"


def test_the_sentence_of_an_inconclusive_release_lists_the_leading_candidates_and_the_next_recordings() -> None:
    drift = Alternative("encoder_drift_joint1", 0.99, 1.0, 0.3)
    causes = (
        EffectPosterior("coulomb_joint1", ("coulomb_joint1",), (), 0.12),
        EffectPosterior("base_tilt", ("base_tilt", "encoder_offset_joint1"), (drift,), 0.49),
        EffectPosterior("spring_joint1", ("spring_joint1",), (), 0.06),
    )
    state: Any = Fake(
        description=Fake(hint="", withholds=False),
        fitted=Fake(problem=Fake(t=np.array([0.1, 0.9, 1.7]))),
        selection=Fake(chosen=Fake(effects=("base_tilt",)), expected=frozenset()),
        posteriors=causes,
        transfer=transfer(basis="one release", too_short=True),
    )
    words = sentence("too_short", state, (10, 10), PREDICTED)
    assert words.startswith("Inconclusive: this release of 1.6 s is too short to determine the cause of the gap.")
    candidates = "base_tilt or encoder_offset_joint1 (49 %); encoder_drift_joint1 (30 %); and coulomb_joint1 (12 %)"
    assert f"The most probable candidates are {candidates}. Record three releases" in words


def test_a_member_of_negligible_probability_is_not_named() -> None:
    members = ("spring_joint1", "encoder_scale_joint1")
    shares = {"spring_joint1": (1.0, 5e-10), "spring_joint1 or encoder_scale_joint1": (0.99, 0.01)}
    for words, odds in shares.items():
        state = of_causes(replace(cause(*members, probability=0.98, untested=False), odds=odds))
        assert f"explained by {words} (probability 98 %)" in sentence("named", state, (10, 10), PREDICTED)


def limited(names: str) -> str:
    """Sentence on causes that one release does not test."""
    its = "their probabilities" if " and " in names else "its probability"
    return f" A single release tests the functional form of {names} only weakly, which limits {its}"


def cause(*members: str, probability: float = 0.64, untested: bool = True) -> EffectPosterior:
    """Class of effects with a limited probability."""
    return EffectPosterior(members[0], members, (), probability, untested=untested)


def of_causes(*causes: EffectPosterior, large: int = 9) -> Any:
    """State whose causes leave only noise; the causes after the first `large` ones are small."""
    path = [(of.name, Fake(bounded_excess=0.5 if k + 1 >= large else 40.0)) for k, of in enumerate(causes)]
    if large > len(causes):
        path[-1] = (causes[-1].name, Fake(bounded_excess=0.0))
    return Fake(
        description=Fake(hint="", withholds=False),
        fitted=Fake(problem=Fake(t=np.array([0.0, 1.3]))),
        selection=Fake(
            bare=Fake(bounded_excess=100.0), chosen=Fake(at_noise_floor=True), path=path, expected=frozenset()
        ),
        posteriors=causes,
        transfer=transfer(basis="one release"),
    )


COULOMB = cause("coulomb_joint1", probability=0.61, untested=False)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (of_causes(cause("spring_joint1")), f"by spring_joint1 (probability 64 %).{limited('spring_joint1')}"),
        (
            of_causes(cause("spring_joint1"), COULOMB),
            f"by spring_joint1 (probability 64 %) and coulomb_joint1 (probability 61 %).{limited('spring_joint1')}",
        ),
        (
            of_causes(cause("spring_joint1", "cogging_joint1"), COULOMB),
            "by spring_joint1 (class probability 64 %) and coulomb_joint1 (probability 61 %). These recordings do not"
            f" distinguish spring_joint1 from cogging_joint1.{limited('spring_joint1')}",
        ),
        (
            of_causes(
                COULOMB, cause("spring_joint1"), cause("detent_joint1", "stop_joint1", probability=0.55), large=1
            ),
            "by coulomb_joint1 (probability 61 %). spring_joint1 (probability 64 %) and detent_joint1 (class"
            " probability 55 %) together explain less than 1 % of the gap. These recordings do not distinguish"
            f" detent_joint1 from stop_joint1.{limited('spring_joint1 and detent_joint1')}",
        ),
        (
            of_causes(COULOMB, cause("base_tilt", probability=0.55, untested=False), large=1),
            "(probability 61 %). base_tilt (probability 55 %) explains less than 1 % of the gap",
        ),
        (
            of_causes(COULOMB, cause("base_tilt", untested=False)),
            "coulomb_joint1 and base_tilt (probability at least 61 %)",
        ),
    ],
    ids=["one", "two", "a class", "small", "small and tested", "tested"],
)
def test_the_sentence_states_why_a_cause_that_one_release_does_not_test_is_uncertain(state: Any, words: str) -> None:
    assert f"{words}." in sentence("named", state, (10, 10), PREDICTED)


def test_alternatives_of_several_causes_have_their_own_sentence() -> None:
    classes = [("a", "b"), ("c",), ("d", "e", "f")]
    state = of_causes(*(cause(*members, probability=0.98, untested=False) for members in classes))
    words = sentence("named", state, (10, 10), PREDICTED)
    assert words.startswith(
        "The gap is explained by a; c; and d (class probability at least 98 %). These recordings do not distinguish"
        " a from b; or d from 2 other effects. "
    )
    state.posteriors = state.posteriors[:1]
    words = sentence("named", state, (10, 10), PREDICTED)
    assert words.startswith("The gap is explained by a or b (probability 98 %). The quarters of the only release")


def test_uncertain_verdicts_state_why_a_cause_is_uncertain() -> None:
    state = of_causes(cause("spring_joint1", probability=0.4), replace(COULOMB, probability=0.3))
    words = (
        f"spring_joint1 (probability only 40 %) and coulomb_joint1 (probability only 30 %).{limited('spring_joint1')}"
    )
    assert words in sentence("partly_explained", state, (10, 10), PREDICTED)
    candidates = f"are spring_joint1 (40 %) and coulomb_joint1 (30 %).{limited('spring_joint1')}. Record"
    assert candidates in sentence("too_short", state, (10, 10), PREDICTED)


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (0.35, "A remainder of 0.35 times the noise is significant, but smaller than the noise: a further small cause"),
        (4.1, "A remainder of 4.1 times the noise stays unexplained: a further cause acts"),
    ],
)
def test_the_words_for_a_remainder_fit_its_size(ratio: float, words: str) -> None:
    state = of_causes(COULOMB)
    state.selection.chosen = Fake(at_noise_floor=False, residuals=Fake(noise_ratio=ratio))
    assert words in sentence("partly_explained", state, (10, 10), PREDICTED)


def test_a_short_release_without_a_significant_effect_does_not_exclude_the_library() -> None:
    state: Any = Fake(
        description=Fake(hint="", withholds=False),
        fitted=Fake(problem=Fake(t=np.array([0.0, 1.3]))),
        selection=Fake(
            chosen=Fake(effects=(), residuals=GAP, at_noise_floor=False),
            bare=Fake(residuals=GAP, at_noise_floor=False),
            share_explained=0.0,
            expected=frozenset(),
        ),
        posteriors=(),
        transfer=transfer(0.0, basis="one release", too_short=True),
    )
    words = "Unexplained: a gap of 3 times the noise. This release of 1.3 s is too short to exclude the effects of the"
    assert sentence("unexplained", state, (10, 10), PREDICTED).startswith(words)
    state.transfer = transfer(0.0, basis="one release")
    assert "and no effect of the library fits it" in sentence("unexplained", state, (10, 10), PREDICTED)


def test_the_interval_decides_if_the_gap_is_below_half_of_the_noise() -> None:
    assert kind(transfer(0.4, 0.5, gap_ratio=0.49)) == "named"
    assert kind(transfer(0.4, 1.0, gap_ratio=0.5)) == "partly_explained"


def test_without_effects_the_remainder_decides_between_no_gap_and_unexplained() -> None:
    assert kind(causes=()) == "no_gap"
    assert kind(causes=(), chosen=SMALL) == "no_gap"
    assert kind(causes=(), chosen=Fake(z=8.0, noise_ratio=0.5)) == "unexplained"
    assert kind(transfer(basis="held-out runs", gap_ratio=1.0), causes=()) == "no_gap"
    assert kind(transfer(basis="held-out runs", gap_ratio=1.01), causes=()) == "unexplained"
    assert kind(transfer(gap_ratio=1.01), causes=()) == "no_gap"
    assert kind(causes=(), visible=(5, 10)) == "no_gap"
    assert kind(causes=(), visible=(4, 10)) == "inconclusive"


def test_a_free_run_far_outside_its_uncertainty_is_a_gap_unless_it_is_unpredictable() -> None:
    def with_runs(*runs: Any) -> str:
        return kind(causes=(), budget=Budget.model_construct(runs=list(runs)))

    assert with_runs() == "no_gap"
    assert with_runs(free_run(3.9e-3), free_run(1e-3)) == "no_gap"
    assert with_runs(free_run(4.1e-3), free_run(1e-3)) == "unexplained"
    assert with_runs(free_run(1.0, growth_per_s=1.6), free_run(1e-3)) == "unexplained"
    assert with_runs(free_run(1.0, growth_per_s=1.8)) == "no_gap"  # an initial error grows by more than 30
    deviating = Budget.model_construct(runs=[free_run(1.0)])
    assert kind(causes=(), visible=(4, 10), budget=deviating) == "unexplained"
    assert kind(budget=deviating) == "named"


def test_the_sentence_without_a_gap_states_the_worst_free_run() -> None:
    state: Any = Fake(
        description=Fake(hint="", withholds=False), selection=Fake(bare=Fake(residuals=NOISE, at_noise_floor=True))
    )
    words = sentence("no_gap", state, (10, 10), Budget.model_construct(runs=[free_run(0.00182), free_run(0.1, 1.8)]))
    limit = "1.8 mrad rms in the first 2 s, below the limit of 4 times its uncertainty (1 mrad from parameters, initial"
    assert limit in words
    assert sentence("no_gap", state, (10, 10), Budget.model_construct(runs=[])).endswith(
        "No free run is long and predictable enough for a test."
    )


def test_a_small_remainder_with_only_expected_effects_is_no_gap() -> None:
    assert kind(share=0.3, chosen=SMALL, bare=SMALL, expected=("a",)) == "no_gap"
    assert kind(share=0.3, chosen=SMALL, bare=SMALL) == "unexplained"
    assert kind(share=0.3, chosen=SMALL, bare=GAP, expected=("a",)) == "unexplained"


@pytest.mark.parametrize(
    ("closed", "upper", "open_"), [(0.0, 0.5, True), (0.0, 0.49, False), (0.01, 0.9, False), (-0.3, 1.0, True)]
)
def test_held_out_data_decide_nothing_if_their_gap_is_too_small_to_close(closed, upper, open_) -> None:
    assert held_out_gap_invisible(transfer(closed, upper)) is open_

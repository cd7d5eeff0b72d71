"""Shares, factors and intervals that follow from given numbers."""

from dataclasses import dataclass
from types import SimpleNamespace as Fake
from typing import Any, cast

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.conclusion import ratios
from dpr_lab.gap.conclusion.causes import _implied, _size, named_effect
from dpr_lab.gap.conclusion.ratios import determined
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.transfer.out_of_sample import block, reduction, share
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.transfer.transfer import _relative_to_fitted, _sum, judged, untested
from dpr_lab.identification.scaling.scale import Scale


@dataclass(frozen=True)
class Judged:
    """An effect with its probability."""

    name: str
    probability: float = 1.0
    untested: bool = False


def after_tests(*, forced: bool = False, remainder: bool = False, **outcome: Any) -> tuple[Any, ...]:
    """The effects a and b after a test, with their probabilities reduced from 1."""
    values: dict[str, Any] = {
        "basis": "releases left out",
        "tested": True,
        "closed": Interval(value=0.5, interval90=(0.0, 1.0)),
        "withdrawn": (),
        "unproven": (),
        "oversized": (),
        "worse_free_run": None,
        "lone": None,
    }
    others: dict[str, Any] = dict.fromkeys(("gap_ratio", "closing", "left_out", "held_out", "effects"))
    state = Transfer(**values | others | outcome)
    effects: Any = (Judged("a"), Judged("b"))
    return judged(state, effects, forced=forced, remainder=remainder)


def probabilities(**outcome: Any) -> list[float]:
    """Factors on the probabilities of the effects a and b after a test."""
    return [posterior.probability for posterior in after_tests(**outcome)]


def test_an_effect_that_fails_a_test_is_less_probable() -> None:
    assert probabilities() == [1.0, 1.0]
    assert probabilities(withdrawn=("a",)) == [0.5, 1.0]
    assert probabilities(withdrawn=("a",), oversized=("a",)) == [0.1, 1.0]
    assert probabilities(basis="one release", unproven=("b",)) == [1.0, 0.87]
    assert probabilities(basis="one release", unproven=("b",), remainder=True) == [1.0, 0.5]
    assert probabilities(remainder=True) == [1.0, 1.0]


def test_the_form_of_an_effect_with_several_parameters_is_untested_by_one_release_of_a_single_rod() -> None:
    assert probabilities(basis="one release", untested=("a",)) == [0.65, 1.0]
    assert probabilities(basis="one release", untested=("a", "b"), unproven=("a",)) == [0.65, 0.65]
    assert probabilities(basis="one release", untested=("a",), unproven=("a", "b"), remainder=True) == [0.5, 0.5]


@pytest.mark.parametrize(
    "smaller",
    [{"oversized": ("a",)}, {"unproven": ("a",), "remainder": True}, {"lone": Fake()}, {"worse_free_run": Fake()}],
)
def test_only_the_applied_limit_is_a_reason(smaller: dict[str, Any]) -> None:
    others: list[tuple[dict[str, Any], bool]] = [({}, True), ({"unproven": ("a",)}, True), (smaller, False)]
    for other, limited in others:
        a, b = after_tests(basis="one release", untested=("a",), **other)
        assert (a.untested, b.untested) == (limited, False)


@pytest.mark.parametrize("limited", [True, False])
def test_the_result_marks_an_untested_effect(limited: bool) -> None:
    posterior = EffectPosterior("spring_joint1", ("spring_joint1",), (), 0.64, untested=limited)
    chosen = Fake(estimate=Fake(params=effect_params({})))
    state: Any = Fake(selection=Fake(chosen=chosen, unique_share=lambda _: 0.5), intervals={})
    stored = named_effect(state, posterior, cast(Scale, None)).model_dump(by_alias=True)
    assert stored["untested"] is limited


@pytest.mark.parametrize(
    ("fitted", "held_out", "division", "alone", "expected"),
    [
        (["P1"], [], "", True, ("spring_joint1",)),
        (["P1"], [], "", False, ()),
        (["P1", "P2"], [], "", True, ()),
        (["P1"], ["P2"], "", True, ()),
        (["P1 0-10 s", "P1 20-30 s"], ["P1 10-20 s"], "divided", True, ("spring_joint1",)),
        (["P1 0-10 s", "P1 20-30 s"], [], "", True, ()),
    ],
    ids=["one release", "two rods", "two releases", "held-out run", "pieces of one release", "two films"],
)
def test_a_second_release_or_rod_tests_the_form(
    fitted: list[str], held_out: list[str], division: str, alone: bool, expected: tuple[str, ...]
) -> None:
    """Neither one parameter nor a class with such a member needs this test."""
    classes = {
        "spring_joint1": ("spring_joint1",),
        "coulomb_joint1": ("coulomb_joint1",),
        "hysteresis_joint1": ("hysteresis_joint1", "coulomb_joint1"),
    }
    recordings, others = (Fake(records=[Fake(run=Fake(name=name)) for name in names]) for names in (fitted, held_out))
    setups = [Fake(alone=alone) for _ in fitted]
    problem = Fake(segments=Fake(setups=setups))
    state: Any = Fake(recordings=recordings, held_out=others, division=division, problem=problem)
    effects: Any = [Fake(name=name, members=members) for name, members in classes.items()]
    assert untested(state, effects) == expected


def test_all_effects_are_less_probable_if_the_test_fails_as_a_whole() -> None:
    outcomes: tuple[dict[str, Any], ...] = ({"worse_free_run": Fake()}, {"lone": Fake()}, {"tested": False})
    for failed in outcomes:
        assert probabilities(**failed) == [0.5, 0.5]
    for value, factor in ((0.0, 1.0), (-0.1, 0.5)):
        assert probabilities(closed=Interval(value=value, interval90=(-1.0, 1.0))) == [factor] * 2
    assert probabilities(basis="one release", tested=False) == [0.5, 0.5]  # not for one effect: test_transfer
    assert probabilities(basis="one release", tested=False, remainder=True) == [0.5, 0.5]
    assert probabilities(forced=True) == [0.5, 0.5]
    assert probabilities(basis="one release", unproven=("a",), lone=Fake()) == [0.5, 0.5]


@pytest.mark.parametrize(
    ("fitted", "held_out", "ratio"),
    [(0.8, 0.4, 0.5), (0.8, 0.9, 1.0), (0.8, -0.1, 0.0), (0.2, 0.2, 0.4), (0.5, 0.5, 1.0)],
)
def test_the_share_on_held_out_data_is_relative_to_the_fitted_share(fitted, held_out, ratio) -> None:
    """The share of the fitted recordings counts as at least one half."""
    selection: Any = Fake(
        bare=Fake(residuals=Fake(excess=1.0)), chosen=Fake(residuals=Fake(excess=(1.0 - fitted) ** 2))
    )
    closed = Interval(value=held_out, interval90=(-1.0, 1.0))
    assert _relative_to_fitted(closed, selection) == pytest.approx(ratio)


@pytest.mark.parametrize(
    ("before", "after", "closed"), [(4.0, 1.0, 0.5), (4.0, -1.0, 1.0), (4.0, 64.0, -1.0), (0.0, 1.0, 0.0)]
)
def test_a_share_is_the_reduction_of_the_rms_above_the_noise(before: float, after: float, closed: float) -> None:
    assert share(np.array([[before], [after]])) == pytest.approx(closed)
    single = reduction(np.array([[before], [after]]), 0.0, np.random.default_rng(0), 1, np.zeros(1, dtype=np.int64))
    assert (single.value, single.interval90) == (pytest.approx(closed), (-1.0, 1.0))


def test_equal_reductions_of_all_segments_have_no_scatter() -> None:
    above = np.array([[4.0] * 12, [1.0] * 12])
    interval = reduction(above, 0.0, np.random.default_rng(0), 2, np.repeat([0, 1], 6))
    assert (interval.value, *interval.interval90) == pytest.approx((0.5, 0.5, 0.5))


def test_a_remainder_that_the_noise_hides_is_inside_the_interval() -> None:
    above = np.array([[100.0] * 12, [-1.0] * 12])
    interval = reduction(above, 20.0, np.random.default_rng(0), 2, np.repeat([0, 1], 6))
    assert (interval.value, *interval.interval90) == pytest.approx((1.0, 1 - np.sqrt(1.645 * 20 / 1200), 1.0), abs=1e-4)


@pytest.mark.parametrize(("length", "size"), [(0.25, 4), (0.5, 2), (1.0, 1), (3.0, 1)])
def test_neighbouring_segments_of_one_second_are_resampled_together(length: float, size: int) -> None:
    t = np.concatenate([start + np.linspace(0.0, length, 5) for start in (0.0, 10.0, 20.0)])
    problem: Any = Fake(t=t, segments=Fake(offsets=np.array([0, 5, 10, 15])))
    assert block(problem) == size


def test_a_sum_of_groups_is_significant_beyond_its_scatter() -> None:
    assert _sum(np.array([1.0, 3.0])) == pytest.approx((4.0, NORMAL_Q90 * 2.0))
    assert _sum(np.array([1.0])) == (1.0, np.inf)


def test_the_error_of_an_implied_quantity_adds_the_errors_of_the_parameters() -> None:
    effect: Any = Fake(implied=lambda values: {"sum": values["x"] + 2.0 * values["y"]})
    size = _implied(effect, {"x": 1.0, "y": 2.0}, {"x": 3.0, "y": 2.0})["sum"]
    assert (size.value, *size.interval90) == pytest.approx((5.0, 0.0, 10.0))
    assert size.interval90_with_scale == size.interval90
    unchanged: Any = Fake(implied=None)
    assert _implied(unchanged, {"x": 1.0}, {"x": 1.0}) == {}


def test_a_size_that_cannot_be_negative_has_no_negative_interval() -> None:
    scale = Scale(b=2.0, interval90=(1.0, 4.0), fixed_by="data")
    torque = _size(scale, "coulomb_joint1", "torque_Nm", 1.0, 1.5)
    assert torque.interval90 == (0.0, 2.5)
    assert torque.ratio is None  # the recordings determine the scale
    clamped = scale.model_copy(update={"fixed_by": "bound", "sizes90": (1.5, 3.0)})
    assert _size(clamped, "coulomb_joint1", "torque_Nm", 1.0, 0.1).ratio is None  # it determines no ratio to b
    offset = _size(scale, "encoder_offset_joint1", "offset_rad", 1.0, 1.5)
    assert offset.interval90 == (-0.5, 2.5)


def test_a_ratio_and_its_covariance_are_divided_by_the_same_inertia(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sizes of effects are no ratios; a ratio with a lower bound of zero has no negative interval."""
    free = [Fake(name="a/b", lower=-np.inf), Fake(name="size", lower=0.0), Fake(name="c1/b", lower=0.0)]
    free = [Fake(effect="", block="ratios", **vars(parameter)) for parameter in free]
    of = {"a/b": ("a/b", 3.0, 2.0), "c1/b": ("c1/b", 0.1, 4.0)}
    monkeypatch.setattr(ratios, "ratio_of", lambda parameter, *_, **__: of.get(parameter.name))
    monkeypatch.setattr(ratios, "only_inner", lambda _: True)
    problem, fit, rig = (
        Fake(segments=Fake(setups=())),
        Fake(free=free, estimate=None),
        Fake(),
    )
    of_fit = np.array([[4.0, 1.0, 8.0], [1.0, 1.0, 1.0], [8.0, 1.0, 16.0]])
    values, covariance = determined(cast(Any, problem), cast(Any, fit), of_fit, cast(Any, rig))
    assert values["a/b"].interval90 == pytest.approx((3.0 - 1.645, 3.0 + 1.645), rel=1e-3)
    assert values["c1/b"].interval90 == (0.0, pytest.approx(0.1 + 1.645, rel=1e-3))
    assert covariance == pytest.approx(np.array([[1.0, 1.0], [1.0, 1.0]]))

"""Prior of the size of a scale error and of a spring, which imitate each other on a single rod."""

from types import SimpleNamespace
from typing import Any, Literal, cast
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.effects import effect_params, plausibility
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.gap.classes.posterior import Alternative, _plausibility, _Replacements, _size_odds
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.significance import member_odds
from dpr_lab.gap.hypothesis.size_prior import SIZE_PRIOR, fitted_prior, gravity_torques, size_prior
from dpr_lab.rig import load_rig
from dpr_lab.setup import Setup

SCALE, SPRING = "encoder_scale_joint1", "spring_joint1"


def prior(effect: str, counts: float = 4096.0, gravity: float = 1.0, **sizes: float) -> float:
    constants: Any = SimpleNamespace(counts_per_rev1=counts, counts_per_rev2=1.0)
    return size_prior(effect_params({effect: sizes}), effect, (gravity, 0.0), constants)


@pytest.mark.parametrize(
    ("excess", "weight"),
    [(0.0, 1.0), (2e-3, 0.975), (4000 / 4096 - 1, 0.5), (0.05, 0.03), (-0.15, 0.03), (4800 / 4096 - 1, 0.5)],
)
def test_a_scale_is_a_tolerance_or_that_of_another_encoder_or_arbitrary(excess: float, weight: float) -> None:
    assert prior(SCALE, excess=excess) == pytest.approx(weight, abs=1e-3)
    assert prior(SCALE, counts=-4096.0, excess=excess) == pytest.approx(weight, abs=1e-3)


def test_a_spring_is_relative_to_the_gravity_torque_of_the_rig() -> None:
    """The scale is 3e-3 N m/rad on a light rig, and a part of the gravity torque on a heavy rig."""
    light, strong = (
        prior(SPRING, gravity=gravity, stiffness_Nm_per_rad=size) for gravity, size in ((0.1, 6e-3), (2.0, 0.6))
    )
    assert light == pytest.approx(1 / (1 + 2.0**4))
    assert strong == SIZE_PRIOR.arbitrary == prior(SCALE, excess=0.1)
    friction = effect_params({"coulomb_joint1": {"torque_Nm": 0.03}})
    assert prior("coulomb_joint1", gravity=3.0, torque_Nm=0.03) == plausibility(friction, "coulomb_joint1")


@pytest.mark.parametrize("mounting", ["inner", "outer", "both"])
@pytest.mark.parametrize("name", ["paper", "furuta"])
def test_a_spring_and_the_scale_error_that_it_imitates_have_equal_weights(
    name: str, mounting: Literal["inner", "outer", "both"]
) -> None:
    """The gravity torque is that of the mounted rods, which are so heavy that usual cables are weaker."""
    rig, heavy = load_rig(name), 1000.0
    whole = heavy * whole_parameters(rig.nominal, rig.L1, rig.g)
    problem: Any = Mock(segments=Mock(setups=[Setup(mounting=mounting)]), model=Mock(constants=rig_constants(rig)))
    l1, l2, m1, m2, mb, *_ = rig.nominal
    weight1, weight2, bearing = heavy * rig.g * np.array([m1, m2, mb])
    expected = {"inner": weight1 * l1 + bearing * rig.L1, "outer": weight2 * l2}
    expected["both"] = sum(expected.values()) + weight2 * rig.L1
    gravity = gravity_torques(problem, cast("Any", Mock(whole=whole)))
    assert gravity == pytest.approx((expected[mounting], expected["outer"] if mounting == "both" else 0.0))
    for excess in (1e-3, 5e-3, 8e-3):
        spring = prior(SPRING, gravity=gravity[0], stiffness_Nm_per_rad=2 * excess * expected[mounting])
        assert spring == pytest.approx(prior(SCALE, excess=excess))


@pytest.mark.parametrize(
    ("named", "other", "cosine", "odds"),
    [(SCALE, SPRING, 1.0, 8.0), (SPRING, SCALE, 1.0, 1 / 8), (SCALE, SPRING, 0.99, 1.0),
     ("coulomb_joint1", "stribeck_joint1", 1.0, 1.0), (SCALE, "base_tilt", 1.0, 8.0)],
)  # fmt: skip
def test_sizes_decide_if_an_alternative_imitates_the_effect_completely(
    named: str, other: str, cosine: float, odds: float
) -> None:
    """The prior odds of the effects count separately."""
    weights = {SCALE: 0.1, SPRING: 0.8, "coulomb_joint1": 10.0, "stribeck_joint1": 0.1, "base_tilt": 8.0}
    selection: Any = Mock(
        chosen=Mock(priors=weights), without={named: Mock(key=frozenset())},
        fitted={frozenset({other}): Mock(priors=weights)},
    )  # fmt: skip
    ratio = _size_odds(_Replacements(selection, named), Alternative(other, cosine, 1.0))
    assert ratio == pytest.approx(odds)


@pytest.mark.parametrize(("other", "share"), [(SPRING, np.exp(-2.0)), ("stribeck_joint1", 1.0)])
def test_a_member_with_more_parameters_also_costs_the_difference_of_the_criterion(other: str, share: float) -> None:
    named = "coulomb_joint1" if other != SPRING else SCALE
    fitted = Mock(priors={other: 0.5}, cost=100.0 + 2 * CALIBRATION.unit(1.0), penalty=36.0)
    selection: Any = Mock(
        chosen=Mock(cost=100.0, inflation=1.0, penalty=18.0, priors={named: 0.1}),
        without={named: Mock(key=frozenset())},
        fitted={frozenset({other}): fitted},
    )  # fmt: skip
    score = cast("Any", SimpleNamespace(effect=SimpleNamespace(name=other)))
    assert _plausibility(_Replacements(selection, named), score) == pytest.approx(0.5 * share)


def test_a_member_with_fewer_parameters_gains_at_most_their_penalty() -> None:
    """The rest of the difference of the criterion can be an error of the integrator."""
    spring = cast("Hypothesis", Mock(cost=119.0, inflation=1.0, penalty=36.0, priors={SPRING: 0.6}))
    for cost, gain in ((113.0, np.e), (0.0, np.exp(3.0))):
        scale = cast("Hypothesis", Mock(cost=cost, penalty=18.0, priors={SCALE: 0.03}))
        assert member_odds(scale, spring, SPRING, SCALE) == pytest.approx(0.05 * gain)


@pytest.mark.parametrize(
    ("cubic", "variance", "saved"),
    [(0.0, 4e-6, 9.0), (0.004, 4e-6, 9.0 - 4.0), (0.02, 4e-6, 0.0), (-0.02, -1e-9, 9.0)],
)
def test_a_linear_spring_does_not_pay_the_penalty_of_its_cubic_term(
    monkeypatch: pytest.MonkeyPatch, cubic: float, variance: float, saved: float
) -> None:
    """The cubic term has a standard deviation of 0.002 and correlates with the stiffness.

    A rounded covariance with a negative variance saves at most the penalty.
    """
    names = ("stiffness_Nm_per_rad", "cubic_Nm_per_rad3")
    covariance = np.array([[1e-4, -1e-5], [-1e-5, variance]])
    monkeypatch.setattr("dpr_lab.gap.hypothesis.size_prior.considered", lambda *_: covariance)
    params = effect_params({SPRING: dict(zip(names, (0.1, cubic), strict=True))})
    fit = cast(
        "Fit",
        SimpleNamespace(
            free=[SimpleNamespace(effect=SPRING, name=name) for name in names],
            values=np.array([0.1, cubic]),
            estimate=SimpleNamespace(params=params),
        ),
    )
    weight = fitted_prior(fit, SPRING, (0.3, 0.0), cast("Any", None), inflation=1.0, penalty=9.0)
    assert weight == pytest.approx(SIZE_PRIOR.arbitrary * np.exp(saved / CALIBRATION.unit(1.0)))

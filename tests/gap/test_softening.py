"""A spring of one rod that softens like a scale error of its encoder is not named."""

from dataclasses import dataclass
from types import SimpleNamespace as Fake

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.which import sizes
from dpr_lab.gap.which.sizes import SIZES, springs_like_scale
from tests.background_rigs import law, laws, recordings
from tests.thinned import candidates

SCALE = ("encoder_scale_joint1",)


@dataclass(frozen=True)
class Mounted:
    held: bool = True


def named(cubic: float, std: float, monkeypatch, *, library=SCALE, held: bool = True) -> tuple[str, ...]:
    """Springs named as a scale error, for one of 0.1 N m/rad with a cubic term of a standard deviation."""
    params = effect_params({"spring_joint1": dict(zip(SIZES, (0.1, cubic), strict=True))})
    free = [Fake(effect="spring_joint1", name=name) for name in SIZES]
    monkeypatch.setattr(sizes, "considered", lambda *_: np.diag([1.0, std**2]))
    problem = Fake(segments=Fake(setups=(Mounted(held),)))
    estimate = Fake(params=params)
    model = Fake(effects=("spring_joint1",), fit=Fake(free=free), estimate=estimate, inflation=1.0)
    return springs_like_scale(problem, library, model)


@pytest.mark.parametrize("arc", [0.5, 1.5, 3.0])
def test_a_scale_error_is_a_softening_spring_and_less_gravity(arc):
    q = np.linspace(-arc, arc, 400)
    terms = np.column_stack([np.sin(q), q, q**3])
    change = np.sin(q) - q * np.cos(q)
    (gravity, stiffness, cubic), *_ = np.linalg.lstsq(terms, change, rcond=None)
    assert np.std(change - terms @ [gravity, stiffness, cubic]) < 0.005 * np.std(change)
    assert cubic / stiffness == pytest.approx(-1 / 12, rel=0.15)
    assert gravity == pytest.approx(-stiffness, rel=0.01)


def test_only_a_spring_that_softens_like_it_is_impossible(monkeypatch):
    like = -0.1 / 12
    assert named(like, 0.001, monkeypatch) == ("spring_joint1",)
    assert not named(0.0, 0.001, monkeypatch)
    assert not named(3 * like, 0.001, monkeypatch)
    assert not named(like, 0.01, monkeypatch), "a linear spring is as likely"


def test_both_rods_or_a_scale_that_is_not_fitted_leave_it_possible(monkeypatch):
    assert not named(-0.1 / 12, 0.001, monkeypatch, held=False)
    assert not named(-0.1 / 12, 0.001, monkeypatch, library=())


@pytest.mark.long
def test_a_scale_error_is_not_replaced_by_a_softening_spring():
    """Friction in one direction, which no effect describes, is fitted by the constant torque of a spring."""
    of_rig = [of for of in laws(np.random.default_rng([97021, 9]), rods=1, dominant=True) if "spring" not in of.name]
    of_rig = [of for of in of_rig if not of.name.startswith("encoder_scale")]
    rig, runs, _ = recordings(97021, [*of_rig, law("encoder_scale", 0, 200.0)], rods=1)
    library = candidates("coulomb", "stribeck", "spring", "encoder", "air_drag", "detent")
    effects = {effect.name: effect.parameters for effect in diagnose(runs, rig, library=library).effects}
    assert "encoder_scale_joint1" in effects
    if spring := effects.get("spring_joint1"):
        low, high = spring["stiffness_Nm_per_rad"].interval90
        assert low <= 0 <= high

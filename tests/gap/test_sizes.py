"""Sizes that no rig can have, beyond the errors of the fit."""

from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import effect_params
from dpr_lab.errors import IdentificationError
from dpr_lab.fitting.estimate import ratio_parameters
from dpr_lab.gap.which import sizes

OFFSET, SPRING = "com_offset_link1", "spring_joint2"


@pytest.mark.parametrize(
    ("offset", "std", "off"),
    [(0.05, 0.002, True), (-0.05, 0.002, True), (0.05, 0.02, False), (0.01, 0.0005, False), (0.0, 0.01, False)],
)
def test_a_rod_does_not_hang_at_more_than_45_degrees_of_its_axis(monkeypatch, offset, std, off):
    """Gravity torque 0.3 N m with a mass of 1 kg: the centre of mass lies 31 mm along the rod."""
    estimate = Fake(params=effect_params({OFFSET: {"offset_m": offset}}), ratios=np.full(7, 0.1))
    monkeypatch.setattr(sizes, "considered", lambda *_: np.array([[std**2]]))
    monkeypatch.setattr(sizes, "_gravity_torque", lambda *_: 3.0)
    problem: Any = Fake(model=Fake(constants=Fake(m1=1.0, g=9.81)))
    model: Any = Fake(fit=Fake(free=[Fake(effect=OFFSET, name="offset_m")]), estimate=estimate, inflation=1.0)
    assert sizes.off_axis(problem, model) == ((OFFSET,) if off else ())


def test_the_ends_of_each_fitted_interval_and_zero_inside_it_are_tested_together() -> None:
    tested: set[tuple[float, ...]] = set()
    effect: Any = Fake(possible=lambda chosen: tested.add(tuple(chosen[name] for name in "xyz")))
    assert sizes.impossible_together(effect, {"x": 1.0, "y": -2.0, "z": 4.0}, {"x": 1.5, "y": 0.5})
    assert tested == {(x, y, 4.0) for x in (1.0, -0.5, 2.5, 0.0) for y in (-2.0, -2.5, -1.5)}


@pytest.mark.parametrize(
    ("stiffness", "std", "free", "impossible"),
    [
        (-1e-3, 0.4e-3, True, True),
        (-1e-3, 0.6e-3, True, False),
        (-1e-3, 1.0, False, True),  # the stiffness is not fitted
        (1e-3, 1.0, True, True),  # the stiffness is possible, so another size is at its limit
    ],
)
def test_an_impossible_size_is_significant_beyond_two_standard_deviations(
    monkeypatch, stiffness: float, std: float, free: bool, impossible: bool
) -> None:
    name = "stiffness_Nm_per_rad"
    parameters = [Fake(effect=effect, name=name) for effect in (OFFSET, *([SPRING] if free else []))]
    monkeypatch.setattr(sizes, "considered", lambda *_: np.diag([1.0, std**2]))
    monkeypatch.setattr(sizes, "oversized", lambda *_: (SPRING,))
    estimate = Fake(params=effect_params({SPRING: {name: stiffness}}))
    model: Any = Fake(fit=Fake(free=parameters), estimate=estimate, inflation=1.0)
    assert sizes.significantly_oversized(model, None) == ((SPRING,) if impossible else ())


@pytest.mark.parametrize(
    ("torque", "std", "lifted"),
    [(-3.0, 1.4, True), (-3.0, 1.6, False), (3.0, 0.1, False), (0.0, 0.0, False), (None, 0.1, False)],
)
def test_gravity_lifts_a_rod_only_beyond_two_standard_deviations(monkeypatch, torque, std, lifted) -> None:
    estimate: Any = Fake(ratios=np.ones(len(RATIOS)))
    free = ratio_parameters(estimate, [RATIOS.index("a/b"), RATIOS.index("e1/b")])
    monkeypatch.setattr(sizes, "considered", lambda *_: np.diag([100.0, std**2]))
    monkeypatch.setattr(sizes, "_gravity_torque", lambda *_: torque)
    model: Any = Fake(fit=Fake(free=free), estimate=estimate, inflation=1.0, effects=("spring_joint1",))
    problem: Any = Fake()
    assert sizes.rises(problem, model) is lifted
    if lifted:
        with pytest.raises(IdentificationError, match=r"upwards \(.* -3 1/s\^2\).* contains spring_joint1"):
            sizes.refuse_rising(problem, model)
    else:
        sizes.refuse_rising(problem, model)
    fixed: Any = Fake(fit=Fake(free=free[:1]), estimate=estimate, inflation=1.0)
    assert not sizes.rises(problem, fixed)

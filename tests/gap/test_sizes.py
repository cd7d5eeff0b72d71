"""Sizes that no rig can have, beyond the errors of the fit."""

from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.gap.which import sizes

OFFSET = "com_offset_link1"


@pytest.mark.parametrize(
    ("offset", "std", "off"),
    [(0.05, 0.002, True), (-0.05, 0.002, True), (0.05, 0.02, False), (0.01, 0.0005, False)],
)
def test_a_rod_does_not_hang_at_more_than_45_degrees_of_its_axis(monkeypatch, offset, std, off):
    """Gravity torque 0.3 N m with a mass of 1 kg: the centre of mass lies 31 mm along the rod."""
    fit = Fake(
        estimate=Fake(params=effect_params({OFFSET: {"offset_m": offset}}), ratios=np.full(7, 0.1)),
        free=[Fake(effect=OFFSET)],
    )
    monkeypatch.setattr(sizes, "considered", lambda *_: np.array([[std**2]]))
    monkeypatch.setattr(sizes, "_gravity_torque", lambda *_: 3.0)
    problem: Any = Fake(model=Fake(constants=Fake(m1=1.0, g=9.81)))
    model: Any = Fake(fit=fit, residuals=Fake(inflation=1.0))
    assert sizes.off_axis(problem, model) == ((OFFSET,) if off else ())

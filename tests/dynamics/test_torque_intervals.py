"""Lookup of the interval of a known torque at an instant."""

from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.lanes.driving import Knots, _interval


class Counted:
    """Array that counts how often its elements are read."""

    def __init__(self, values: Any) -> None:
        self.values, self.reads = values, 0

    def __getitem__(self, index: int) -> float:
        self.reads += 1
        return float(self.values[index])


@pytest.mark.parametrize("hint", [0, 4000, 9000])
@pytest.mark.parametrize("t", [-1.0, 0.0, 0.13, 79.0, 100.0])
def test_the_interval_of_a_torque_is_found_in_few_steps_from_any_other(hint: int, t: float) -> None:
    instants = np.linspace(0.0, 80.0, 10_000)
    counted: Any = Counted(instants)
    result = _interval(Knots(counted, np.zeros((10_000, 2)), np.array([0, 10_000])), 0, hint, t)
    assert counted.reads < 50
    assert result == np.clip(np.searchsorted(instants, t, side="right") - 1, 0, len(instants) - 2)

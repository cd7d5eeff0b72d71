"""Exchange of an effect for a simpler one: its amplitudes are handed over."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.which import restarts


@pytest.mark.parametrize("torque", [0.0, 0.3])
def test_an_effect_of_any_size_hands_its_amplitudes_over(torque: float, monkeypatch: pytest.MonkeyPatch) -> None:
    start = Estimate.of(np.ones(7), effect_params({"stribeck_joint1": {"torque_Nm": torque}}), np.zeros((1, 4)))
    monkeypatch.setattr(restarts, "refit", lambda problem, start, names, iterations: start)
    sets = cast(Any, SimpleNamespace(library=EFFECTS, problem=None))
    model = cast(Any, SimpleNamespace(estimate=start, effects=("stribeck_joint1",)))
    exchanged = cast(Any, restarts._replaced_from_amplitudes(sets, model, "stribeck_joint1", "coulomb_joint1"))
    assert exchanged.params[param_index("coulomb_joint1", "torque_Nm")] == torque

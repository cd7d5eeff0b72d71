"""Intervals of the corrected model after insignificant amplitudes were set to zero."""

from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.exports import corrected
from dpr_lab.exports.corrected import rod_values
from dpr_lab.fitting.estimate import SCALE, unknown_ratios
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import Rig
from dpr_lab.setup import BOTH


def test_no_interval_of_a_friction_is_moved_below_zero(paper: Rig) -> None:
    unknown = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    fitted, friction = dict(zip(RATIOS, unknown.tolist(), strict=False)), RATIOS.index("c1/b")
    intervals = {name: Interval(value=value, interval90=(0.9 * value, 1.1 * value)) for name, value in fitted.items()}
    covariance = np.diag((0.06 * unknown) ** 2)
    unknown[friction] = 0.0
    values = rod_values(unknown, covariance, intervals, None, [BOTH], paper)
    low, high = values["ratios"]["c1/b"].interval90
    assert low == 0.0 < high
    assert values["base"]["c1"].interval90[0] == 0.0


def test_a_clipped_interval_of_the_scale_keeps_a_possible_covariance(
    paper: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """b is uncertain by 100 % and correlated with a/b, so its lower end is clipped above zero."""
    unknown = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    std = np.abs(0.05 * unknown)
    std[SCALE] = b = float(unknown[SCALE])
    covariance = np.diag(std**2)
    covariance[0, SCALE] = covariance[SCALE, 0] = 0.95 * std[0] * b
    scale = Scale(b=b, interval90=(1e-3 * b, b * (1 + NORMAL_Q90)), fixed_by="data")
    intervals = {
        name: Interval.about(value, 0.1 * value) for name, value in zip(RATIOS, unknown.tolist(), strict=False)
    }
    used, posterior_of = list[np.ndarray](), corrected.posterior_of

    def watched(*args: Any, **options: Any) -> Any:
        used.append(args[3])
        return posterior_of(*args, **options)

    monkeypatch.setattr(corrected, "posterior_of", watched)
    rod_values(unknown, covariance, intervals, scale, [BOTH], paper)
    assert np.linalg.eigvalsh(used[0]).min() > 0.0

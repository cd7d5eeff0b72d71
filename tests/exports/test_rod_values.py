"""Intervals of the corrected model after insignificant amplitudes were set to zero."""

import numpy as np

from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.exports.corrected import rod_values
from dpr_lab.fitting.estimate import unknown_ratios
from dpr_lab.gap.result.saved import Interval
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

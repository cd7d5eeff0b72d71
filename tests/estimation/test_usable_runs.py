"""Runs with a gap in which the motion cannot be predicted are refused."""

import numpy as np
import pytest

from dpr_lab.errors import IdentificationError
from dpr_lab.estimation.usable_runs import refuse_long_gaps
from dpr_lab.run import Run

T = np.arange(0.0, 2.0, 0.005)


def run_at(t: np.ndarray) -> Run:
    return Run("swing", t, np.zeros((len(t), 3)), None, None, "paper", "", 200.0)


def test_a_gap_too_long_for_a_prediction_is_refused() -> None:
    with pytest.raises(IdentificationError, match=r"swing: has an interruption of 5 s at 1 s.*--start-s, --duration-s"):
        refuse_long_gaps([run_at(T), run_at(T + 5.0 * (T > 1.001))])


@pytest.mark.parametrize(
    "t",
    [T + 2.9 * (T > 1.001), T - 9.0 * (T < 0.1), 1e3 * (T + 0.05 * (T > 1.001)), np.zeros(0)],
    ids=["short", "before the release", "ms read as s", "without samples"],
)
def test_other_gaps_are_accepted(t: np.ndarray) -> None:
    refuse_long_gaps([run_at(t)])

"""Expected bits of a check and of a plan about the same causes."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.cli.plan import BITS
from dpr_lab.gap.advice.check_kind import expected_bits
from dpr_lab.planning.worth.criteria import OpenPairs, cause_bits
from dpr_lab.report.gap.check_tables import EXPECTED_NOTE


def test_both_outputs_state_why_the_bits_of_a_check_and_of_a_plan_differ() -> None:
    assert "count indistinguishable causes as one cause" in BITS
    assert "A check counts indistinguishable causes as one" in EXPECTED_NOTE


def test_a_plan_counts_single_causes_and_a_check_their_class() -> None:
    """An exact recording: the check compares 0.9 with 0.08, the plan 0.6 with 0.08. Without a twin both agree."""
    pairs = OpenPairs(("cause", "twin", "other"), np.array([0.6, 0.3, 0.08]), 0.02, (), (), (), ())
    of_plan = cause_bits(pairs, np.full((3, 3), 400.0))["cause", "other"]
    assert of_plan == pytest.approx(expected_bits([0.6, 0.08], np.inf), abs=2e-3)
    assert expected_bits([0.9, 0.08], np.inf) - of_plan > 0.02
    alone = replace(pairs, names=("cause", "other"), probabilities=np.array([0.9, 0.08]))
    of_plan = cause_bits(alone, np.full((2, 2), 400.0))["cause", "other"]
    assert of_plan == pytest.approx(expected_bits([0.9, 0.08], np.inf), abs=2e-3)

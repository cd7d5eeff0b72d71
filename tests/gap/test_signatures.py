"""Effects that a fitted effect absorbs."""

from collections.abc import Mapping
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest

TILT, ZERO = EFFECTS["base_tilt"], EFFECTS["encoder_offset_joint1"]


@pytest.mark.parametrize(
    ("absorbed", "is_equal"),
    [({}, False), ({"offset_rad": "tilt_rad"}, True), ({"offset_rad": "e1/b"}, False)],
    ids=["not absorbed", "by the tilt", "by a ratio"],
)
def test_a_named_tilt_absorbs_a_zero_error(absorbed: Mapping[str, str], is_equal: bool) -> None:
    """At the fit without the tilt, cogging that imitates it reduced the cosine of both to 0.997."""
    zero = Score(ZERO, {}, 0.0, (), (), np.zeros(1), absorbed)
    selected = ScoreTest(Mock(), Mock(), (), Mock(), Mock(), shaped={ZERO.name: (zero,)})
    assert selected.absorbs(ZERO, by=TILT) == is_equal

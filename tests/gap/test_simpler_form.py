"""Replacement of a richer form by a simpler one if only the richer form has an impossible size."""

from typing import Any
from unittest.mock import Mock

import pytest

from dpr_lab.gap.which.replacements import POSSIBLE_SIZE
from dpr_lab.gap.which.search import Proposal


@pytest.mark.parametrize(
    ("before", "after", "accepted"),
    [(8.0, 16.0, True), (8.0, 32.0, False), (1.0, 2.0, True), (1.0, 8.0, False)],
    ids=["above the noise", "no explanation", "at the noise floor", "leaves the noise floor"],
)
def test_a_simpler_form_replaces_one_of_impossible_size_unless_it_explains_too_little(
    before: float, after: float, accepted: bool
) -> None:
    """The residuals are in standard deviations of the noise; 4 is the noise floor."""
    models = [Mock(bounded_excess=max(z, 4.0), at_noise_floor=z < 4.0, cost=z) for z in (before, after)]
    current, simpler = models
    sets: Any = Mock(oversized=lambda model: ("drift",) if model is current else ())
    assert POSSIBLE_SIZE.accept(sets, current, Proposal(simpler)).accepted == accepted

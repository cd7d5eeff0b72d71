"""Fixtures of the tests of the diagnosis."""

from dataclasses import replace

import pytest

from dpr_lab.gap.evidence import exclusions
from dpr_lab.gap.transfer import gap_size
from tests.thinned import FULL


@pytest.fixture(autouse=True)
def brief_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compute the gap for fewer segment lengths, and absent vibrations in a shorter part of each recording.

    Session fixtures such as `two_found` precede this one and compute all of it, as `test_diagnose.py` does.
    """
    if not FULL:
        monkeypatch.setattr(gap_size, "HORIZONS_S", (0.25, 0.5))
        monkeypatch.setattr(exclusions, "SHAPES", replace(exclusions.SHAPES, longest_s=2.0))

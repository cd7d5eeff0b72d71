"""Reduced set of interpretations of a recording, to make fast tests faster."""

import re

import pytest

from dpr_lab.identification.misread import tried
from dpr_lab.identification.misread.readings import Misreading, readings
from dpr_lab.rig import Rig
from tests.thinned import FULL

EACH = 5
"""Every n-th interpretation that is not expected is kept."""


def compare_few(monkeypatch: pytest.MonkeyPatch, expected: str) -> None:
    """From now on, compare with the interpretations whose cause matches a pattern, and with a fifth of the others.

    `make test-all` compares with all of them, and so do some tests of `make test`.
    """

    def some(rig: Rig) -> tuple[Misreading, ...]:
        return tuple(one for k, one in enumerate(readings(rig)) if k % EACH == 0 or re.search(expected, one.cause))

    if not FULL:
        monkeypatch.setattr(tried, "readings", some)

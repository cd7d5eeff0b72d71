"""Tables of cases too long for every day."""

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(cases: Iterable[Any], each: int) -> list[Any]:
    """Cases to parametrise by, of which `make test` takes every so manieth; `make test-all` takes them all."""
    return [pytest.param(case, marks=[pytest.mark.long] * (k % each > 0)) for k, case in enumerate(cases)]

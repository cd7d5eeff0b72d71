"""Reduced tables of cases and libraries of effects, for fast tests."""

import os
from collections.abc import Collection, Iterable
from itertools import product
from typing import Any

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect

FULL = os.environ.get("DPR_LAB_FULL") == "1"


def thinned(cases: Iterable[Any], each: int) -> list[Any]:
    """Cases for parametrisation. Fast tests use every n-th case, `make test-all` uses all."""
    return [pytest.param(case, marks=[pytest.mark.long] * (k % each > 0)) for k, case in enumerate(cases)]


def covered(*tables: Collection[Any]) -> list[Any]:
    """Combinations of values for parametrisation.

    In fast tests, each value occurs at least once; otherwise all are used.
    """
    values = list(map(list, tables))
    chosen = {tuple(k % len(table) for table in values) for k in range(max(map(len, values)))}
    places = product(*(range(len(table)) for table in values))
    marks = {True: (), False: pytest.mark.long}
    return [
        pytest.param(*(table[i] for table, i in zip(values, place, strict=True)), marks=marks[place in chosen])
        for place in places
    ]


def candidates(*kinds: str) -> dict[str, Effect]:
    """Candidate effects: in fast tests those with these prefixes, otherwise all."""
    return {name: effect for name, effect in EFFECTS.items() if FULL or name.startswith(kinds)}

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
    """Cases to parametrise by, of which `make test` takes every so manieth; `make test-all` takes them all."""
    return [pytest.param(case, marks=[pytest.mark.long] * (k % each > 0)) for k, case in enumerate(cases)]


def covered(*tables: Collection[Any]) -> list[Any]:
    """Combinations of values of tables to parametrise by: in `make test` so few that each value occurs, then all."""
    values = list(map(list, tables))
    chosen = {tuple(k % len(table) for table in values) for k in range(max(map(len, values)))}
    places = product(*(range(len(table)) for table in values))
    marks = {True: (), False: pytest.mark.long}
    return [
        pytest.param(*(table[i] for table, i in zip(values, place, strict=True)), marks=marks[place in chosen])
        for place in places
    ]


def candidates(*kinds: str) -> dict[str, Effect]:
    """Effects to choose from: in `make test` those whose names begin so, in `make test-all` all that there are."""
    return {name: effect for name, effect in EFFECTS.items() if FULL or name.startswith(kinds)}

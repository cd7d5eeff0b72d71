"""Fits that cannot change a diagnosis are not made."""

from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from dpr_lab.gap.which import replacements, select
from dpr_lab.gap.which.replacements import fit_alternatives
from dpr_lab.gap.which.search import SearchState
from dpr_lab.gap.which.select import refined


@pytest.mark.parametrize(("increase", "expected"), [(0.5, ["first"]), (1.5, ["image"]), (2.5, [])])
def test_a_hopeless_alternative_is_only_fitted_from_the_selected_solution(
    monkeypatch: pytest.MonkeyPatch, increase: float, expected: list[str]
) -> None:
    """The increase of the criterion is that of both fits, relative to the largest change by chance."""
    cost, restarted = 100.0 + 10.0 * increase, list[str]()
    first, image = SimpleNamespace(name="first", cost=cost), SimpleNamespace(name="image", cost=cost)
    sets = Mock()
    sets.test.return_value = Mock(ranking=[], of=lambda _: None)
    sets.with_one.return_value = first
    monkeypatch.setattr(replacements, "simpler_forms", lambda *_: [])
    monkeypatch.setattr(replacements, "_indistinguishable", lambda *_: [Mock()])
    monkeypatch.setattr(replacements, "replaced_linearly", lambda *_: image)
    monkeypatch.setattr(replacements, "escaped", lambda _, model: restarted.append(model.name))
    fit_alternatives(sets, Mock(effects=("named",), at_noise_floor=False, cost=100.0, chance=10.0))
    assert restarted == expected


def test_a_local_minimum_of_the_bare_model_is_looked_for_with_one_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    removed, bare = list[str](), Mock(far_from_noise=True, at_noise_floor=False)
    bare.fit.chi2 = 1.0
    selection = Mock(bare=bare, chosen=Mock(effects=("first", "second")), path=(("first", bare), ("second", bare)))
    monkeypatch.setattr(select, "refit_without", lambda _, model, name, bare: removed.append(name) or bare)
    monkeypatch.setattr(select, "_one_search", lambda state: selection)
    assert refined(SearchState(bare, Mock(), 2)) is selection
    assert removed == ["first"]

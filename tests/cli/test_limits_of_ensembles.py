"""Limits that `dpr-lab export --ensemble` states."""

from pathlib import Path

from dpr_lab.cli.export import _limits
from dpr_lab.workflows.export_ensemble import EnsembleResult


def test_a_missing_scatter_is_not_blamed_on_recordings_that_are_there() -> None:
    result = EnsembleResult(Path(), (), {}, 1.0, 1.0, 0.9, (), None, from_diagnosis=False, scatter=False)
    (sentence,) = _limits(result, 19)
    assert "not found" not in sentence
    assert "requires a clamped arm and the recordings at their stored paths" in sentence

"""Corrections of the recordings that a search implies."""

from types import SimpleNamespace
from typing import Any

import pytest

from dpr_lab.gap import corrections


def test_an_unnecessary_correction_of_the_noise_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(corrections, "with_other_noise", lambda *state: calls.append(state))
    for name in ("likeliest_shutter", "likeliest_camera"):
        monkeypatch.setattr(corrections, name, lambda *_: 0.0)
    recordings = SimpleNamespace(with_camera=lambda _: recordings)
    fitted = SimpleNamespace(recordings=recordings, held_out=recordings, problem=None, bare=None)
    state: Any = SimpleNamespace(fitted=fitted, search=SimpleNamespace(current=SimpleNamespace(effects=())))
    assert corrections.corrected(state, lambda _: state) is state
    assert len(calls) == 1

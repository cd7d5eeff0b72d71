from dataclasses import fields
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from dpr_lab.gap import diagnose
from dpr_lab.gap.corrections import ForwardSelected
from dpr_lab.gap.state import Fitted
from dpr_lab.gap.where.locate import locate
from tests import one_rod


def test_the_gap_is_located_for_the_bare_model_of_the_selected_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that finds a better bare model replaces the minimum to which the first maps belong."""
    values: dict[str, Any] = dict.fromkeys((field.name for field in fields(Fitted)), None)
    fitted = Fitted(**values | {"bare": "first", "residual_maps": "of first", "request": Mock()})
    for bare, places in (("first", "of first"), ("better", "of better")):
        selection = Mock(bare=bare, path=[])
        monkeypatch.setattr(diagnose, "refined", lambda _, selection=selection: selection)
        monkeypatch.setattr(diagnose, "with_other_noise", lambda *_: None)
        monkeypatch.setattr(diagnose, "refuse_impossible_scale", lambda *_: None)
        monkeypatch.setattr(diagnose, "_begin", lambda *_: None)
        monkeypatch.setattr(diagnose, "locate", lambda _, bare: f"of {bare}")
        selected = diagnose._selected(ForwardSelected(fitted, Mock()))
        assert (selected.fitted.bare, selected.fitted.residual_maps) == (bare, places)


@pytest.mark.slow
def test_a_rod_that_is_not_mounted_has_no_map(bare, tmp_path: Path) -> None:
    rig, runs = one_rod.recorded(one_rod.Rod(dry=0.02, duration=5.0), 1, tmp_path)
    places = locate(*bare(runs, rig))
    assert {place.site for place in places} == {"joint1", "encoder1"}

from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.gap import diagnose
from dpr_lab.gap.corrections import ForwardSelected
from dpr_lab.gap.state import Fitted
from dpr_lab.gap.where.locate import locate
from dpr_lab.gap.where.residual_map import residual_map
from tests import one_rod


def test_the_gap_is_located_for_the_bare_model_of_the_selected_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search may find a better bare model, and the measured scale then changes the torques of its maps."""
    values: dict[str, Any] = dict.fromkeys((field.name for field in fields(Fitted)), None)
    fitted = Fitted(**values | {"bare": "first", "residual_maps": "of first", "request": Mock()})
    for better, bare in (("first", "first"), ("better", "better"), ("better", "rescaled")):
        selection, rescaled = Mock(bare=better, path=[]), Mock(bare=bare, path=[])
        monkeypatch.setattr(diagnose, "refined", lambda _, selection=selection: selection)
        monkeypatch.setattr(diagnose, "with_other_noise", lambda *_: None)
        monkeypatch.setattr(diagnose, "refuse_impossible_scale", lambda *_: None)
        monkeypatch.setattr(diagnose, "at_own_scale", lambda *_, rescaled=rescaled: rescaled)
        monkeypatch.setattr(diagnose, "_begin", lambda *_: None)
        monkeypatch.setattr(diagnose, "locate", lambda _, bare: f"of {bare}")
        selected = diagnose._selected(ForwardSelected(fitted, Mock()))
        assert (selected.fitted.bare, selected.fitted.residual_maps) == (bare, f"of {bare}")


@pytest.mark.slow
def test_a_rod_that_is_not_mounted_has_no_map(bare, tmp_path: Path) -> None:
    rig, runs = one_rod.recorded(one_rod.Rod(dry=0.02, offset=0.0, duration=5.0), 1, tmp_path)
    places = locate(*bare(runs, rig))
    assert {place.site for place in places} == {"joint1", "encoder1"}


def test_a_map_contains_no_direction_that_the_ratios_absorb() -> None:
    """A line over speed is viscous friction: its coefficient is undetermined, also if 1e-5 of its square remains."""
    rng = np.random.default_rng(0)
    knots, M = np.linspace(-2.0, 2.0, 8), rng.standard_normal((3, 60, 8))
    M = np.concatenate([M, np.zeros((3, 60, 1))], axis=2)  # a knot that was not visited
    line = M[:, :, :8] @ knots
    A = (line + 3e-3 * np.linalg.norm(line) / line.size**0.5 * rng.standard_normal(line.shape))[:, :, None]
    e = M[:, :, :8] @ -np.sign(knots) + 0.1 * rng.standard_normal(line.shape)
    linear = Linearisation(e, e, A, *(np.zeros(()),) * 3)
    fitted = residual_map(linear, [0], M, np.append(knots, 5.0))
    slope = float(np.abs(knots).sum() / (knots @ knots))
    assert fitted.knots.tolist() == knots.tolist()
    assert fitted.values == pytest.approx(slope * knots - np.sign(knots), abs=0.15)
    assert fitted.std.max() < 0.2
    assert fitted.trend(np.sign(knots)) < -10.0
    # a direction that nothing absorbs is the ordinary least-squares fit
    whole = residual_map(linear, [], M, np.append(knots, 5.0))
    assert whole.values == pytest.approx(np.linalg.lstsq(M[:, :, :8].reshape(-1, 8), e.ravel())[0], rel=1e-6)


DRY = one_rod.Rod(dry=0.02, offset=0.0, duration=5.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rod", "braking"),
    [
        (DRY, "braking most at low speed"),
        (replace(DRY, dry=0.0, drag=0.05), "braking more than viscous friction at high speed"),
    ],
    ids=["dry friction", "drag"],
)
def test_the_map_over_speed_has_the_sign_and_shape_of_the_true_law(
    bare, tmp_path: Path, rod: one_rod.Rod, braking: str
) -> None:
    """The torque is relative to the viscous friction that the ratios absorb."""
    rig, runs = one_rod.recorded(rod, 1, tmp_path)
    places = locate(*bare(runs, rig))
    (place,) = [place for place in places if (place.site, place.coordinate) == ("joint1", "speed")]
    assert f"opposite in both directions, {braking}" in place.sentence
    v, std = np.array(place.knots), np.array(place.std)
    law = -rod.gravity_torque * np.sign(v) * (rod.dry + rod.drag * (v / rod.frequency) ** 2)
    beyond_line = law - v * np.average(law * v, weights=std**-2.0) / np.average(v**2, weights=std**-2.0)
    shown = np.array(place.values)
    assert np.abs((shown - beyond_line) / std).max() < 4.0
    assert (shown[[0, -1]] * beyond_line[[0, -1]]).min() > 0.0

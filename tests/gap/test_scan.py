import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Recorded
from dpr_lab.fitting.response import TRAJECTORY, trajectory
from dpr_lab.gap.hypothesis.scan import ShapeScan, arc
from tests import one_rod


def test_an_arc_is_the_part_of_the_circle_that_a_joint_covers() -> None:
    assert arc(np.array([-0.2, 0.3, 0.1])) == pytest.approx(0.5)
    assert arc(np.array([math.pi - 0.1, -math.pi + 0.2])) == pytest.approx(0.3)
    assert arc(np.linspace(0.0, 5.0, 400)) == pytest.approx(5.0)
    assert arc(np.linspace(0.0, 20.0, 400)) == pytest.approx(20.0)  # three turns repeat any pattern
    assert arc(np.array([*np.linspace(-1.0, 1.0, 99), *np.linspace(-1.0, 1.0, 99) + 4 * math.pi])) == pytest.approx(2.0)


def test_the_arc_of_joint_1_is_that_of_its_readings_if_the_fit_swings_further() -> None:
    """Without its tilt, a rig swings symmetrically in the fit and covers a larger arc."""
    readings = np.linspace(-0.11, 0.22, 50)
    problem: Any = SimpleNamespace(measured=np.c_[readings, readings], read=np.ones((50, 2), dtype=np.bool_))
    reference: Any = SimpleNamespace(joint_angle=np.linspace([-0.3, -0.3], [0.3, 0.3], 50))
    fit: Any = None
    proposed = ShapeScan(problem, fit, reference, Recorded((None, None))).shapes(EFFECTS["detent_joint1"])
    assert [order for ((_, order),) in proposed] == [39.0, 40.0]


def scan_at_5_hz(lengths: list[int], read: np.ndarray) -> ShapeScan:
    """Segments of one run that is sampled at 5 Hz."""
    times, owner = np.arange(sum(lengths)) / 5.0, np.repeat(np.arange(len(lengths)), lengths)
    segments = SimpleNamespace(t=times, owner=owner, run=np.zeros(len(lengths), dtype=np.int64))
    problem: Any = SimpleNamespace(segments=segments, read=read)
    unused: Any = None
    return ShapeScan(problem, unused, unused, Recorded((None, None)))


def test_a_vibration_is_proposed_only_below_half_the_sampling_rate() -> None:
    """A higher frequency has the same samples as a lower one, also one below the lowest of the scan."""
    proposed = scan_at_5_hz([50, 50], np.ones((100, 2), dtype=np.bool_)).shapes(EFFECTS["base_vibration"])
    frequencies = [frequency for ((_, frequency),) in proposed]
    assert (frequencies[0], frequencies[-1]) == (1.0, 2.4173)


@pytest.mark.parametrize(
    ("lengths", "together", "resolved_hz"),
    [([1] * 8, True, 2.5), ([8], False, 1.25), ([1], True, math.inf), ([2], False, math.inf)],
)
def test_the_sampling_rate_is_that_of_one_joint(lengths: list[int], together: bool, resolved_hz: float) -> None:
    """Encoders that are read at alternate instants have half the rate of the samples."""
    alternate = (np.arange(sum(lengths))[:, None] + [0, 1]) % 2 == 0
    assert scan_at_5_hz(lengths, alternate | together).resolved_hz == pytest.approx(resolved_hz)


@pytest.mark.slow
def test_a_vibration_does_not_imitate_the_zero_error_of_a_slow_log(
    bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the sampling rate a vibration has the same phase in every sample, as a tilt of the rig."""
    monkeypatch.setattr(one_rod, "RATE_HZ", 10.0)
    monkeypatch.setattr(one_rod, "RELEASES", (math.radians(36.0),))
    rod = one_rod.Rod(length=0.8, dry=0.0, damping=5e-3, offset=0.02, noise=1e-3, duration=19.0)
    rig, runs = one_rod.recorded(rod, 1, tmp_path)
    problem, base = bare(runs, rig)
    along = trajectory(problem, base.fit.estimate, spacing=TRAJECTORY.coarse_s)
    proposed = ShapeScan(problem, base.fit, along, Recorded((None, None))).shapes(EFFECTS["base_vibration"])
    assert all(frequency < 5.2 for ((_, frequency),) in proposed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["detent_joint1", "torque_ripple_joint1"])
def test_a_pattern_is_proposed_only_where_it_repeats(
    name: str, bare, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(one_rod, "RELEASES", (0.25, 0.28))
    rig, runs = one_rod.recorded(one_rod.Rod(duration=4.0), 1, tmp_path)
    problem, base = bare(runs, rig)
    along = trajectory(problem, base.fit.estimate, spacing=TRAJECTORY.coarse_s)
    proposed = ShapeScan(problem, base.fit, along, Recorded((None, None))).shapes(EFFECTS[name])
    orders = [order for ((_, order),) in proposed]
    assert orders
    assert min(orders) * 0.56 >= 2 * 2 * math.pi * 0.97

"""A vibration at a multiple of the frequency of a swing is no evidence of a vibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.swing_lines import on_swing_line
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from tests import one_rod

STEADY = one_rod.Rod(dry=2e-4, damping=1e-3, noise=1e-3, counts=16384, duration=6.0)


def frequency_of(rod: one_rod.Rod, amplitude: float) -> float:
    """Of a pendulum by the first terms of the series of the elliptic integral, Hz."""
    return rod.frequency / (2 * np.pi * (1 + amplitude**2 / 16 + 11 * amplitude**4 / 3072))


def test_lines_are_the_multiples_of_the_frequency_of_the_swing(tmp_path: Path) -> None:
    rig, runs = one_rod.recorded(STEADY, 1, tmp_path)
    problem, initial = Recordings((record(runs[0], rig),), rig).cut(0.5)

    def on_line(hz: float) -> bool:
        params = effect_params({"base_vibration": {"cos_m_per_s2": 0.1, "frequency_hz": hz}})
        return on_swing_line(problem, "base_vibration", Estimate.of(np.ones(len(RATIOS) + 2), params, initial))

    swing = frequency_of(STEADY, one_rod.RELEASES[0])
    assert [n for n in range(1, 9) if on_line(n * swing)] == [1, 2, 3, 4, 5]
    assert not any(on_line((n + 0.5) * swing) for n in range(1, 6))


def test_two_rods_have_no_frequency_of_the_swing(paper: Rig, recorded) -> None:
    problem, initial = Recordings(tuple(record(run, paper) for run in recorded({})[:1]), paper).cut(0.5)
    params = effect_params({"base_vibration": {"cos_m_per_s2": 0.1, "frequency_hz": 2.0}})
    at = Estimate.of(np.ones(len(RATIOS) + 2), params, initial)
    assert not on_swing_line(problem, "base_vibration", at)


@pytest.mark.slow
def test_an_eccentric_encoder_is_not_called_a_vibration(tmp_path: Path) -> None:
    """Its error of two cycles per turn has lines at even multiples of the swing's frequency."""
    rig, runs = one_rod.recorded(replace(STEADY, offset=0.0), 1, tmp_path)
    theta = runs[1].theta.copy()
    theta[:, 1] += 6e-3 * np.cos(2 * theta[:, 1])
    found = diagnose([replace(runs[1], theta=theta)], rig)
    assert found.probabilities["encoder_eccentricity_joint1"] > 0.9

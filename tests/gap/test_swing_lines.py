"""Effects that follow a single swing: a vibration at a multiple of its frequency, a drift along its decay."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.hypothesis import hypothesis
from dpr_lab.gap.hypothesis.swing_lines import on_swing_line
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.outcome import TRANSFER
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from tests import one_rod
from tests.thinned import candidates, thinned

STEADY = one_rod.Rod(dry=2e-4, damping=1e-3, noise=1e-3, counts=16384, duration=6.0)
LOSSES = candidates("air_drag", "friction_drift", "coulomb", "stribeck", "encoder_offset")


def frequency_of(rod: one_rod.Rod, amplitude: float) -> float:
    """Frequency of a pendulum from the first terms of the series of the elliptic integral, Hz."""
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
def test_pieces_of_one_release_and_equal_releases_are_one_decay(tmp_path: Path, bare) -> None:
    rig, (run, other) = one_rod.recorded(STEADY, 1, tmp_path)
    pieces = [run.between(-np.inf, 3.0), run.between(3.0, np.inf)]

    def drifts(runs: list[Run]) -> frozenset[str]:
        problem, base = bare(runs, rig)
        return hypothesis(problem, ("friction_drift_joint1",), base.fit).decay_drifts

    assert drifts(pieces)
    assert not drifts([run, other])
    assert drifts([run, replace(run, name="again")])


@pytest.mark.slow
def test_an_eccentric_encoder_is_not_called_a_vibration(tmp_path: Path) -> None:
    """Its error of two cycles per turn has lines at even multiples of the swing's frequency."""
    rig, runs = one_rod.recorded(replace(STEADY, offset=0.0), 1, tmp_path)
    theta = runs[1].theta.copy()
    theta[:, 1] += 6e-3 * np.cos(2 * theta[:, 1])
    likely = candidates("encoder", "base_", "detent", "coulomb")
    diagnosis = diagnose([replace(runs[1], theta=theta)], rig, library=likely)
    assert diagnosis.probabilities["encoder_eccentricity_joint1"] > 0.9 * TRANSFER.untested, "of one release"


@pytest.mark.long
@pytest.mark.parametrize("seed", thinned([3, 5], 2))
def test_air_drag_is_not_called_a_drift_of_friction_after_one_release(tmp_path: Path, seed: int) -> None:
    """Along one release the amplitude falls with time, so that a loss which depends on speed looks like a drift."""
    rng = np.random.default_rng(seed)
    rod = one_rod.Rod(
        length=float(rng.uniform(0.2, 0.5)),
        dry=2e-4,
        damping=float(rng.uniform(3e-3, 8e-3)),
        drag=float(rng.uniform(4e-3, 12e-3)),
        offset=-8e-4,
        noise=8e-4,
        counts=2400,
    )
    rig, runs = one_rod.recorded(rod, seed, tmp_path)
    diagnosis = diagnose(runs[:1], rig, library=LOSSES)
    assert diagnosis.probabilities["air_drag_both"] > 0.8
    assert diagnosis.probabilities.get("friction_drift_joint1", 0.0) < 0.2


@pytest.mark.long
def test_a_drift_of_friction_that_drag_cannot_imitate_is_named(tmp_path: Path) -> None:
    rod = one_rod.Rod(dry=2e-4, damping=6e-3, offset=-8e-4, noise=8e-4, counts=2400)
    rig, runs = one_rod.recorded(rod, 1, tmp_path)
    (run, *_), rng = runs, np.random.default_rng(1)
    t, w = run.swing.t, rod.frequency

    def drifting(now: float, x: np.ndarray) -> list[float]:
        return [x[1], -(w**2) * np.sin(x[0]) - 2 * rod.damping * w * (1 - 0.05 * now) * x[1]]

    angle = solve_ivp(drifting, (0.0, t[-1]), [run.swing.theta[0, 1] - np.pi, 0.0], t_eval=t, rtol=1e-9, atol=1e-11).y[
        0
    ]
    step = 2 * np.pi / rod.counts
    reading = np.pi + np.round((angle + rng.normal(0.0, 3e-4, len(t))) / step) * step
    theta = run.theta.copy()
    theta[:, 1:] = np.concatenate([np.full(len(run.t) - len(t), reading[0]), reading])[:, None]
    diagnosis = diagnose([replace(run, theta=theta, counts=None)], rig, library=LOSSES)
    assert diagnosis.probabilities["friction_drift_joint1"] > 0.9

"""Encoders that are zeroed before each recording: swings by SciPy, each with other zeros."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.transfer.out_of_sample import left_out_prediction
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run

STAYING = load_rig("paper")
REZEROED = STAYING.model_copy(update={"encoders": STAYING.encoders.model_copy(update={"rezeroed": True})})
ZEROS = np.array([[0.03, -0.05], [-0.02, 0.01], [0.01, 0.04]])
"""Of joint 1 and of the relative joint 2, of three recordings, rad."""
POSES = np.array([[2.3, 3.9], [3.9, 3.0], [2.6, 2.4]])
NOISE = 2e-4
T = np.arange(0.0, 2.0, 5e-3)


def swung(pose: np.ndarray) -> np.ndarray:
    """(n, 2) angles of the rods: the textbook's two equations, solved for the accelerations as a matrix."""
    a, b, d, e1, c1, c2 = base_parameters(STAYING.nominal, STAYING.L1, STAYING.g)

    def slope(_, x):
        (p, q), (u, v) = x[:2], x[2:]
        M = [[a, d * np.cos(p - q)], [d * np.cos(p - q), b]]
        first = -d * np.sin(p - q) * v**2 + e1 * np.sin(p) - c1 * u + c2 * (v - u)
        second = d * np.sin(p - q) * u**2 + d * STAYING.g / STAYING.L1 * np.sin(q) - c2 * (v - u)
        return [u, v, *np.linalg.solve(M, [first, second])]

    return solve_ivp(slope, (0, T[-1]), [*pose, 0, 0], "DOP853", T, rtol=1e-9, atol=1e-10).y[:2].T


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    random, result = np.random.default_rng(5), []
    for k, (zeros, pose) in enumerate(zip(ZEROS, POSES, strict=True)):
        read = swung(pose) + np.cumsum(zeros) + np.cumsum(random.normal(0, NOISE, (len(T), 2)), axis=1)
        theta = np.column_stack([np.zeros(len(T)), read])
        result.append(Run(f"x{k}", T, theta, None, None, STAYING.name, "", 200.0))
    return result


def recordings(runs: list[Run], rig: Rig) -> Recordings:
    return Recordings(tuple(record(run, rig) for run in runs), rig)


@pytest.mark.slow
@pytest.mark.timeout(900)  # kernels may have to be compiled
def test_each_recording_has_zeros_of_its_own(runs: list[Run]) -> None:
    kept, problem, bare = fit_bare_model(recordings(runs[:2], REZEROED), nominal_ratios(REZEROED) * 1.02)
    at = bare.fit.estimate
    assert at.zeros == pytest.approx(ZEROS[:2], abs=2e-3)
    assert at.ratios[:3] == pytest.approx(nominal_ratios(REZEROED)[:3], rel=0.01)
    assert bare.residuals.chi2 < 2 * bare.residuals.dof
    unseen = recordings(runs[2:], REZEROED)
    assert max(free_runs(unseen, at).errors_rad.values()) < 5e-3
    predicted = left_out_prediction(kept, problem)
    assert (predicted.chi2(bare) < 4 * predicted.dof).all()
    _, _, staying = fit_bare_model(recordings(runs[:2], STAYING), nominal_ratios(STAYING))
    assert staying.residuals.chi2 > 10 * bare.residuals.chi2
    assert staying.fit.estimate.zeros.size == 0

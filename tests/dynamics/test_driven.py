"""Known torques, held until the next logged instant, in both output models, and the scale that they determine."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters, whole_parameters
from dpr_lab.dynamics.equation import accelerations
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import effect_params
from dpr_lab.fitting.estimate import Estimate, ratio_parameters, unknown_ratios, with_scale
from dpr_lab.fitting.rods import RodsAlone
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.identification.identify import identify, polish
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.setup import ArmMotion, Setup, Torques

Z = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
RIG = load_rig("paper")
BASE = base_parameters(Z, RIG.L1, RIG.g)
T = np.arange(0.0, 2.0, 5e-3)
START = np.array([3.0, 3.3, 0.0, 0.0])


def driven_swing(torques: np.ndarray, start=START) -> np.ndarray:
    """States (n, 4) at T by DOP853, integrated interval by interval with the torques of each interval."""
    a, b, d, e1, c1, c2 = BASE
    states = [start]
    for i, (tau1, tau2) in enumerate(torques[:-1]):

        def slope(_, x, tau1=tau1, tau2=tau2):
            e2 = d * RIG.g / RIG.L1
            return [x[2], x[3], *accelerations(*x, a, b, d, e1, e2, c1, c2, tau1 - tau2, tau2)]

        states.append(solve_ivp(slope, T[i : i + 2], states[-1], "DOP853", rtol=1e-9, atol=1e-10).y[:, -1])
    return np.array(states)


@pytest.fixture(scope="module")
def torques() -> np.ndarray:
    return np.random.default_rng(3).normal(0, 0.15, (len(T), 2)) + 0.2 * np.sin(7 * T)[:, None]


@pytest.fixture(scope="module")
def swing(torques: np.ndarray) -> np.ndarray:
    return driven_swing(torques)


def estimate(start: np.ndarray) -> Estimate:
    return Estimate.of(unknown_ratios(whole_parameters(Z, RIG.L1, RIG.g)), effect_params({}), start[None])


@pytest.mark.parametrize("model", [RodsAlone, RodsWithEffects], ids=["ratios", "lanes"])
def test_torques_drive_both_output_models(model, torques: np.ndarray, swing: np.ndarray):
    # Past the release the lanes start 20 ms before the first sample.
    first = 0 if model is RodsAlone else 4
    laid_out = segments([T[first:]], setups=[Setup(torques=Torques(T, torques))], step=1e-3)
    result = model(rig_constants(RIG)).predict(laid_out, estimate(START))
    truth = np.stack([swing[first:, 0], swing[first:, 1] - swing[first:, 0]], axis=1)
    assert np.abs(swing[:, 0] - np.pi).max() > 0.5
    assert result == pytest.approx(truth, abs=2e-6)


def test_derivatives_with_respect_to_the_scale_agree_with_those_of_the_readings(torques: np.ndarray):
    laid_out = segments([T], setups=[Setup(torques=Torques(T, torques))], step=2.5e-3)
    model, at = RodsAlone(rig_constants(RIG)), estimate(START)
    free = ratio_parameters(at, range(6))
    slopes = model.slopes(laid_out, at, free)
    for column, parameter in enumerate(free):
        both = []
        for sign in (1, -1):
            ratios = at.ratios.copy()
            ratios[parameter.place] *= 1 + sign * 1e-6
            both.append(model.predict(laid_out, at.changed(ratios=ratios)))
        expected = (both[0] - both[1]) / 2e-6
        assert slopes[:, :, column] * at.ratios[parameter.place] == pytest.approx(expected, rel=1e-4, abs=1e-5)


def recorded(torques: np.ndarray, swing: np.ndarray, seed: int) -> Run:
    noise = np.random.default_rng(seed).normal(0, 2e-4, (len(T), 2))
    theta = np.column_stack([np.zeros(len(T)), swing[:, :2] + noise @ [[1, 1], [0, 1]]])
    return Run(f"driven {seed}", T, theta, None, None, RIG.name, "", 200.0, torques=torques, sha256=str(seed))


def test_known_torques_make_the_scale_visible(torques: np.ndarray, swing: np.ndarray, paper: Rig):
    runs = [recorded(torques, swing, seed) for seed in (1, 2)]
    result = polish(paper.nominal, [preprocess(run, paper) for run in runs], paper)
    sure = uncertainty(result)
    truth = unknown_ratios(BASE)[:6]
    assert sure.names[-1] == "b"
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.15)
    assert np.abs((result.unknowns - truth) / sure.std).max() < 4
    assert sure.std[5] < 0.01 * truth[5]


def test_a_driven_rig_is_identified_in_absolute_numbers(torques: np.ndarray, swing: np.ndarray, paper: Rig):
    model = identify([recorded(torques, swing, 1)], paper)
    assert {value.fixed_by for value in model.base.values()} == {"data"}
    assert model.base["b"].value == pytest.approx(BASE[1], rel=0.01)
    assert with_scale(model.unknowns, 1.0)[5] == 1.0


def test_inputs_are_averaged_run_by_run_as_segment_by_segment(torques: np.ndarray) -> None:
    motion = ArmMotion(T, np.sin(T), np.cos(3 * T))
    setups = (Setup(torques=Torques(T, torques)), Setup(), Setup(torques=Torques(T, -torques), arm=motion))
    times = [T[:50], T[50:90], T[:30], T[10:200], T[200:]]
    pushes = segments(times, [0, 0, 1, 2, 2], setups).pushes
    expected = [np.zeros((len(t), 4)) for t in times]
    for own, t, run in zip(expected, times, (0, 0, 1, 2, 2), strict=True):
        if setups[run].torques is not None:
            own[:, :2] = setups[run].torques.mean_before(t)
        if setups[run].arm is not None:
            own[:, 2:] = setups[run].arm.mean_before(t)
    assert pushes == pytest.approx(np.concatenate(expected), abs=1e-12)
    assert np.abs(pushes[51:90, :2]).min() > 0.0
    assert pushes[50, :2].tolist() == [0.0, 0.0]

"""Local fit of the ratios, compared with swings of SciPy's DOP853, which shares no code with it."""

import os
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from dpr_lab.dynamics.base import added_base, base_parameters, loaded, ratios
from dpr_lab.estimation.noise import NoiseFloor
from dpr_lab.fitting.cut import MIN_SAMPLES, partition
from dpr_lab.identification.merging import merge_segments
from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.identification.profile import profile90
from dpr_lab.identification.ratio_fit import RatioFit, fit_ratios, rods_estimate, segmented
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.joint_angles import JointAngles
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.run import Run

NOISE = 2e-4
TRUE = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])


def swing(state: NDArray, t: NDArray, base: NDArray, rig: Rig, error: float = 1e-9) -> NDArray:
    a, b, d, e1, c1, c2 = base
    e2 = d * rig.rig.g / rig.rig.L1

    def slope(_t: float, x: NDArray) -> NDArray:
        t1, t2, w1, w2 = x
        mass = np.array([[a, d * np.cos(t1 - t2)], [d * np.cos(t1 - t2), b]])
        torque = [
            -d * np.sin(t1 - t2) * w2**2 - c1 * w1 - c2 * (w1 - w2) + e1 * np.sin(t1),
            d * np.sin(t1 - t2) * w1**2 - c2 * (w2 - w1) + e2 * np.sin(t2),
        ]
        return np.concatenate([[w1, w2], np.linalg.solve(mass, torque)])

    return solve_ivp(slope, (t[0], t[-1]), state, "DOP853", t, rtol=error, atol=error).y.T


def record(rig: Rig, rng: np.random.Generator, *, base: NDArray | None = None, duration: float = 4.0, keep=None):
    """Three releases at 200 Hz with white noise, and smoothed states."""
    base = base_parameters(TRUE, rig.rig.L1, rig.rig.g) if base is None else base
    t = np.arange(0.0, duration, 0.005)
    if keep is not None:
        t = t[keep(t)]
    runs, states = [], []
    for pose in rig.poses.values():
        x = swing(np.array([*pose.theta[1:], 0.0, 0.0]), t, base, rig)
        theta = np.column_stack([np.zeros(len(t)), x[:, :2] + rng.normal(0, NOISE, (len(t), 2))])
        runs.append(Run("run", t, theta, None, None, rig.name, "", 200.0))
        states.append(x + rng.normal(0, 1, x.shape) * [NOISE, NOISE, 0.02, 0.02])
    return runs, states


def absolute(rig: Rig) -> Rig:
    """The rig with both encoders on the arm: white noise of the readings is then white noise of the angles."""
    return rig.model_copy(update={"encoders": rig.encoders.model_copy(update={"joint2": "absolute"})})


def problem_of(rig: Rig, runs, states, length: float):
    """Segments of runs, and the smoothed states at their starts."""
    noise = NoiseFloor(np.full(2, NOISE), JointAngles(relative2=False))
    prepared = [PreprocessedRun(run, noise, x) for run, x in zip(runs, states, strict=True)]
    return segmented(prepared, absolute(rig), length)


def fitted(rig: Rig, start: NDArray, runs, states, length: float, **options) -> RatioFit:
    """A fit from ratios, and b where that is asked for."""
    problem, initial = problem_of(rig, runs, states, length)
    unknown = np.append(start, [1.0, np.nan][len(start) - 5 :])
    return fit_ratios(problem, rods_estimate(unknown, initial), **options)


@pytest.mark.slow
def test_ratios_are_recovered_from_a_start_ten_percent_off(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng)
    short = fitted(paper, true * [1.1, 0.92, 1.08, 0.9, 1.1], runs, states, 0.25)
    assert short.fit.converged
    assert short.chi2_per_dof == pytest.approx(1.0, abs=4 * np.sqrt(2 / short.dof))
    assert np.all(np.abs(short.ratios - true) < 4 * uncertainty(short).std)
    merged = merge_segments(short)
    assert merged.segments < short.segments
    assert np.all(np.abs(merged.ratios - true) < 4 * uncertainty(merged).std)
    assert np.all(uncertainty(merged).std < uncertainty(short).std)


@pytest.mark.slow
def test_gaps_cost_information_and_nothing_else(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, keep=lambda t: ((t * 10).astype(int) % 3 != 1) | (t < 0.1))
    fit = fitted(paper, true, runs, states, 0.5)
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=4 * np.sqrt(2 / fit.dof))
    assert np.all(np.abs(fit.ratios - true) < 4 * uncertainty(fit).std)


@pytest.mark.slow
def test_eliminating_start_states_gives_what_a_solver_of_all_unknowns_gives(
    paper: Rig, rng: np.random.Generator
) -> None:
    runs, states = record(paper, rng, duration=1.0)
    problem, initial = problem_of(paper, runs[:1], states[:1], 0.5)
    cuts = problem.segments.offsets[1:-1]
    pieces = list(zip(np.split(problem.t, cuts), np.split(problem.measured, cuts), strict=True))
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    true = ratios(base)
    scale = np.concatenate([true, np.ones(4 * len(pieces))])

    def residual(x: NDArray) -> NDArray:
        r, starts = x[:5] * true, x[5:].reshape(-1, 4)
        whole = np.insert(r, 1, 1.0)
        parts = [
            (theta - swing(start, t, whole, paper, 1e-11)[:, :2]) / NOISE
            for (t, theta), start in zip(pieces, starts, strict=True)
        ]
        return np.concatenate(parts).ravel()

    everything = least_squares(residual, np.concatenate([np.ones(5), *initial]), xtol=1e-12)
    by_readings = replace(problem, prior=None)  # the reference knows nothing of the rig file
    fit = fit_ratios(by_readings, rods_estimate(np.append(true, [1.0, np.nan]), initial))
    std = np.sqrt(np.diag(np.linalg.inv(uncertainty(fit).information)))
    assert np.abs(fit.ratios - everything.x[:5] * scale[:5]) == pytest.approx(0, abs=0.01 * std.max())
    assert fit.fit.chi2 == pytest.approx(2 * everything.cost, rel=1e-5)


@pytest.mark.slow
def test_a_release_with_a_known_added_mass_makes_the_scale_visible(paper: Rig, rng: np.random.Generator) -> None:
    L1, g = paper.rig.L1, paper.rig.g
    clamped = AddedMass(rod="outer", mass=0.05, position=0.3)
    bare, heavy = base_parameters(TRUE, L1, g), base_parameters(loaded(TRUE, clamped), L1, g)
    assert heavy == pytest.approx(bare + added_base(clamped, L1, g), rel=1e-12)
    runs, states = record(paper, rng, base=bare)
    heavy_runs, heavy_states = record(paper, rng, base=heavy)
    heavy_runs = [replace(run, added_mass=clamped) for run in heavy_runs]
    true = np.append(ratios(bare), bare[1])
    start = true * [1.05, 0.95, 1.05, 0.9, 1.1, 1.3]
    fit = fitted(paper, start, runs + heavy_runs, states + heavy_states, 0.5)
    assert fit.fit.converged
    assert np.all(np.abs(fit.unknowns - true) < 4 * uncertainty(fit).std)
    assert uncertainty(fit).std[5] < 0.01 * true[5]


@pytest.mark.slow
def test_friction_is_never_negative_and_its_limit_is_reported(paper: Rig, rng: np.random.Generator) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    base[4] = -0.2 * base[4]
    runs, states = record(paper, rng, base=base)
    fit = fitted(paper, ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g)), runs, states, 0.5)
    assert fit.ratios[3] == 0.0
    assert uncertainty(fit).at_zero == ("c1/b",)
    assert uncertainty(fit).covariance[3, 3] == 0.0


def test_held_ratios_stay_and_initial_states_move(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, duration=1.0)
    fit = fitted(paper, true, runs, states, 0.5, held=range(5))
    assert np.array_equal(fit.ratios, true)
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.2)


def test_segments_partition_a_run(paper: Rig, rng: np.random.Generator) -> None:
    runs, _ = record(paper, rng, duration=2.0, keep=lambda t: (t < 0.3) | (t > 1.1))
    pieces = [runs[0].t[stretch] for stretch in partition(runs[0], 0.25)]
    assert np.array_equal(np.concatenate(pieces), runs[0].t)
    assert min(len(t) for t in pieces) >= MIN_SAMPLES


@pytest.mark.slow
def test_errors_over_their_standard_deviation_have_unit_variance(paper: Rig) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    deviations = []
    for seed in range(60 if os.environ.get("DPR_LAB_FULL") == "1" else 8):
        runs, states = record(paper, np.random.default_rng(seed), duration=2.5)
        fit = fitted(paper, true, runs, states, 0.5)
        deviations.append((fit.ratios - true) / uncertainty(fit).std)
    rms = np.sqrt(np.mean(np.square(deviations)))
    assert 0.8 < rms < 1.25


def test_the_profile_likelihood_agrees_with_the_covariance_where_the_problem_is_nearly_linear(
    paper: Rig, rng: np.random.Generator
) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, duration=2.0)
    fit = fitted(paper, true, runs, states, 0.5)
    for index in (0, 4):
        low, high = profile90(fit, uncertainty(fit), index)
        reach = 1.645 * uncertainty(fit).cramer_rao_std[index]
        assert fit.ratios[index] - low == pytest.approx(reach, rel=0.1)
        assert high - fit.ratios[index] == pytest.approx(reach, rel=0.1)


def test_a_drift_along_whole_runs_widens_the_interval(paper: Rig, rng: np.random.Generator) -> None:
    early = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    late = early * [1.0, 1.0, 1.0, 1.0, 1.0, 1.01]
    runs, states = record(paper, rng, duration=2.0)
    for i, (run, pose) in enumerate(zip(runs, paper.poses.values(), strict=True)):
        before = swing(np.array([*pose.theta[1:], 0.0, 0.0]), run.t[:201], early, paper)
        x = np.concatenate([before[:-1], swing(before[-1], run.t[200:], late, paper)])[20:]
        theta = np.column_stack([np.zeros(len(x)), x[:, :2] + rng.normal(0, NOISE, (len(x), 2))])
        runs[i], states[i] = replace(run, t=run.t[20:], theta=theta), x
    fit = fitted(paper, ratios(early), runs, states, 4.0)
    assert fit.segments == len(runs)
    assert fit.chi2_per_dof > 1.5
    low, high = uncertainty(fit).interval90(4)
    assert high - low >= (late[5] - early[5]) / early[1]


def test_the_profile_of_friction_ends_at_zero(paper: Rig, rng: np.random.Generator) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    base[4] *= 1e-3
    runs, states = record(paper, rng, base=base, duration=1.0)
    fit = fitted(paper, ratios(base), runs, states, 0.5)
    low, _ = profile90(fit, uncertainty(fit), 3)
    assert low == pytest.approx(0.0, abs=1e-15)


def test_friction_at_zero_has_a_one_sided_interval(paper: Rig) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    base[4] = -0.005 * base[4]
    runs, states = record(paper, np.random.default_rng(0), base=base, duration=2.0)
    fit = fitted(paper, ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g)), runs, states, 0.5)
    spread = uncertainty(fit)
    assert spread.at_zero == ("c1/b",)
    (low, high), (profile_low, profile_high) = spread.interval90(3), profile90(fit, spread, 3)
    assert low == profile_low == 0.0 < profile_high
    assert profile_high / 2 < high < 5 * profile_high
    assert spread.unconstrained is not None
    estimate, std = spread.unconstrained[3]
    assert estimate == pytest.approx(base[4] / base[1], abs=4 * std)

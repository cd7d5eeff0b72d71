"""The polish against swings from scipy's DOP853, an integrator that shares no code with it."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from dpr_lab.dynamics.base import added_base, base_parameters, loaded, ratios
from dpr_lab.estimation.growth import grow
from dpr_lab.estimation.least_squares import Conditions, fit_segments
from dpr_lab.estimation.profile import profile90
from dpr_lab.estimation.segments import MIN_SAMPLES, cut
from dpr_lab.rig import AddedMass, Rig
from dpr_lab.run import Run

NOISE = 2e-4
WHITENER = np.eye(2) / NOISE
TRUE = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])


def known(rig: Rig) -> Conditions:
    return Conditions(rig.rig.L1, rig.rig.g, (WHITENER,) * 3)


def swing(state: NDArray, t: NDArray, base: NDArray, rig: Rig) -> NDArray:
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

    return solve_ivp(slope, (t[0], t[-1]), state, "DOP853", t, rtol=1e-11, atol=1e-11).y.T


def record(rig: Rig, rng: np.random.Generator, *, base: NDArray | None = None, duration: float = 4.0, keep=None):
    """Three releases at 200 Hz with white noise, and states as a smoother would give them."""
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


def segments_of(runs, states, length: float):
    return [s for i, (run, x) in enumerate(zip(runs, states, strict=True)) for s in cut(i, run, x, length)]


def test_ratios_are_recovered_from_a_start_ten_percent_off(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng)
    fit = fit_segments(true * [1.1, 0.92, 1.08, 0.9, 1.1], segments_of(runs, states, 0.25), known(paper))
    assert fit.converged
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=4 * np.sqrt(2 / fit.dof))
    assert np.all(np.abs(fit.ratios - true) < 4 * np.sqrt(np.diag(fit.covariance)))
    grown = grow(fit, known(paper))
    assert len(grown.segments) < len(fit.segments)
    assert np.all(np.abs(grown.ratios - true) < 4 * np.sqrt(np.diag(grown.covariance)))
    assert np.all(np.diag(grown.covariance) < np.diag(fit.covariance))


def test_gaps_cost_information_and_nothing_else(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, keep=lambda t: ((t * 10).astype(int) % 3 != 1) | (t < 0.1))
    fit = fit_segments(true, segments_of(runs, states, 0.5), known(paper))
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=4 * np.sqrt(2 / fit.dof))
    assert np.all(np.abs(fit.ratios - true) < 4 * np.sqrt(np.diag(fit.covariance)))


def test_eliminating_start_states_gives_what_a_solver_of_all_unknowns_gives(
    paper: Rig, rng: np.random.Generator
) -> None:
    runs, states = record(paper, rng, duration=1.0)
    pieces = segments_of(runs[:1], states[:1], 0.5)
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    true = ratios(base)
    scale = np.concatenate([true, np.ones(4 * len(pieces))])

    def residual(x: NDArray) -> NDArray:
        r, starts = x[:5] * true, x[5:].reshape(-1, 4)
        whole = np.insert(r, 1, 1.0)
        parts = [
            (s.theta - swing(start, s.t, whole, paper)[:, :2]) / NOISE for s, start in zip(pieces, starts, strict=True)
        ]
        return np.concatenate(parts).ravel()

    everything = least_squares(residual, np.concatenate([np.ones(5), *(s.start for s in pieces)]), xtol=1e-12)
    fit = fit_segments(true, pieces, known(paper))
    std = np.sqrt(np.diag(np.linalg.inv(fit.information)))
    assert np.abs(fit.ratios - everything.x[:5] * scale[:5]) == pytest.approx(0, abs=0.01 * std.max())
    assert fit.chi2 == pytest.approx(2 * everything.cost, rel=1e-5)


def test_a_release_with_a_known_added_mass_makes_the_scale_visible(paper: Rig, rng: np.random.Generator) -> None:
    L1, g = paper.rig.L1, paper.rig.g
    clamped = AddedMass(rod="outer", mass=0.05, position=0.3)
    bare, heavy = base_parameters(TRUE, L1, g), base_parameters(loaded(TRUE, clamped), L1, g)
    assert heavy == pytest.approx(bare + added_base(clamped, L1, g), rel=1e-12)
    runs, states = record(paper, rng, base=bare)
    heavy_runs, heavy_states = record(paper, rng, base=heavy)
    conditions = Conditions(L1, g, (WHITENER,) * 6, (np.zeros(6),) * 3 + (added_base(clamped, L1, g),) * 3)
    true = np.append(ratios(bare), bare[1])
    pieces = segments_of(runs + heavy_runs, states + heavy_states, 0.5)
    fit = fit_segments(true * [1.05, 0.95, 1.05, 0.9, 1.1, 1.3], pieces, conditions)
    assert fit.converged
    assert np.all(np.abs(fit.unknowns - true) < 4 * np.sqrt(np.diag(fit.covariance)))
    assert np.sqrt(fit.covariance[5, 5]) < 0.01 * true[5]


def test_friction_is_never_negative_and_says_so(paper: Rig, rng: np.random.Generator) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    base[4] = -0.2 * base[4]
    runs, states = record(paper, rng, base=base)
    fit = fit_segments(
        ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g)),
        segments_of(runs, states, 0.5),
        known(paper),
    )
    assert fit.ratios[3] == 0.0
    assert fit.at_zero == ("c1/b",)
    assert fit.covariance[3, 3] == 0.0


def test_held_ratios_stay_and_start_states_move(paper: Rig, rng: np.random.Generator) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, duration=1.0)
    fit = fit_segments(true, segments_of(runs, states, 0.5), known(paper), held=range(5))
    assert np.array_equal(fit.ratios, true)
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.2)


def test_segments_partition_a_run(paper: Rig, rng: np.random.Generator) -> None:
    runs, states = record(paper, rng, duration=2.0, keep=lambda t: (t < 0.3) | (t > 1.1))
    pieces = cut(0, runs[0], states[0], 0.25)
    assert np.array_equal(np.concatenate([s.t for s in pieces]), runs[0].t)
    assert min(len(s.t) for s in pieces) >= MIN_SAMPLES


@pytest.mark.slow
def test_errors_over_their_standard_deviation_have_unit_variance(paper: Rig) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    deviations = []
    for seed in range(30):
        runs, states = record(paper, np.random.default_rng(seed), duration=5.0)
        fit = fit_segments(true, segments_of(runs, states, 0.5), known(paper))
        deviations.append((fit.ratios - true) / np.sqrt(np.diag(fit.covariance)))
    rms = np.sqrt(np.mean(np.square(deviations)))
    assert 0.8 < rms < 1.25


def test_the_profile_likelihood_agrees_with_the_covariance_where_the_problem_is_nearly_linear(
    paper: Rig, rng: np.random.Generator
) -> None:
    true = ratios(base_parameters(TRUE, paper.rig.L1, paper.rig.g))
    runs, states = record(paper, rng, duration=2.0)
    fit = fit_segments(true, segments_of(runs, states, 0.5), known(paper))
    for index in (0, 4):
        low, high = profile90(fit, index, known(paper))
        reach = 1.645 * fit.cramer_rao_std[index]
        assert fit.ratios[index] - low == pytest.approx(reach, rel=0.1)
        assert high - fit.ratios[index] == pytest.approx(reach, rel=0.1)


def test_the_profile_of_friction_ends_at_zero(paper: Rig, rng: np.random.Generator) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    base[4] *= 1e-3
    runs, states = record(paper, rng, base=base, duration=1.0)
    fit = fit_segments(ratios(base), segments_of(runs, states, 0.5), known(paper))
    low, _ = profile90(fit, 3, known(paper))
    assert low == 0.0

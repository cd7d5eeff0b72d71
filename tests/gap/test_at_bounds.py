"""A value at its bound is uncertain, and so are correlated values."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from dpr_lab.fitting.estimate import EFFECTS_BEGIN, SIZE, Estimate, FreeParameter
from dpr_lab.fitting.gauss_newton import Fit, StopReason
from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.conclusion.uncertainty import _mean_square, second_moments

Array = NDArray[np.float64]
SPEED = np.linspace(0.1, 2.0, 40)
COLUMNS = np.column_stack([np.ones(40), SPEED, 10.0 * np.minimum(SPEED / 1.9, 1.0)])
"""Readings per unit of Coulomb friction, viscous friction, and of a slope that differs from it above 1.9 rad/s only."""
FREE = tuple(
    FreeParameter(name, "ratios", place, 1.0, lower=0.0, size=1.0) for place, name in enumerate(("F", "c", "rise"))
)


def fitted(measured: Array) -> tuple[Any, Fit]:
    """A linear problem without initial states, fitted within its bounds."""
    bounds = np.array([[0.0] * 3, [np.inf] * 3])
    vector = np.zeros(EFFECTS_BEGIN + SIZE)
    vector[:3] = ColumnSpace.of(COLUMNS, measured).solution(bounds)
    problem = SimpleNamespace(
        predict=lambda estimate: COLUMNS @ estimate.vector[:3], whitened=lambda values: np.asarray(values)[None]
    )
    residual, none = (measured - problem.predict(Estimate(vector, np.zeros((1, 0)))))[None], np.zeros((1, 0, 0))
    linear = Linearisation(residual, residual, COLUMNS[None], np.zeros((1, 0, 3)), np.zeros((1, 40, 0)), none)
    fit = Fit(Estimate(vector, np.zeros((1, 0))), FREE, linear, StopReason.CONVERGED, prior=np.zeros((0, 3)))
    return cast(Any, problem), fit


@pytest.mark.slow
def test_intervals_cover_where_the_noise_moved_a_value_to_its_bound():
    rng, true = np.random.default_rng(1), np.array([3.0, 0.5, 0.5])
    covered, at_bound = np.zeros(3), 0
    for _ in range(400):
        problem, fit = fitted(COLUMNS @ true + rng.normal(size=len(SPEED)))
        conditional = np.zeros((3, 3))
        conditional[np.ix_(fit.inside, fit.inside)] = ColumnSpace.of(COLUMNS[:, fit.inside], fit.linear.e).covariance()
        both = conditional + second_moments(problem, fit, 1.0)
        covered += np.abs(fit.values - true) <= 1.645 * np.sqrt(np.diag(both))
        at_bound += len(fit.inside) < 3
    assert at_bound > 300
    assert (covered > 0.86 * 400).all(), covered


def test_a_value_that_the_others_absorb_is_as_uncertain():
    problem, fit = fitted(COLUMNS @ np.array([3.0, 0.5, 0.0]) - SPEED**2)
    assert 2 not in fit.inside
    moments = second_moments(problem, replace(fit, absorbed=(2,)), 1.0)
    assert moments[2, 2] > 0.0
    assert moments == pytest.approx(second_moments(problem, fit, 1.0))


def test_a_value_that_the_readings_exclude_is_zero_with_little_doubt():
    problem, fit = fitted(COLUMNS @ np.array([3.0, 50.0, 0.0]) - 30.0 * SPEED**2)
    assert 2 not in fit.inside
    assert second_moments(problem, fit, 1.0)[2, 2] ** 0.5 < 0.05


@pytest.mark.parametrize("slope", [-30.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("farthest", [0.5, np.inf])
def test_the_mean_square_beyond_a_bound_is_that_of_a_cut_normal_density(slope: float, farthest: float) -> None:
    end, curvature = min(farthest, 20.0), 4.0

    def moment(power: int) -> float:
        return quad(lambda u: u**power * np.exp(slope * u - curvature * u**2 / 2), 0.0, end, limit=200)[0]

    assert _mean_square(slope, curvature, farthest) == pytest.approx(moment(2) / moment(0), rel=2e-2)

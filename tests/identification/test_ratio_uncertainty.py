"""Intervals and covariances of fitted ratios, compared with formulas and examples calculated by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.identification import uncertainty
from dpr_lab.identification.ratio_fit import RatioFit
from dpr_lab.identification.uncertainty import RatioUncertainty
from dpr_lab.setup import Setup

T3, T2, T1 = 2.353363, 2.919986, 6.313752
"""95 % quantiles of Student's t with 3, 2 and 1 degrees of freedom."""


def of(values, variances, **others) -> RatioUncertainty:
    """Uncertainty with a diagonal covariance."""
    n = len(values)
    without = {
        "information": np.eye(n),
        "names": UNKNOWN_RATIOS[:n],
        "prior": np.zeros((n, n)),
        "assumed": np.zeros((n, n)),
        "unconstrained": np.zeros((n, 2)),
    }
    return RatioUncertainty(values=np.array(values), covariance=np.diag(variances), **(without | others))


@pytest.mark.parametrize(("blocks", "quantile"), [(5, T3), (4, T2), (3, T1), (1, T1)])
def test_an_interval_has_the_degrees_of_freedom_of_its_blocks(blocks: int, quantile: float) -> None:
    free = of([1.0, 0.1], [0.04, 0.01], blocks=blocks)
    assert free.interval90(0) == pytest.approx((1.0 - 0.2 * quantile, 1.0 + 0.2 * quantile))
    assert free.interval90(1) == pytest.approx((0.1 - 0.1 * quantile, 0.1 + 0.1 * quantile))
    assumed = of([1.0, 0.1], [0.04, 0.01], blocks=blocks, assumed=np.diag([0.0, 0.03]))
    assert assumed.interval90(0) == free.interval90(0)
    assert assumed.interval90(1) == pytest.approx((0.0, 0.1 + 0.2 * quantile))


@pytest.mark.parametrize("estimate", [-3.0, -0.5, 0.0])
def test_an_interval_at_zero_contains_90_percent_of_the_positive_part(estimate: float) -> None:
    """Student's t with 2 degrees of freedom has the distribution function 1/2 + x / (2 sqrt(2 + x^2))."""

    def above(size: float) -> float:
        x = (size - estimate) / 0.5
        return 0.5 - x / (2 * np.sqrt(2 + x**2))

    at_bound = of([1.0, 0.0], [0.04, 0.0], blocks=4, unconstrained=np.array([[0.0, 0.0], [estimate, 0.5]]))
    low, high = at_bound.interval90(1)
    assert low == 0.0
    assert above(high) == pytest.approx(0.1 * above(0.0))
    assert at_bound.interval90(0) == pytest.approx((1.0 - 0.2 * T2, 1.0 + 0.2 * T2))


def test_the_cramer_rao_bound_contains_only_unknowns_above_zero() -> None:
    H, prior = np.array([[4.0, 1.0, 2.0], [1.0, 2.0, 0.0], [2.0, 0.0, 5.0]]), np.diag([1.0, 0.0, 3.0])
    at_bound = of([1.0, 0.0, 2.0], [1.0, 0.0, 1.0], blocks=9, information=H)
    assert at_bound.cramer_rao_std == pytest.approx([np.sqrt(5 / 16), 0.0, np.sqrt(4 / 16)])
    assert at_bound.cramer_rao_with(1) == pytest.approx(np.sqrt(16 / 27))
    both = of([1.0, 0.0, 2.0], [1.0, 0.0, 1.0], blocks=9, information=H, prior=prior)
    assert both.cramer_rao_std == pytest.approx([np.sqrt(8 / 36), 0.0, np.sqrt(5 / 36)])


def test_zeros_of_encoders_count_as_fitted_values_and_initial_states_have_their_own_information(
    rng: np.random.Generator,
) -> None:
    free = [Mock(block="ratios")] * 5 + [Mock(block="zeros")] * 4
    R = np.triu(rng.normal(size=(3, 4, 4))) + 5 * np.eye(4)
    segments = Mock(setups=[Setup()])
    fitted = RatioFit(Mock(evidence=100, segments=segments), Mock(free=free, linear=Mock(R=R)))
    assert fitted.dof == 100 - 5 - 4
    assert fitted.initial_covariances == pytest.approx(np.linalg.inv(R.transpose(0, 2, 1) @ R))


def test_the_covariance_of_the_runs_is_the_one_without_the_prior() -> None:
    runs, prior = np.array([[5.0, 2.0], [2.0, 3.0]]), np.array([[2.0, 0.5], [0.5, 1.0]])
    both = replace(of([1.0, 1.0], [1.0, 1.0], blocks=9, prior=prior), covariance=np.linalg.inv(runs + prior))
    assert both.of_runs == pytest.approx(np.linalg.inv(runs))
    assert both.of_prior == pytest.approx(np.diag(both.covariance) / [1.0 / 1.75, 2.0 / 1.75])
    unseen = replace(both, covariance=np.linalg.inv(prior))
    assert unseen.of_prior == pytest.approx([1.0, 1.0])
    assert np.sqrt(np.diag(unseen.of_runs)) == pytest.approx(1000 * np.sqrt(np.diag(unseen.covariance)), rel=1e-3)


def test_a_block_ends_after_half_a_second_and_with_its_segment() -> None:
    """Three segments of two axes; the second has two readings in one block, and the third has one reading."""
    problem: Any = SimpleNamespace(
        owner=np.array([0, 0, 0, 1, 1, 2]),
        t=np.array([7.0, 7.4, 7.6, 7.7, 8.1, 8.2]),
        axes=2,
        segments=SimpleNamespace(offsets=np.array([0, 3, 5, 6])),
    )
    scores = np.full((3, 6), np.nan)
    scores[0], scores[1, :4], scores[2, :2] = 2.0 ** np.arange(6), 2.0 ** np.arange(6, 10), [1024.0, 2048.0]
    blocks = uncertainty._block_scores(problem, np.stack([scores, -scores], axis=2))
    assert blocks.tolist() == [[15.0, -15.0], [48.0, -48.0], [960.0, -960.0], [3072.0, -3072.0]]


def ratio_fit(chi2_per_dof: float, prior: float) -> Any:
    return SimpleNamespace(
        chi2_per_dof=chi2_per_dof, noise_factor=max(1.0, chi2_per_dof), prior_information=np.array([[prior]])
    )


@pytest.mark.parametrize(
    ("size", "chi2_per_dof", "prior", "variance"),
    [
        (0.1, 1.2, 0.0, 1.2 / 4),  # the information at the actual residual variance
        (3.0, 1.2, 0.0, 6 / 5 * 54 / 16),  # (6 blocks, 1 unknown): the scatter of the scores
        (3.0, 1.2, 1.0, 1.0),  # not more than the variance of the prior
        (0.1, 2.0, 0.0, (1.1 * 4.0 / 2 / 1.644854) ** 2),  # half the difference of the two halves is the 90 % reach
        (0.1, 2.0, 4.0, 0.25),
    ],
)
def test_the_variance_is_the_largest_that_the_prior_permits(
    monkeypatch: pytest.MonkeyPatch, size: float, chi2_per_dof: float, prior: float, variance: float
) -> None:
    monkeypatch.setattr(uncertainty, "_halves_apart", lambda _: np.array([4.0]))
    scores = size * np.array([[1.0], [-1.0]] * 3) + 7.0  # the mean is the gradient of the prior
    free, H = np.ones(1, dtype=bool), np.array([[4.0]])
    bread, covariance = uncertainty._covariance(ratio_fit(chi2_per_dof, prior), H, scores, free)
    assert bread == pytest.approx(1 / (4 + chi2_per_dof * prior))
    assert covariance == pytest.approx(variance)


def test_the_halves_of_a_run_differ_by_the_change_of_the_ratios(rng: np.random.Generator) -> None:
    """The ratios change in the middle of each run, and the initial states of each half are free.

    The second of the three segments contains the middle of the first run; the third is a run of its own.
    """
    samples, axes = 12, 2
    t = np.concatenate([np.arange(12), np.arange(12, 20), np.arange(50, 62)]) * 0.1
    owner = np.repeat([0, 1, 2], [12, 8, 12])
    run = np.array([0, 0, 1])
    inside = np.ones((3, samples, axes), dtype=bool)
    inside[1, 8:] = False
    late = np.zeros_like(inside)
    late[0, 10:] = late[1] = late[2, 6:] = True  # middles: 0.95 s and 5.55 s
    inside, late = inside.reshape(3, -1), late.reshape(3, -1)
    slopes, Q = (rng.normal(size=(3, samples * axes, k)) * inside[:, :, None] for k in (2, 3))
    first, second = np.array([1.0, -2.0]), np.array([1.5, -5.0])
    states = [np.einsum("smk,sk->sm", Q, rng.normal(size=(3, 3))) for _ in range(2)]
    e = np.where(late, slopes @ second + states[1], slopes @ first + states[0])
    fit: Any = SimpleNamespace(
        problem=SimpleNamespace(
            owner=owner, t=t, axes=axes, segments=SimpleNamespace(offsets=np.array([0, 12, 20, 32]), run=run)
        ),
        fit=SimpleNamespace(linear=SimpleNamespace(e=e, Q=Q)),
        slopes=slopes,
    )
    assert uncertainty._halves_apart(fit) == pytest.approx([0.5, 3.0])

"""Baseline searches on Rosenbrock's valley, compared with SciPy's own loop."""

from itertools import islice, pairwise

import numpy as np
import pytest
from scipy.optimize import differential_evolution as scipy_differential_evolution

from dpr_lab.search import ALGORITHMS
from dpr_lab.search.cma_es import LARGEST_GROWTH

BOX = np.array([[0.5, -1.0, 2.0, 0.0, -4.0], [1.5, 1.0, 3.0, 0.1, 4.0]])
WIDTH = BOX[1] - BOX[0]


def rosenbrock(z):
    x = 4 * (z - BOX[0]) / WIDTH - 2
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1, keepdims=True)


def until(name, objective, evaluations, *, box=BOX, seed=0, **changed):
    algorithm = ALGORITHMS[name]
    settings = algorithm.settings(generations=100_000, **changed)
    generations = algorithm.run(objective, box, settings, np.random.default_rng(seed))
    return next(g for g in generations if g.evaluations >= evaluations)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "evaluations"), [("cma_es", 10_000), ("multistart", 4_000)])
def test_model_based_searches_follow_a_curved_valley_to_its_end(name, evaluations):
    assert until(name, rosenbrock, evaluations).best_cost < 1e-6


@pytest.mark.slow
def test_differential_evolution_is_as_good_as_scipys_own_loop():
    ours = [until("differential_evolution", rosenbrock, 5_000, seed=s).best_cost for s in range(5)]
    theirs = [
        scipy_differential_evolution(
            lambda columns: rosenbrock(columns.T)[:, 0],
            BOX.T,
            popsize=10,
            maxiter=99,
            tol=0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=s,
        ).fun
        for s in range(5)
    ]
    assert -1 < np.log10(np.median(ours) / np.median(theirs)) < 1


def test_differential_evolution_evaluates_only_its_trials():
    sizes = []

    def counted(z):
        sizes.append(len(z))
        return rosenbrock(z)

    settings = ALGORITHMS["differential_evolution"].settings(population=12, generations=3)
    list(ALGORITHMS["differential_evolution"].run(counted, BOX, settings, np.random.default_rng(0)))
    assert sizes == [12] * 4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cma_es", "multistart", "differential_evolution"])
def test_optimum_in_a_corner_is_reached(name):
    corner = np.where(np.arange(5) % 2, BOX[1], BOX[0])
    last = until(name, lambda z: 1 + (np.abs(z - corner) / WIDTH).sum(axis=1, keepdims=True), 6_000)
    assert np.allclose((last.best - corner) / WIDTH, 0, atol=1e-3)


@pytest.mark.slow
def test_cma_es_restarts_with_more_candidates_when_it_is_stuck():
    settings = ALGORITHMS["cma_es"].settings(population=6, restart_growth=2)
    flat = ALGORITHMS["cma_es"].run(lambda z: np.ones((len(z), 1)), BOX, settings, np.random.default_rng(0))
    sizes = {len(g.population) - 1 for g in islice(flat, 1, 60)}  # the best so far comes on top
    assert sizes == {12, 24, 48, 96, 192, 6 * LARGEST_GROWTH}


def test_multistart_descends_from_the_best_points_first():
    algorithm = ALGORITHMS["multistart"]
    first, second = islice(
        algorithm.run(rosenbrock, BOX, algorithm.settings(population=10), np.random.default_rng(0)), 2
    )
    assert second.best_cost < first.best_cost / 10
    assert np.isin(first.cost[1:], second.cost).all()


def test_multistart_gradient_is_right_at_both_walls():
    # A neighbour beyond the wall would be moved back onto it and show no slope.
    inside = BOX[0] + 0.3 * WIDTH
    last = until("multistart", lambda z: (((z - inside) / WIDTH) ** 4).sum(axis=1, keepdims=True), 1_000)
    assert np.allclose((last.best - inside) / WIDTH, 0, atol=0.05)


def test_plain_ga_keeps_its_elite():
    algorithm = ALGORITHMS["plain_ga"]
    settings = algorithm.settings(population=20, elite=3, mutation_rate=1.0, mutation_std=1.0)
    generations = list(islice(algorithm.run(rosenbrock, BOX, settings, np.random.default_rng(0)), 10))
    for before, after in pairwise(generations):
        assert (after.cost[:3] <= before.cost[:3]).all()


@pytest.mark.slow
def test_searches_leave_numpys_global_generator_alone():
    np.random.seed(1)
    expected = np.random.random(3)
    np.random.seed(1)
    for name in ALGORITHMS:
        until(name, rosenbrock, 300)
    assert np.array_equal(np.random.random(3), expected)

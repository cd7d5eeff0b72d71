"""Baseline searches on Rosenbrock's valley."""

from itertools import islice, pairwise

import numpy as np
import pytest

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
def test_cma_es_follows_a_curved_valley_to_its_end():
    assert until("cma_es", rosenbrock, 10_000).best_cost < 1e-6


@pytest.mark.slow
def test_cma_es_reaches_an_optimum_in_a_corner():
    corner = np.where(np.arange(5) % 2, BOX[1], BOX[0])
    last = until("cma_es", lambda z: 1 + (np.abs(z - corner) / WIDTH).sum(axis=1, keepdims=True), 6_000)
    assert np.allclose((last.best - corner) / WIDTH, 0, atol=1e-3)


@pytest.mark.slow
def test_cma_es_restarts_with_more_candidates_when_it_is_stuck():
    settings = ALGORITHMS["cma_es"].settings(population=6, restart_growth=2)
    flat = ALGORITHMS["cma_es"].run(lambda z: np.ones((len(z), 1)), BOX, settings, np.random.default_rng(0))
    sizes = {len(g.population) - 1 for g in islice(flat, 1, 60)}  # the best so far comes on top
    assert sizes == {12, 24, 48, 96, 192, 6 * LARGEST_GROWTH}


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

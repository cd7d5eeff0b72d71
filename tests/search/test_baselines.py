"""Baseline searches on Rosenbrock's valley."""

from itertools import islice, pairwise

import numpy as np
import pytest

from dpr_lab.search import ALGORITHMS

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

"""The orthogonal experiment against its definition and against brute force."""

from itertools import combinations, product

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.search.orthogonal import ARRAYS, array_for, better_levels, experiment

every_array = pytest.mark.parametrize("levels", ARRAYS.values(), ids=ARRAYS)


@every_array
def test_every_pair_of_columns_holds_each_pair_of_levels_equally_often(levels):
    for i, j in combinations(range(levels.shape[1]), 2):
        rows = levels[:, [i, j]].tolist()
        assert [rows.count(list(both)) for both in product([False, True], repeat=2)] == [len(levels) / 4] * 4


def test_sizes_are_what_the_names_say():
    assert {name: a.shape for name, a in ARRAYS.items()} == {"L8": (8, 7), "L12": (12, 11), "L16": (16, 15)}


@pytest.mark.parametrize("name", ["L12", "L16"])
def test_experiment_finds_the_best_mixture_of_an_additive_cost(name):
    rng = np.random.default_rng(3)
    x, y, optimum = rng.random((3, 20, 9))

    def costs(genes):
        return ((genes.reshape(20, -1, 9) - optimum[:, None]) ** 2).sum(axis=2).ravel()

    offspring, offspring_cost = experiment(x, y, array_for(name, 9), costs)
    for a, b, wanted, got, its_cost in zip(x, y, optimum, offspring, offspring_cost, strict=True):
        brute = min(((np.where(mix, b, a) - wanted) ** 2).sum() for mix in product([False, True], repeat=9))
        assert its_cost == pytest.approx(brute)
        assert ((got - wanted) ** 2).sum() == pytest.approx(brute)


def test_experiment_keeps_the_best_trial_when_the_prediction_is_worse():
    levels = array_for("L12", 9)
    lucky = levels[4]

    def costs(genes):  # one trial is excellent, for no reason that main effects could see
        return np.where((genes == lucky).all(axis=1), 0.0, 10 + genes.sum(axis=1))

    offspring, cost = experiment(np.zeros((1, 9)), np.ones((1, 9)), levels, costs)
    assert np.array_equal(offspring[0], lucky)
    assert cost[0] == 0


def test_the_experiment_evaluates_twice_for_any_number_of_pairs():
    asked = []

    def costs(genes):
        asked.append(len(genes))
        return genes.sum(axis=1)

    experiment(np.zeros((80, 9)), np.ones((80, 9)), array_for("L12", 9), costs)
    assert asked == [80 * 12, 80]


def test_failed_trials_neither_win_nor_hide_the_effects():
    levels = array_for("L12", 3)
    tried = np.where(levels[:, 0], 5.0, 1.0)[None]
    tried[0, np.flatnonzero(levels[:, 1])[:2]] = np.inf
    assert better_levels(tried, levels)[0, :2].tolist() == [False, False]
    offspring, cost = experiment(
        np.zeros((1, 3)), np.ones((1, 3)), levels, lambda genes: np.where(genes[:, 0] == 1, np.inf, 2.0)
    )
    assert cost[0] == 2
    assert offspring[0, 0] == 0


def test_all_trials_failed_gives_some_offspring_with_infinite_cost():
    offspring, cost = experiment(
        np.zeros((2, 3)), np.ones((2, 3)), array_for("L8", 3), lambda genes: np.full(len(genes), np.inf)
    )
    assert offspring.shape == (2, 3)
    assert np.isinf(cost).all()


def test_array_that_is_too_small_is_reported_with_the_remedy():
    with pytest.raises(ConfigError, match=r"orthogonal_array = 'L8' takes at most 7 .* there are 9: choose"):
        array_for("L8", 9)

"""Each operator of the IGA against its definition, gene by gene."""

import numpy as np
import pytest

from dpr_lab.search.fitness import cost, fitness, population_fitness
from dpr_lab.search.operators import around, cross, fresh, hamming_distance, mutate, near_duplicates, pair, replacements

UNIT = np.array([np.zeros(9), np.ones(9)])
BOX = np.array([np.linspace(0.8, 8, 9), np.linspace(1.2, 12, 9)])


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def on_grid(values, decimals):
    return np.allclose(values, np.round(values, decimals), rtol=0, atol=1e-12)


def test_hybrid_coding_uses_the_eleven_values_evenly(rng):
    genes = fresh(20_000, BOX, rng)
    beta = (genes - BOX[0]) / (BOX[1] - BOX[0])
    assert on_grid(beta, 1)
    assert (genes >= BOX[0]).all()
    assert (genes <= BOX[1]).all()
    counts = np.bincount(np.round(beta * 10).astype(int).ravel(), minlength=11)
    assert counts.shape == (11,)
    assert np.allclose(counts / beta.size, 1 / 11, atol=0.005)


def test_hybrid_coding_stays_in_the_box_despite_rounding(rng):
    box = np.array([rng.uniform(0.1, 1, 2000), rng.uniform(1, 10, 2000)])
    assert (box[0] + (box[1] - box[0]) > box[1]).any()  # so there is something to get wrong
    genes = fresh(100, box, rng)
    assert (genes >= box[0]).all()
    assert (genes <= box[1]).all()


def test_hamming_distance_counts_differing_genes(rng):
    x, y = rng.integers(3, size=(2, 50, 9)).astype(float)
    brute = [sum(a != b for a, b in zip(one, other, strict=True)) for one, other in zip(x, y, strict=True)]
    assert hamming_distance(x, y).tolist() == brute


def test_hamming_distance_with_tolerance_forgives_small_differences():
    assert hamming_distance(np.array([1.0, 2.0, 3.0]), np.array([1.05, 2.2, 3.2]), np.array([0.1, 0.1, 0.3])) == 1


def test_pairing_replaces_the_second_of_an_inbred_pair_by_a_fresh_chromosome(rng):
    same = np.full((10, 9), 0.123)
    same[5:, 3] = 0.456  # one gene apart is still inbred
    x, y = pair(same, np.ones(10), 500, UNIT, rng)
    assert np.isin(x, [0.123, 0.456]).all()
    assert on_grid(y, 1)


def test_pairing_keeps_parents_that_differ_in_two_genes(rng):
    genes = np.full((2, 9), 0.123)
    genes[1, :2] = 0.456
    x, y = pair(genes, np.ones(2), 400, UNIT, rng)
    one_of_each = (x[:, 0] != y[:, 0]) & np.isin(y[:, 0], [0.123, 0.456])
    assert 0.4 < one_of_each.mean() < 0.6  # the rest drew the same parent twice
    assert on_grid(y[~one_of_each], 1)


def test_pairing_draws_in_proportion_to_fitness_and_never_a_failed_one(rng):
    genes = np.array([[0.11] * 9, [0.22] * 9, [0.33] * 9])
    x, _ = pair(genes, np.array([3.0, 1.0, 0.0]), 20_000, UNIT, rng)
    assert (x[:, 0] == 0.11).mean() == pytest.approx(0.75, abs=0.02)
    assert not (x == 0.33).any()


def test_crossover_keeps_the_sum_at_the_crossed_gene_and_swaps_the_tails(rng):
    x, y = rng.random((2, 2000, 9))
    x_new, y_new = cross(x, y, rng)
    points = set()
    for a, b, a_new, b_new in zip(x, y, x_new, y_new, strict=True):
        kept = (a_new == a) & (b_new == b)
        swapped = (a_new == b) & (b_new == a)
        blended = np.flatnonzero(~kept & ~swapped)
        assert len(blended) <= 1  # none when beta is 0 or 1
        if len(blended):
            i = int(blended[0])
            points.add(i)
            assert kept[:i].all()
            assert swapped[i + 1 :].all()
            assert a_new[i] + b_new[i] == pytest.approx(a[i] + b[i], abs=1e-15)
            beta = (a_new[i] - b[i]) / (a[i] - b[i])
            assert 10 * beta == pytest.approx(round(10 * beta), abs=1e-6)
            assert 0 < beta < 1
    assert points == set(range(9))


def test_crossover_leaves_equal_genes_exactly_equal(rng):
    x = rng.random((1000, 9))
    x_new, y_new = cross(x, x.copy(), rng)
    assert np.array_equal(x_new, x)
    assert np.array_equal(y_new, x)


def test_each_pass_over_a_gene_adds_a_decimal(rng):
    x, y = (fresh(5000, UNIT[:, :1], rng) for _ in range(2))
    for decimals in (2, 3, 4):
        assert on_grid(np.stack([x, y]), decimals - 1)
        x, y = cross(x, y, rng)
        assert on_grid(np.stack([x, y]), decimals)
        assert not on_grid(np.stack([x, y]), decimals - 1)
        y = rng.permuted(y, axis=0)


def test_mutation_rate_and_the_mixture_of_one_and_several_genes(rng):
    genes = np.full((20_000, 9), 0.123)
    mutants, mutated = mutate(genes, 0.1, UNIT, rng)
    changed = (mutants != genes).sum(axis=1)
    assert np.array_equal(mutated, changed > 0)
    assert mutated.mean() == pytest.approx(0.1, abs=0.01)
    assert (changed[mutated] == 1).mean() == pytest.approx(0.5, abs=0.05)
    assert set(changed[mutated]) == set(range(1, 10))
    assert on_grid(mutants[mutants != genes], 1)
    assert (mutants != genes)[changed == 1].any(axis=0).all()


def test_population_fitness_by_hand():
    assert population_fitness(np.array([10.0, 5.0, 0.0])) == pytest.approx(0.5)
    assert population_fitness(np.full(4, 3.0)) == 1
    assert population_fitness(np.zeros(4)) == 0


def test_dynamic_encoding_stays_within_five_percent_and_in_the_box(rng):
    best = np.array([1.0, 2.0, 4.0])
    box = np.array([[0.5, 1.98, 0.0], [2.0, 3.0, 4.0]])
    genes = around(best, 5000, 0.95, 0.1, box, rng)
    assert np.unique(np.round(genes[:, 0], 9)).tolist() == pytest.approx(np.arange(0.95, 1.051, 0.01).tolist())
    assert genes[:, 1].min() == 1.98
    assert genes[:, 1].max() == pytest.approx(2.1)
    assert genes[:, 2].max() == 4


def test_near_duplicates_are_those_with_a_better_twin():
    genes = np.array([[0.5, 0.5, 0.5], [0.505, 0.5, 0.9], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [0.5, 0.1, 0.1]])
    assert near_duplicates(genes, np.full(3, 0.01)).tolist() == [False, True, False, True, False]


def test_replacements_are_local_or_fresh_with_even_chances(rng):
    best = np.full(9, 0.5)
    genes = replacements(best, 4000, 0.95, 0.1, UNIT, rng)
    local = (np.abs(genes - best) <= 0.025 + 1e-12).all(axis=1)
    assert local.mean() == pytest.approx(0.5, abs=0.03)
    assert on_grid(genes[~local], 1)


def test_cost_by_hand():
    errors = np.array([[1.0, 2.0, 6.0], [4.0, np.nan, 1.0], [np.inf, 0.0, 0.0], [1e200, 0.0, 0.0]])
    failed = [np.inf] * 3
    assert cost(errors, "sum").tolist() == [9, *failed]
    assert cost(errors, "max").tolist() == [6, *failed]
    assert cost(errors, "min").tolist() == [1, *failed]


def test_fitness_by_hand():
    assert fitness(np.array([0.0, 35.0, np.inf]), 350, 35).tolist() == [10, 5, 0]

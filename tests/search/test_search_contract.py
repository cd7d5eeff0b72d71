"""What every algorithm promises; joining `ALGORITHMS` is joining these tests."""

from itertools import islice, pairwise, product

import numpy as np
import pytest

from dpr_lab.search import ALGORITHMS
from tests.thinned import thinned

NOMINAL = np.array([0.2, 0.2, 0.1, 0.1, 0.208, 0.001, 0.001, 0.00133, 0.00133])
BOX = np.array([0.8 * NOMINAL, 1.2 * NOMINAL])
OFF_GRID = np.array([0.137, 0.521, 0.863, 0.294, 0.448, 0.712, 0.369, 0.081, 0.655])


def by_turns(names, cases):
    """Every algorithm in every case. Fast tests use each algorithm and each case, in turn."""
    argnames = ("algorithm", *names)
    some = thinned(list(product(cases, ALGORITHMS)), 4)
    values = [pytest.param(ALGORITHMS[a], *c, marks=p.marks, id=f"{c[0]}-{a}") for p in some for c, a in [p.values[0]]]
    return pytest.mark.parametrize(argnames, values)


every_algorithm = pytest.mark.parametrize("algorithm", ALGORITHMS.values(), ids=ALGORITHMS)


def share(z, box=BOX):
    return (z - box[0]) / (box[1] - box[0])


def bowl(z):
    return 1000 * ((share(z) - OFF_GRID) ** 2).sum(axis=1, keepdims=True)


def ripples(z):
    """Smooth, with many local minima: the best of them at OFF_GRID, where E is 0 in all three poses."""
    apart = share(z) - OFF_GRID
    valley = (apart**2).sum(axis=1, keepdims=True)
    waves = (1 - np.cos(6 * np.pi * apart)).sum(axis=1, keepdims=True)
    return valley * np.array([100.0, 200.0, 300.0]) + 3 * waves


def run(algorithm, objective, at_most, *, box=BOX, seed=1, **changed):
    settings = algorithm.settings(**changed)
    return list(islice(algorithm.run(objective, box, settings, np.random.default_rng(seed)), at_most + 1))


@every_algorithm
def test_yields_the_initial_population_first_and_ends_by_itself(algorithm):
    generations = run(algorithm, bowl, 99, generations=3)
    assert [g.number for g in generations] == [0, 1, 2, 3]


@every_algorithm
def test_stays_in_the_box(algorithm):
    asked = []

    def objective(z):
        asked.append(z.copy())
        return 1 / (1 + bowl(z))  # drives the search into the corners

    run(algorithm, objective, 12)
    everything = np.vstack(asked)
    assert (everything >= BOX[0]).all()
    assert (everything <= BOX[1]).all()


@every_algorithm
def test_counts_every_evaluation(algorithm):
    asked = [0]

    def objective(z):
        asked.append(asked[-1] + len(z))
        return bowl(z)

    for generation in islice(algorithm.run(objective, BOX, algorithm.settings(), np.random.default_rng(1)), 8):
        assert generation.evaluations == asked[-1]


@every_algorithm
def test_same_seed_same_answer_other_seed_other_answer(algorithm):
    first, again, other = (run(algorithm, ripples, 4, seed=seed)[-1] for seed in (5, 5, 6))
    assert np.array_equal(first.population, again.population)
    assert not np.array_equal(first.population, other.population)


@every_algorithm
def test_best_is_real_and_never_gets_worse(algorithm):
    generations = run(algorithm, ripples, 25)
    for before, after in pairwise(generations):
        assert after.best_cost <= before.best_cost
    for g in generations:
        assert g.best_cost == ripples(g.best[None]).sum()
        assert np.array_equal(g.cost, ripples(g.population).sum(axis=1))
        assert (np.diff(g.cost) >= 0).all()
        assert 0 < g.population_fitness <= 1


@by_turns(["failure"], [(np.inf,), (np.nan,), (1e300,)])
def test_failed_candidate_never_wins(algorithm, failure):
    def objective(z):
        errors = np.tile(bowl(z), 3)
        errors[share(z)[:, 0] < 0.3, 1] = failure  # one pose fails, around the optimum
        return errors

    last = run(algorithm, objective, 40)[-1]
    assert np.isfinite(last.best_cost)
    assert share(last.best)[0] >= 0.3
    assert 0 < last.population_fitness <= 1


@every_algorithm
def test_all_candidates_failing_is_no_exception(algorithm):
    last = run(algorithm, lambda z: np.full((len(z), 3), np.nan), 5)[-1]
    assert last.best_cost == np.inf
    assert last.population_fitness == 0


@every_algorithm
def test_finds_the_few_that_do_not_fail(algorithm):
    last = run(algorithm, lambda z: np.where(share(z)[:, :1] > 0.75, bowl(z), np.inf), 60)[-1]
    assert share(last.best)[0] > 0.75
    assert last.best_cost < 1000 * (0.8 - OFF_GRID[0]) ** 2 + 1


@every_algorithm
def test_fixed_genes_stay_fixed(algorithm):
    box = BOX.copy()
    box[:, [0, 4, 8]] = NOMINAL[[0, 4, 8]]

    def objective(z):
        assert (z[:, [0, 4, 8]] == NOMINAL[[0, 4, 8]]).all()
        return bowl(z)

    last = run(algorithm, objective, 100, box=box)[-1]
    free = [1, 2, 3, 5, 6, 7]
    assert np.allclose(share(last.best)[free], OFF_GRID[free], atol=0.01)


@every_algorithm
def test_one_free_gene_is_enough(algorithm):
    box = np.array([[1.0, 2.0], [1.0, 3.0]])
    last = run(algorithm, lambda z: (z[:, 1:] - 2.3456) ** 2, 100, box=box)[-1]
    assert last.best[0] == 1
    assert last.best[1] == pytest.approx(2.3456, abs=1e-3)


@pytest.mark.slow
@every_algorithm
def test_beats_random_search_with_the_same_evaluations(algorithm):
    generations = algorithm.run(bowl, BOX, algorithm.settings(), np.random.default_rng(1))
    last = next(g for g in generations if g.evaluations > 5000 or g.best_cost < 1)
    guesses = np.random.default_rng(2).uniform(BOX[0], BOX[1], (last.evaluations, 9))
    assert last.best_cost < bowl(guesses).min() / 10


@every_algorithm
@pytest.mark.parametrize("seed", thinned(range(3), 3))
def test_reaches_an_optimum_off_its_grid_among_local_ones(algorithm, seed):
    last = run(algorithm, ripples, 150, seed=seed)[-1]
    assert np.allclose(share(last.best), OFF_GRID, atol=0.01)


@every_algorithm
def test_a_population_of_identical_costs_causes_no_error(algorithm):
    last = run(algorithm, lambda z: np.ones((len(z), 3)), 5)[-1]
    assert last.best_cost == 3
    assert last.population_fitness == 1


@by_turns(["level"], [(1.0,), (0.0,), (np.inf,)])
def test_stops_without_improvement_if_requested(algorithm, level):
    def flat(z):
        return np.full((len(z), 1), level)

    assert run(algorithm, flat, 20, stagnation_generations=4)[-1].number == 4
    assert run(algorithm, flat, 20)[-1].number == 20


@every_algorithm
def test_goes_on_while_it_improves(algorithm):
    generations = run(algorithm, bowl, 100, stagnation_generations=5, stagnation_improvement=0.5)
    costs = [g.best_cost for g in generations]
    slow = [after >= before / 2 for before, after in zip(costs, costs[5:], strict=False)]
    assert slow == [False] * (len(slow) - 1) + [True]


@pytest.mark.slow
@by_turns(["aggregate", "optimum", "worse"], [("sum", 0.5, 0), ("max", 0.5, 1e-3), ("min", 0.2, 3)])
def test_aggregate_decides_between_poses(algorithm, aggregate, optimum, worse):
    def objective(z):  # the first pose likes 0.2, the second 0.8 and is worse; the mean of both is best at 0.5
        wants_low, wants_high = (share(z) - 0.2) ** 2, (share(z) - 0.8) ** 2
        return np.column_stack([wants_low.sum(axis=1), wants_high.sum(axis=1) + worse])

    last = run(algorithm, objective, 100, aggregate=aggregate)[-1]
    assert np.allclose(share(last.best), optimum, atol=0.03)


@every_algorithm
@pytest.mark.parametrize(
    ("box", "message"),
    [
        (BOX[0], r"\(2, d\)"),
        (BOX[::-1], "reversed for gene 0"),
        (np.array([[0.0, 1.0], [np.inf, 2.0]]), "finite"),
        (np.array([[1.0, 2.0], [1.0, 2.0]]), "nothing to search"),
    ],
)
def test_refuses_bounds_it_cannot_search(algorithm, box, message):
    with pytest.raises(ValueError, match=message):
        run(algorithm, bowl, 1, box=box)


@every_algorithm
@pytest.mark.parametrize(
    ("answer", "message"), [(np.zeros(7), "poses"), (np.zeros((3, 2)), "poses"), (-1.0, "sum of squares")]
)
def test_refuses_an_invalid_objective(algorithm, answer, message):
    with pytest.raises(ValueError, match=message):
        run(algorithm, lambda z: np.full((len(z), 3), answer) if np.isscalar(answer) else answer, 1)

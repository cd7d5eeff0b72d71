"""Complete IGA: budget, acceptance, settings files."""

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.settings import IgaSettings

BOX = np.array([np.full(9, 0.8), np.full(9, 1.2)])


def batches(objective, generations, box=BOX, **changed):
    """Sizes of the batches that each generation evaluates."""
    sizes = []

    def counted(z):
        sizes.append(len(z))
        return objective(z)

    seen, per_generation = 0, []
    settings = IgaSettings(generations=generations, **changed)
    for _ in ALGORITHMS["iga"].run(counted, box, settings, np.random.default_rng(4)):
        per_generation.append(sizes[seen:])
        seen = len(sizes)
    return per_generation


def slope(z):
    return 1e4 * (z - 0.8).sum(axis=1, keepdims=True)


def flat(z):
    return np.ones((len(z), 1))


def test_generation_costs_as_many_evaluations_as_in_the_paper():
    initial, generation = batches(slope, 1)
    assert initial == [200]
    assert generation[:2] == [80 * 12, 80]
    assert len(generation) == 3
    assert generation[2] <= 20  # the mutated ones among 80


def test_fixed_genes_take_no_columns_of_the_array():
    box = BOX.copy()
    box[:, :2] = 1.0
    _, generation = batches(slope, 1, box, orthogonal_array="L8", mutation_rate=0.0)
    assert generation == [80 * 8, 80]


def test_array_that_is_too_small_is_refused_before_anything_is_evaluated():
    def objective(z):
        raise AssertionError

    with pytest.raises(ConfigError, match="L8"):
        batches(objective, 1, orthogonal_array="L8")


@pytest.mark.parametrize(
    ("objective", "changed", "opens"),
    [
        (flat, {}, True),
        (flat, {"alpha": 1.0}, False),
        (flat, {"sigma": 10.0}, False),  # the best fitness is 350 / (1 + 35)
        (slope, {}, False),
    ],
    ids=["converged", "alpha too high", "sigma too high", "not converged"],
)
def test_feedback_waits_for_alpha_and_sigma(objective, changed, opens):
    # A single free gene has eleven values, so that 200 chromosomes hold near 189 duplicates.
    box = np.full((2, 9), 1.0)
    box[:, 0] = 0.8, 1.2
    _, generation = batches(objective, 1, box, mutation_rate=0.0, **changed)
    refreshed = [size for size in generation if size not in (80 * 12, 80)]
    assert refreshed == ([189] if opens else [])


def test_built_in_paper_file_holds_the_default_settings():
    assert load_search("paper") == IgaSettings()


def test_built_in_segments_file_stops_on_stagnation():
    settings = load_search("segments")
    generations = list(ALGORITHMS[settings.algorithm].run(flat, BOX, settings, np.random.default_rng(0)))
    assert settings.stagnation_generations == len(generations) - 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('algorithm = "multistart"', "algorithm = 'multistart': unknown; available: iga, plain_ga, cma_es"),
        ('algorithm = "simplex"', r"bad\.toml: algorithm = 'simplex': unknown; available: .*iga"),
        ("population = 10", r"bad\.toml: algorithm: is missing"),
        ('algorithm = "iga"\npopulation = 1', r"bad\.toml: population = 1: .*greater than or equal to 2"),
        ('algorithm = "iga"\npopulatoin = 10', r"bad\.toml: populatoin = 10: unknown key"),
        ('algorithm = "iga"\ndelta = 0', r"bad\.toml: delta = 0: .*greater than 0"),
    ],
)
def test_bad_search_file_names_file_key_and_value(tmp_path, text, message):
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_search(path)

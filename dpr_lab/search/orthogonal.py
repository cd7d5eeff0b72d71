"""Orthogonal experiment: combine two chromosomes in few trials, step (6) of the algorithm."""

from collections.abc import Callable

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.errors import ConfigError

Levels = Flags


def _plackett_burman() -> Levels:
    row = np.array([1, 1, 0, 1, 1, 1, 0, 0, 0, 1, 0], dtype=bool)
    return np.vstack([[np.roll(row, shift) for shift in range(11)], np.zeros((1, 11), dtype=bool)])


def _sylvester(order: int) -> Levels:
    runs = 2**order
    common_bits = np.arange(runs)[:, None] & np.arange(1, runs)
    return np.bitwise_count(common_bits) % 2 == 1


def _checked(levels: Levels) -> Levels:
    with_mean = np.column_stack([np.ones(len(levels)), np.where(levels, 1.0, -1.0)])
    assert np.array_equal(with_mean.T @ with_mean, len(levels) * np.eye(with_mean.shape[1])), "columns not orthogonal"
    return levels


ARRAYS: dict[str, Levels] = {
    "L8": _checked(_sylvester(3)),
    "L12": _checked(_plackett_burman()),
    "L16": _checked(_sylvester(4)),
}
"""Two-level arrays (runs, columns): every pair of columns contains each pair of levels equally often.

Source: Plackett & Burman (1946), Biometrika 33(4) 305-325, for L12; Sylvester's Hadamard matrices for L8 and L16.
"""


def array_for(name: str, genes: int) -> Levels:
    """Return the (runs, genes) levels of a named array, one column per gene.

    Raises:
        ConfigError: the array has fewer columns than there are genes to search for.
    """
    levels = ARRAYS[name]
    if genes > levels.shape[1]:
        raise ConfigError(
            f"orthogonal_array = {name!r} takes at most {levels.shape[1]} searched parameters, but there are"
            f" {genes}: choose a larger array, or measure some of the parameters"
        )
    return levels[:, :genes]


def experiment(x: Array, y: Array, levels: Levels, costs: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return the best tested combination of the genes of each pair of chromosomes.

    The tested combinations of a pair are those of the orthogonal array, and the combination of the better level of each
    gene (`better_levels`).

    Args:
        x: (pairs, n) chromosomes, level 0 of each gene
        y: (pairs, n) chromosomes, level 1 of each gene
        levels: (runs, n) orthogonal array
        costs: function from (any, n) genes to (any,) H; called once for all trials and once for all predicted
            combinations

    Returns:
        (pairs, n) offspring and (pairs,) their H

    Source: docs/theory.md (6).
    """
    pairs, n = x.shape
    trials = np.where(levels, y[:, None], x[:, None])
    tried = costs(trials.reshape(-1, n)).reshape(pairs, len(levels))
    predicted = np.where(better_levels(tried, levels), y, x)
    everything = np.concatenate([trials, predicted[:, None]], axis=1)
    every_cost = np.column_stack([tried, costs(predicted)])
    winner = np.arange(pairs), np.argmin(every_cost, axis=1)
    return everything[winner], every_cost[winner]


def better_levels(tried: Array, levels: Levels) -> Levels:
    """Return the level of each gene with the lower mean cost of trials.

    The combination of these levels is optimal if the cost is a sum over genes.

    Args:
        tried: (pairs, runs) H of each trial; a failed trial counts as the worst trial of its pair that did not fail
        levels: (runs, n) orthogonal array

    Returns:
        (pairs, n) levels
    """
    failed = np.isinf(tried)
    worst = np.where(failed, 0.0, tried).max(axis=1, keepdims=True)
    return np.where(failed, worst, tried) @ np.where(levels, 1.0, -1.0) < 0

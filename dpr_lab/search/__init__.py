"""Global search: minimise a cost over a box, one operator or algorithm per file."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from dpr_lab.configs import find_config, read_config
from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.plugins.rows import plugin_rows
from dpr_lab.search.cma_es import CmaEsSettings, cma_es
from dpr_lab.search.differential_evolution import DifferentialEvolutionSettings, differential_evolution
from dpr_lab.search.iga import iga
from dpr_lab.search.multistart import MultistartSettings, multistart
from dpr_lab.search.plain_ga import PlainGaSettings, plain_ga
from dpr_lab.search.problem import Algorithm
from dpr_lab.search.settings import IgaSettings, SearchSettings

ALGORITHMS: dict[str, Algorithm[Any]] = {
    "iga": Algorithm(IgaSettings, iga, "improved genetic algorithm"),
    "plain_ga": Algorithm(PlainGaSettings, plain_ga, "plain genetic algorithm"),
    "differential_evolution": Algorithm(
        DifferentialEvolutionSettings, differential_evolution, "differential evolution"
    ),
    "cma_es": Algorithm(CmaEsSettings, cma_es, "covariance matrix adaptation"),
    "multistart": Algorithm(MultistartSettings, multistart, "local searches from many starts"),
}
ALGORITHMS |= plugin_rows("searches", Algorithm, ALGORITHMS)
"""Value of `algorithm` in a search file -> algorithm; a new algorithm is one file and one row here."""


def search_words(name: str) -> str:
    """Words and name of an algorithm, `improved genetic algorithm [iga]`; other names are unchanged."""
    return f"{ALGORITHMS[name].words} [{name}]" if name in ALGORITHMS else name


class _Choice(BaseModel):
    algorithm: str


def load_search(name: str | Path) -> SearchSettings:
    """Read a search file by path, or a built-in one by its bare name (`paper`, `segments`).

    Returns:
        the settings, to be run with `ALGORITHMS[settings.algorithm].run(objective, bounds, settings, rng)`

    Raises:
        ConfigError: not found or not valid; the message names file, key and value.
    """
    path = find_config("search", name)
    algorithm = read_config(path, _Choice).algorithm
    if algorithm not in ALGORITHMS:
        raise ConfigError(unknown_name(f"{path}: algorithm = {algorithm!r}: unknown", algorithm, ALGORITHMS))
    return read_config(path, ALGORITHMS[algorithm].settings)

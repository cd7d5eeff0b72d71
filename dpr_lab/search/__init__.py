"""Global search algorithms with bounds."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from dpr_lab.configs import find_config, read_config
from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.plugins.rows import plugin_rows
from dpr_lab.search.algorithm import Algorithm
from dpr_lab.search.cma_es import CmaEsSettings, cma_es
from dpr_lab.search.iga import iga
from dpr_lab.search.plain_ga import PlainGaSettings, plain_ga
from dpr_lab.search.settings import IgaSettings, SearchSettings

ALGORITHMS: dict[str, Algorithm[Any]] = {
    "iga": Algorithm(IgaSettings, iga, "improved genetic algorithm"),
    "plain_ga": Algorithm(PlainGaSettings, plain_ga, "plain genetic algorithm"),
    "cma_es": Algorithm(CmaEsSettings, cma_es, "covariance matrix adaptation"),
}
ALGORITHMS |= plugin_rows("searches", Algorithm, ALGORITHMS)
"""All search algorithms, by the value of `algorithm` in a search file.

To add an algorithm, write one file and add one row here.
"""


def search_words(name: str) -> str:
    """Return the title and name of an algorithm, such as `improved genetic algorithm [iga]`.

    An unknown name is returned unchanged.
    """
    return f"{ALGORITHMS[name].words} [{name}]" if name in ALGORITHMS else name


class _Choice(BaseModel):
    algorithm: str


def load_search(name: str | Path) -> SearchSettings:
    """Read a search file by its path or built-in name.

    Returns:
        the settings, for the call `ALGORITHMS[settings.algorithm].run(objective, bounds, settings, rng)`

    Raises:
        ConfigError: the file is not found or not valid; the message names file, key and value.
    """
    path = find_config("search", name)
    algorithm = read_config(path, _Choice).algorithm
    if algorithm not in ALGORITHMS:
        raise ConfigError(unknown_name(f"{path}: algorithm = {algorithm!r}: unknown", algorithm, ALGORITHMS))
    return read_config(path, ALGORITHMS[algorithm].settings)

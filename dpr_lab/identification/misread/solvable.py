"""Convert linear algebra errors to messages about recordings that do not determine the model."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

from dpr_lab.errors import IdentificationError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def solvable(analysis: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap an analysis so that it raises `IdentificationError` if its equations have no solution.

    NumPy warnings about infinite and NaN values are suppressed. Such values occur after a failed integration, and are
    only compared.
    """

    @wraps(analysis)
    def solved(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                return analysis(*args, **kwargs)
        except np.linalg.LinAlgError as error:
            raise IdentificationError(
                "these recordings do not determine the model: its equations have no finite solution. Check zero, unit,"
                " sign and order of the angles and the unit of time, or record larger and longer swings"
            ) from error

    return solved

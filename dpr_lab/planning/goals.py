"""Whether planned releases decide the limits that a rig must keep (`dpr-lab accept`).

A limit is decided by a 90 % interval, 1.645 standard deviations on either side. A quantity at half its limit, or in the
middle of its range, passes on average if that reach is below the distance to the limit.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dpr_lab.acceptance.limits import Limits
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.planning.criteria import detectable, ratio_std
from dpr_lab.planning.knowledge import Knowledge
from dpr_lab.planning.result import LimitForecast

Array = NDArray[np.float64]


def limit_forecasts(known: Knowledge, F: Array, limits: Limits) -> list[LimitForecast]:
    """Each limit of a file, and whether releases with some information decide it.

    Args:
        known: what is known now
        F: (k, k) information with the planned releases
        limits: what the rig must keep
    """
    return [*_of_effects(known, F, limits), *_of_ratios(known, F, limits)]


def _of_effects(known: Knowledge, F: Array, limits: Limits) -> Iterator[LimitForecast]:
    sizes = detectable(known, F, NORMAL_Q90)
    for name, amplitudes in limits.effects.items():
        for parameter, limit in amplitudes.items():
            reach = sizes.get(name, {}).get(parameter)
            single = len(EFFECTS[name].amplitudes) == 1 or name in known.named
            decides = single and reach is not None and reach < limit.max / 2
            yield LimitForecast(quantity=f"{name}.{parameter}", unit=limit.unit, reach=reach, decides=decides)


def _of_ratios(known: Knowledge, F: Array, limits: Limits) -> Iterator[LimitForecast]:
    reaches = NORMAL_Q90 * ratio_std(known, F)
    for name, limit in limits.ratios.items():
        index = RATIOS.index(name)
        lower, upper = limit.bounds
        middle = known.model.estimate.ratios[index] if lower is None or upper is None else (lower + upper) / 2
        room = min((abs(end - middle) for end in (lower, upper) if end is not None), default=np.inf)
        reach = float(reaches[index])
        yield LimitForecast(quantity=name, unit=limit.unit, reach=reach, decides=reach < room)

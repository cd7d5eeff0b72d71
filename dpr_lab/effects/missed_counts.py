"""Counts that an encoder lost or gained at one instant of one run."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter, shape
from dpr_lab.effects.quantities import Known
from dpr_lab.kernels import njit


@njit
def stepped(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """vector[at] counts more on joint vector[at + 1] from vector[at + 3] s on, in run vector[at + 2]."""
    if run != round(vector[at + 2]) or t < vector[at + 3]:
        return 0.0, 0.0
    if round(vector[at + 1]) == 1:
        return 2.0 * math.pi / known.counts_per_rev1 * vector[at], 0.0
    return 0.0, 2.0 * math.pi / known.counts_per_rev2 * vector[at]


MISSED_COUNTS = Effect(
    name="missed_counts",
    equation="the encoder of one joint reads n counts more from an instant of one run on",
    parameters=(
        EffectParameter("counts", "counts", 20.0),
        shape("joint", "1", 2.0, (1.0, 2.0)),
        EffectParameter("run", "1", 1.0, "positive", "shape"),
        EffectParameter("time_s", "s", 5.0, "positive", "shape", 5.0),
    ),
    site="sensor",
    stage="encoder",
    kernel=stepped,
    bench_check=(
        "Compare the angle at which the rods hang before and after the run: it has moved by whole counts. Check shield"
        " and connector of that encoder, and that its edges stay below the counter's highest rate."
    ),
    source="Quadrature counters lose edges in steps of whole counts; `run` counts the releases from 0.",
)

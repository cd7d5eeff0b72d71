"""A device clock that runs fast or slow."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.kernels import njit


@njit
def fast(t: float, vector: NDArray[np.float64], at: int) -> tuple[float, float]:
    """True time less device time at the device time t, s, for a clock that runs by vector[at] too fast."""
    shift = t / (1.0 + vector[at]) - t
    return shift, shift


CLOCK_RATE = Effect(
    name="clock_rate",
    equation="both encoders are read at t / (1 + x), t the device's time since the release",
    parameters=(EffectParameter("excess", "1", 1e-3),),
    site="timing",
    stage="timing",
    kernel=fast,
    twins=("wrong_length_L1",),
    bench_check=(
        "Compare ten minutes of the device's ticks with the host's clock (`dpr-lab run info` shows it); a crystal is"
        " off by 0.01 % at most, so that an error above that is the length L1 (or gravity)."
    ),
    source="Equation (1) keeps its form when time is scaled, but for gravity.",
)

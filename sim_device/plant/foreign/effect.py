"""Define out-of-library effects: effects that the library does not contain in this form."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect
from sim_device.plant.foreign.engine import Body, EquationOfMotion

Values = Mapping[str, float]
Array = NDArray[np.float64]

BuildEquation = Callable[[Body, Values], EquationOfMotion]
"""Function that returns the equation of motion of a plant with the effect."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Motion at consecutive ticks, from which the error of an encoder is computed."""

    t: Array
    """(n,) time since the release, s."""
    states: Array
    """(n, 4 + memory) theta1, theta2, omega1, omega2, rad and rad/s, and additional states."""
    noise: Array
    """(n, 3) standard normal numbers, a row for each tick."""


Reading = Callable[[Array, Moment, Values], Array]
"""Function that converts true angles (n, 2) of joints 1 and 2, rad, to encoder readings before noise and rounding."""

Counter = Callable[[NDArray[np.int64], Values], NDArray[np.int64]]
"""Function that converts rounded counts (n, 3) to readings of the counters."""


@dataclass(frozen=True, slots=True)
class Size:
    """Parameter of an out-of-library effect, which is drawn uniformly between two values."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class OutOfLibraryEffect:
    """Out-of-library effect; it has no influence if its `amplitude` is zero."""

    name: str
    meaning: str
    amplitude: Size
    """Parameter for the size of the effect. A draw scales it to the requested gap."""
    most: float = math.inf
    """Maximum meaningful amplitude."""
    sign: Literal["positive", "any"] = "positive"
    shape: tuple[Size, ...] = ()
    motion: BuildEquation | None = None
    reading: Reading | None = None
    counter: Counter | None = None
    dissipative: bool = False
    family: Sequence[Effect] = ()
    """Library effects that are correct answers; empty if there are none."""
    held_back: bool = False
    """Whether the effect is excluded from all tuning on trials."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters; the amplitude is the first."""
        return (self.amplitude.name, *(size.name for size in self.shape))

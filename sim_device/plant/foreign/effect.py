"""Interface of an out-of-library effect: the library does not contain it, at least not in this form."""

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
"""The equation of motion of a plant with the effect."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The swing at consecutive ticks, as input of a disturbed encoder."""

    t: Array
    """(n,) time since the release, s."""
    states: Array
    """(n, 4 + memory) theta1, theta2, omega1, omega2, rad and rad/s, and additional states."""
    noise: Array
    """(n, 3) standard normal numbers, a row for each tick."""


Reading = Callable[[Array, Moment, Values], Array]
"""True angles (n, 2) of joint encoders 1 and 2, rad -> their readings before noise and rounding."""

Counter = Callable[[NDArray[np.int64], Values], NDArray[np.int64]]
"""Rounded counts (n, 3) -> readings of the counters."""


@dataclass(frozen=True, slots=True)
class Size:
    """One parameter of an out-of-library effect: drawn uniformly between two values."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class OutOfLibraryEffect:
    """One out-of-library effect; its `amplitude` at zero switches it off exactly."""

    name: str
    meaning: str
    amplitude: Size
    """Its size; a draw scales it to the requested gap."""
    most: float = math.inf
    """Maximum meaningful amplitude."""
    sign: Literal["positive", "any"] = "positive"
    shape: tuple[Size, ...] = ()
    motion: BuildEquation | None = None
    reading: Reading | None = None
    counter: Counter | None = None
    dissipative: bool = False
    family: Sequence[Effect] = ()
    """Library effects that would be a correct answer; empty without any."""
    held_back: bool = False
    """Whether it is excluded from all tuning on trials."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, the amplitude first."""
        return (self.amplitude.name, *(size.name for size in self.shape))

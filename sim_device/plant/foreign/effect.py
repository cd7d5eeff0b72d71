"""What an out-of-library effect is: something the lab's library does not hold, or not in this form."""

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
    """The swing at consecutive ticks, as a disturbed encoder meets it."""

    t: Array
    """(n,) time since the release, s."""
    states: Array
    """(n, 4 + memory) theta1, theta2, omega1, omega2, rad and rad/s, and the motion's memory."""
    noise: Array
    """(n, 3) unit normal numbers that belong to the ticks."""


Reading = Callable[[Array, Moment, Values], Array]
"""Angles (n, 2) that joint encoders 1 and 2 should read, rad -> what they do read, before noise and rounding."""

Counter = Callable[[NDArray[np.int64], Values], NDArray[np.int64]]
"""Rounded counts (n, 3) -> what the counters say."""


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
    """How big it is; a draw scales it until the gap has the size wanted."""
    most: float = math.inf
    """Largest amplitude that still makes sense."""
    sign: Literal["positive", "any"] = "positive"
    shape: tuple[Size, ...] = ()
    motion: BuildEquation | None = None
    reading: Reading | None = None
    counter: Counter | None = None
    dissipative: bool = False
    family: Sequence[Effect] = ()
    """Library effects that would be a right answer; empty when there is none."""
    held_back: bool = False
    """Kept out of everything that is tuned on trials."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, the amplitude first."""
        return (self.amplitude.name, *(size.name for size in self.shape))

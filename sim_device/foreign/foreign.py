"""What a foreign effect is: something the lab's library does not hold, or not in this form."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim_device.foreign.engine import Body, Motion

Values = Mapping[str, float]
Array = NDArray[np.float64]

BuildMotion = Callable[[Body, Values], Motion]
"""The equation of motion of a plant with the effect."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The swing at consecutive ticks, as a disturbed encoder meets it."""

    t: Array
    """(n,) time since the release, s."""
    states: Array
    """(n, 4 + memory) theta1, theta2, omega1, omega2, rad and rad/s, and the motion's memory."""
    chance: Array
    """(n, 3) unit normal numbers that belong to the ticks."""


Reading = Callable[[Array, Moment, Values], Array]
"""Angles (n, 2) that joint encoders 1 and 2 should read, rad -> what they do read, before noise and rounding."""

Counter = Callable[[NDArray[np.int64], Values], NDArray[np.int64]]
"""Rounded counts (n, 3) -> what the counters say."""


@dataclass(frozen=True, slots=True)
class Size:
    """One parameter of a foreign effect: drawn uniformly between two values."""

    name: str
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class Foreign:
    """One foreign effect; its `amplitude` at zero switches it off exactly."""

    name: str
    meaning: str
    amplitude: Size
    """How big it is; a draw scales it until the gap has the size wanted."""
    most: float = math.inf
    """Largest amplitude that still makes sense."""
    sign: Literal["positive", "any"] = "positive"
    shape: tuple[Size, ...] = ()
    motion: BuildMotion | None = None
    reading: Reading | None = None
    counter: Counter | None = None
    dissipative: bool = False
    family: tuple[str, ...] = ()
    """Library effects that would be a right answer; empty when there is none."""
    held_back: bool = False
    """Kept out of everything that is tuned on trials."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, the amplitude first."""
        return (self.amplitude.name, *(size.name for size in self.shape))

"""Where randomness enters the simulated device: one seed, separate streams, no state."""

from enum import IntEnum

import numpy as np


class RandomStream(IntEnum):
    """What a random number is for; streams never share numbers."""

    IDLE = 0
    REST = 1
    SWING = 2
    OPERATOR = 3
    TRUTH = 4
    FAULTS = 5
    DRAW = 6
    RIG = 7
    FOREIGN = 8
    SAMPLING = 9
    KIND = 10
    DRIVES = 11


def generator(seed: int, stream: RandomStream, *numbers: int) -> np.random.Generator:
    """The random generator of one purpose, the same every time for the same arguments."""
    return np.random.default_rng([seed, stream, *numbers])

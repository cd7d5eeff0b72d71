"""Create the random generators of the simulated device: from one seed, with a separate stream for each purpose."""

from enum import IntEnum

import numpy as np


class RandomStream(IntEnum):
    """Purpose of random numbers; different streams are independent."""

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
    """Return the random generator for one purpose; identical arguments give identical generators."""
    return np.random.default_rng([seed, stream, *numbers])

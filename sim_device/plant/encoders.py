"""Convert true angles to noisy integer counts."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import JOINTS, Rig
from sim_device.random_streams import RandomStream, generator

BLOCK = 1024
"""Number of ticks for which noise is drawn at a time."""


@dataclass(frozen=True, slots=True)
class NoisyEncoders:
    """Three multi-turn encoders with Gaussian noise.

        counts = s round((rig.positions(theta) + noise_counts * n) / s),    n ~ N(0, 1),    s = step_counts

    The noise depends only on seed, stream, release and tick. The same seed therefore gives the same counts over any
    link and in batches of any size.
    """

    rig: Rig
    noise_counts: float | tuple[float, float, float]
    seed: int
    step_counts: int = 1

    def read(self, theta: NDArray[np.float64], stream: RandomStream, release: int, first: int) -> NDArray[np.int64]:
        """Return the counts at consecutive ticks.

        Args:
            theta: (n, 3) true absolute angles, rad
            stream: stream of random numbers: `IDLE`, `REST` or `SWING`
            release: number of the release, from 1
            first: tick of the first row, counted from the start of the stream

        Returns:
            (n, 3) multi-turn counts
        """
        noise = np.asarray(self.noise_counts) * standard_noise(self.seed, stream, release, first, len(theta))
        return self.step_counts * np.rint((self.rig.positions(theta) + noise) / self.step_counts).astype(np.int64)


def standard_noise(seed: int, stream: RandomStream, release: int, first: int, count: int) -> NDArray[np.float64]:
    """Return the standard normal noise (count, 3) for the ticks `first`, `first + 1`, ..."""
    start, stop = first // BLOCK, (first + max(count, 1) - 1) // BLOCK
    blocks = [_noise_block(seed, stream, release, number) for number in range(start, stop + 1)]
    joined = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    return joined[first - start * BLOCK :][:count]


@lru_cache(maxsize=16)
def _noise_block(seed: int, stream: RandomStream, release: int, number: int) -> NDArray[np.float64]:
    return generator(seed, stream, release, number).standard_normal((BLOCK, JOINTS))

"""The plant: the hidden truth that the encoders look at."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import Arm
from dpr_lab.dynamics.base import RATIOS, base_parameters, loaded, ratios
from dpr_lab.dynamics.simulate import simulate_arm
from dpr_lab.effects import effect_vector
from dpr_lab.errors import ConfigError
from dpr_lab.rig import JOINTS, Rig
from sim_device.config import PlantConfig

MAX_STEP = 1e-4
"""Longest step of the truth, s: its error stays far below a count for as long as a chaotic swing can be compared."""

BLOCK_TIME = 1.0
"""How much of a swing is computed at a time, s."""

Theta = NDArray[np.float64]


class Plant:
    """The rig's true dynamics and effects.

    Args:
        config: the plant file
        rig: gives the lengths, gravity and any added mass, which are measured and so true

    Raises:
        ConfigError: the plant file names an effect or a parameter of one that there is not.
    """

    def __init__(self, config: PlantConfig, rig: Rig) -> None:
        self.config = config
        self._frame = (rig.rig.L0, rig.rig.L1, rig.rig.g)
        self._Z = config.Z if rig.added_mass is None else loaded(config.Z, rig.added_mass)
        self._arm = Arm(config.arm.J0, config.arm.c0, config.arm.k0, config.arm.mode)
        try:
            self._effects = effect_vector(config.effects)
        except ValueError as error:
            raise ConfigError(f"plant {config.name}: effects: {error}") from error

    def swing(self, theta: Theta, omega: Theta, t: Theta) -> NDArray[np.float64]:
        """(n, 6) angles and speeds at the instants `t` (n,) of a swing that is at theta, omega (3,) at t[0]."""
        start = np.concatenate([theta, omega])
        return simulate_arm(self._Z, self._frame, self._arm, start, t, MAX_STEP, self._effects)

    def reveal(self) -> dict[str, dict[str, object]]:
        """The truth, to be opened once an identification is finished."""
        _, L1, g = self._frame
        true_ratios = ratios(base_parameters(self.config.Z, L1, g))
        return {
            "parameters": dict(self.config.parameters),
            "ratios": dict(zip(RATIOS, true_ratios.tolist(), strict=True)),
            "effects": {name: dict(values) for name, values in self.config.effects.items()},
            "arm": self.config.arm.model_dump(),
        }


class Swing:
    """One release, computed a block ahead of whoever reads it.

    Blocks start from the state the last one ended in, so the same release has the same bits however it is read.
    """

    def __init__(self, plant: Plant, theta: Theta, omega: Theta, rate_hz: float) -> None:
        self._blocks = _blocks(plant, theta, omega, rate_hz)
        self.first = 0
        """Earliest tick that can still be read."""
        self._theta = next(self._blocks)

    def theta(self, first: int, count: int) -> Theta:
        """(count, 3) angles at the ticks `first`, `first` + 1, ... since the release, rad.

        Raises:
            ValueError: `first` lies before what was read last; a swing is read forwards.
        """
        if first < self.first:
            raise ValueError(f"the swing was read up to tick {self.first}, not back to {first}")
        while self.first + len(self._theta) < first + count:
            self._theta = np.concatenate([self._theta, next(self._blocks)])
            passed = min(first - self.first, len(self._theta))
            self.first, self._theta = self.first + passed, self._theta[passed:]
        return self._theta[first - self.first :][:count]


def _blocks(plant: Plant, theta: Theta, omega: Theta, rate_hz: float) -> Iterator[Theta]:
    ticks = max(1, round(BLOCK_TIME * rate_hz))
    t = np.arange(ticks + 1) / rate_hz
    while True:
        states = plant.swing(theta, omega, t)
        yield states[:-1, :JOINTS]
        theta, omega = states[-1, :JOINTS], states[-1, JOINTS:]

"""Plant with an out-of-library effect: motion of its rods and readings of its encoders."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import loaded
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.encoders import standard_noise
from sim_device.plant.foreign import FOREIGN
from sim_device.plant.foreign.effect import Array, Moment, OutOfLibraryEffect
from sim_device.plant.foreign.engine import Body, integrate, undisturbed
from sim_device.plant.plant import BLOCK_TIME, Driven, Plant
from sim_device.random_streams import RandomStream


class ForeignPlant:
    """Rods with one out-of-library effect, on a clamped arm and without library effects.

    Args:
        config: the plant file
        rig: the rig file, whose lengths, gravity and added mass are true, because they are measured

    Raises:
        ConfigError: the plant file names an unknown effect or parameter, or effects that the plant cannot combine.
    """

    def __init__(self, config: PlantConfig, rig: Rig) -> None:
        self.config = config
        self.effect, self.values = _foreign(config)
        self._rods = Plant(config.model_copy(update={"foreign": {}}), rig)
        Z = config.Z if rig.added_mass is None else loaded(config.Z, rig.added_mass)
        known = rig_constants(rig)
        body = Body.of(Z, known.L1, known.L2, known.g)
        self.motion = undisturbed(body) if self.effect.motion is None else self.effect.motion(body, self.values)
        self._relative = bool(known.relative2)

    def refuse_drives(self) -> None:
        """Refuse joint drives, which a plant with an out-of-library effect cannot have.

        Raises:
            ConfigError: always.
        """
        raise ConfigError(f"plant {self.config.name}: with an out-of-library effect it has no joint drives")

    def let_go(
        self, theta: Array, omega: Array, rate_hz: float, release: int, driven: Driven | None = None
    ) -> "ForeignSwing":
        """Release the rods with the angles theta and speeds omega (3,); the swing is read at `rate_hz`."""
        start = np.array([*theta[1:], *omega[1:], *self.motion.memory])
        return ForeignSwing(self, start, float(theta[0]), rate_hz, release)

    def misread(self, theta: Array, t: Array, run: int) -> Array:
        """Return the angles (n, 3) with encoder errors at rest.

        The angles of a swing already contain these errors.
        """
        if not np.isneginf(t).all():
            return theta
        states = np.zeros((len(theta), 4 + len(self.motion.memory)))
        states[:, :2] = theta[:, 1:]
        return self.as_read(theta, Moment(np.zeros(len(theta)), states, np.zeros((len(theta), 3))))

    def as_read(self, theta: Array, moment: Moment) -> Array:
        """Return the angles (n, 3) as the encoders read them."""
        if self.effect.reading is None:
            return theta
        joints = theta[:, 1:].copy()
        joints[:, 1] -= self._relative * joints[:, 0]
        read = self.effect.reading(joints, moment, self.values)
        return np.column_stack([theta[:, 0], read[:, 0], read[:, 1] + self._relative * read[:, 0]])

    def reveal(self) -> dict[str, dict[str, object]]:
        """Return the true parameters and library effects; the out-of-library effect is not included."""
        return self._rods.reveal()

    def counted(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the readings (n, 3) of the counters, with errors of counting."""
        return counts if self.effect.counter is None else self.effect.counter(counts, self.values)


class ForeignSwing:
    """Swing after one release: readings of the encoders, computed in blocks."""

    def __init__(self, plant: ForeignPlant, start: Array, theta0: float, rate_hz: float, release: int) -> None:
        self._plant, self._theta0, self._rate_hz, self._release = plant, theta0, rate_hz, release
        self._block = max(1, round(BLOCK_TIME * rate_hz))
        self._states = start[None]
        self.first = 0
        """Earliest tick that can still be read."""

    def theta(self, first: int, count: int) -> Array:
        """Return the readings (count, 3) at the ticks `first`, `first` + 1, ... since the release, rad.

        Raises:
            ValueError: `first` is before the last read tick; a swing can only be read forwards.
        """
        states = self.states(first, count)
        t = np.arange(first, first + count) / self._rate_hz
        noise = standard_noise(self._plant.config.seed, RandomStream.FOREIGN, self._release, first, count)
        theta = np.column_stack([np.full(count, self._theta0), states[:, :2]])
        return self._plant.as_read(theta, Moment(t, states, noise))

    def states(self, first: int, count: int) -> Array:
        """Return the true states (count, 4 + memory) at the ticks `first`, `first` + 1, ... since the release."""
        if first < self.first:
            raise ValueError(f"the readings before tick {self.first} are no longer available (requested: {first})")
        while self.first + len(self._states) < first + count:
            last = self.first + len(self._states) - 1
            t = np.arange(last, last + self._block + 1) / self._rate_hz
            ahead = integrate(self._plant.motion, self._states[-1], t)[1:]
            states = self._states[min(first - self.first, len(self._states) - 1) :]
            self.first = last + 1 - len(states)
            self._states = np.concatenate([states, ahead])
        return self._states[first - self.first :][:count]


def _foreign(config: PlantConfig) -> tuple[OutOfLibraryEffect, dict[str, float]]:
    (name, values), *more = config.foreign.items()
    if more or config.effects or config.mount or config.arm.mode != "clamped":
        raise ConfigError(
            f"plant {config.name}: foreign.{name} cannot be combined with another foreign effect, with effects"
            " or a mount, and needs a clamped arm"
        )
    if name not in FOREIGN:
        raise ConfigError(f"plant {config.name}: no foreign effect {name!r}; available: {', '.join(FOREIGN)}")
    effect = FOREIGN[name]
    if set(values) != set(effect.parameters):
        raise ConfigError(f"plant {config.name}: foreign.{name} has the parameters {', '.join(effect.parameters)}")
    return effect, dict(values)

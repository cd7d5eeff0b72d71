"""The drive of the arm: from the release on, the device runs its own program and reports the input.

It is a part of the rig: no message starts, stops or changes it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import ArmQuantity, TorqueKind
from sim_device.plant.config import ArmDriveConfig
from sim_device.plant.encoders import standard_noise
from sim_device.random_streams import RandomStream


@dataclass(frozen=True, slots=True)
class ArmDrive:
    """A motor at the arm, controlled by the board at its ticks; its input is constant from one tick to the next.

    tau0 = gear kt i gain + offset, with i the current, or i = (u - ke gear omega0) / R of a voltage u
    """

    config: ArmDriveConfig
    seed: int

    @property
    def kinds(self) -> tuple[TorqueKind, ...]:
        """Inputs that it reports."""
        return tuple(kind for kind in TorqueKind if kind.name.lower() in self.config.tells)

    @property
    def quantity(self) -> ArmQuantity:
        """Quantity of its input."""
        return ArmQuantity[self.config.input.upper()]

    @property
    def unit(self) -> float:
        """Resolution of its input, N m, A or V."""
        return self.config.unit_micro * 1e-6

    def exerted(self, first: int, count: int, rate_hz: float) -> NDArray[np.float64]:
        """(count, 1) torque of the arm from the ticks `first`, ... since the release on, N m.

        The back-EMF, which acts as friction of the arm, is not included.
        """
        given = self._given(first, count, rate_hz) * self.unit
        return (given * self.config.torque_per_input * self.config.gain + self.config.offset_Nm)[:, None]

    def reported(self, release: int, first: int, count: int, rate_hz: float) -> NDArray[np.int64]:
        """(count, kinds) content of ARM_INPUT at these ticks, in units; `release` is the number of the release."""
        noise = standard_noise(self.seed, RandomStream.DRIVES, release, first, count)[:, 0] * self.config.noise
        given = self._given(first, count, rate_hz) + np.rint(noise / self.unit)
        commanded = np.rint(self._asked(np.arange(first, first + count) / rate_hz) / self.unit)
        by_kind = {TorqueKind.MEASURED: given.astype(np.int64), TorqueKind.COMMANDED: commanded.astype(np.int64)}
        return np.stack([by_kind[kind] for kind in self.kinds], axis=1)

    def _given(self, first: int, count: int, rate_hz: float) -> NDArray[np.float64]:
        """(count,) input that acts, delayed and limited by the driver, in units."""
        asked = self._asked(np.arange(first, first + count) / rate_hz - self.config.delay_s)
        return np.rint(np.clip(asked, -self.config.limit, self.config.limit) / self.unit)

    def _asked(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) input that the program requests at times since the release, s; none before it."""
        low, high = self.config.rates_hz
        if self.config.program == "sines":
            shape = (np.sin(2 * np.pi * low * t) + np.sin(2 * np.pi * high * t)) / 2
        elif self.config.program == "chirp":
            swept = low * t + (high - low) * t**2 / (2 * self.config.sweep_s)
            shape = np.sin(2 * np.pi * np.where(t < self.config.sweep_s, swept, high * t))
        else:
            bits = pseudo_random_bits(9)
            shape = bits[np.floor(np.maximum(t, 0.0) * 2 * high + 1e-9).astype(int) % len(bits)]
        return np.where(t >= 0.0, self.config.amplitude * shape, 0.0)


def pseudo_random_bits(order: int) -> NDArray[np.float64]:
    """(2^order - 1,) maximum-length sequence of -1 and 1, by the polynomial x^9 + x^4 + 1 for order 9."""
    register, bits = [1] * order, []
    for _ in range(2**order - 1):
        bits.append(2.0 * register[-1] - 1.0)
        register = [register[-1] ^ register[3], *register[:-1]]
    return np.array(bits)

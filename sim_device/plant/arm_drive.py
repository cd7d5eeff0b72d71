"""Drive of the arm.

From the release on, the device runs its own program and reports the input. The drive is a part of the rig: no message
starts, stops or changes it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.moving_arm.geared_motor import AnyState
from dpr_lab.dynamics.simulate import as_row, as_state
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import regular
from firmware_protocol.messages import ArmQuantity, TorqueKind
from sim_device.plant.config import ArmDriveConfig, PlantConfig
from sim_device.plant.drives import SLACK_S, read_table
from sim_device.plant.encoders import standard_noise
from sim_device.random_streams import RandomStream

Array = NDArray[np.float64]

Move = Callable[[AnyState, Array, Array], Array]
"""Function of the state at t[0], times t (n,), and torques (n - 1, 1) of the arm, N m; it returns the states (n, 6 +
internal)."""


COLUMN = {"torque": "tau0_Nm", "current": "current_A", "voltage": "voltage_V"}
"""Name of the column of the input, for each kind of input, in tables that `dpr-lab plan` writes."""


@dataclass(frozen=True, slots=True, eq=False)
class InputTable:
    """Table of inputs that the device runs as its program.

    Each input holds until the next row. It is zero before the first row and after the last.
    """

    t: Array
    """(m,) increasing times since the release, s."""
    values: Array
    """(m,) inputs, N m, A or V."""

    def at(self, t: Array) -> Array:
        """Return the inputs at times t (n,) since the release, s."""
        row = np.searchsorted(self.t, t + SLACK_S, side="right")
        last = self.t[-1] + (self.t[-1] - self.t[-2] if len(self.t) > 1 else 0.0)
        return np.where(t + SLACK_S < last, np.append(0.0, self.values)[row], 0.0)


@dataclass(frozen=True, slots=True)
class ArmDrive:
    """Motor of the arm, controlled by the board, with constant input between ticks.

        tau0 = gear kt i,

    where i is the current, or i = (u - ke gear omega0) / R for a voltage u.
    """

    config: ArmDriveConfig
    seed: int
    delay_s: float = 0.0
    """Delay from the input to its effect, s; the board does not report it."""
    table: InputTable | None = None
    """Program that replaces that of the plant file; None: the program of the plant file."""

    @property
    def kinds(self) -> tuple[TorqueKind, ...]:
        """Kinds of inputs that the board reports."""
        return tuple(kind for kind in TorqueKind if kind.name.lower() in self.config.reports)

    @property
    def quantity(self) -> ArmQuantity:
        """Quantity of the input."""
        return ArmQuantity[self.config.input.upper()]

    @property
    def unit(self) -> float:
        """Resolution of the input, N m, A or V."""
        return self.config.unit_micro * 1e-6

    def block(
        self, move: Move, state: AnyState, t: Array, ticks: int, rate_hz: float, asked: Array
    ) -> tuple[Array, Array]:
        """Move the rig over some ticks.

        Args:
            move: function that integrates the motion under torques on the arm, with the back-EMF as friction
            state: state of the rig at t[0]
            t: (n,) times, s, with equally many from each tick to the next
            ticks: number of ticks
            rate_hz: ticks per second of the device
            asked: inputs that the program requested at all earlier ticks since the release, N m, A or V

        Returns:
            (n, 6 + internal) states, and `asked` extended by the inputs of these ticks
        """
        first, looks = len(asked), (len(t) - 1) // ticks
        if self.config.program != "pd" or self.table is not None:
            asked = np.append(asked, self._program(np.arange(first, first + ticks) / rate_hz))
            return move(state, t, np.repeat(self._acting(asked, ticks, rate_hz), looks)[:, None]), asked
        states = [as_row(state)[None]]
        for tick in range(ticks):
            asked = np.append(asked, self._controlled(state, len(asked) / rate_hz))
            torques = np.repeat(self._acting(asked, 1, rate_hz), looks)[:, None]
            part = move(state, t[tick * looks : (tick + 1) * looks + 1], torques)
            state = as_state(part[-1])
            states.append(part[1:])
        return np.concatenate(states), asked

    def reported(self, release: int, first: int, asked: Array) -> NDArray[np.int64]:
        """Return the values (n, kinds) of the message ARM_INPUT, in its units.

        Args:
            release: number of the release
            first: first tick
            asked: (n,) inputs that the program requested from this tick on, N m, A or V
        """
        noise = standard_noise(self.seed, RandomStream.DRIVES, release, first, len(asked))[:, 0] * self.config.noise
        by_kind = {
            TorqueKind.MEASURED: self._given(asked) + np.rint(noise / self.unit),
            TorqueKind.COMMANDED: np.rint(asked / self.unit),
        }
        return np.stack([by_kind[kind].astype(np.int64) for kind in self.kinds], axis=1)

    def logged(self, asked: Array) -> Array:
        """Return the inputs (n,) without noise, of the first kind that the board reports: measured or commanded."""
        return self._given(asked) * self.unit if TorqueKind.MEASURED in self.kinds else asked

    def _given(self, asked: Array) -> Array:
        """Return the inputs, limited by the driver, as multiples of `unit`."""
        return np.rint(np.clip(asked, -self.config.limit, self.config.limit) / self.unit)

    def _acting(self, asked: Array, count: int, rate_hz: float) -> Array:
        """Return the torque (count,) of the delayed input in the last ticks, averaged over each tick, N m."""
        whole, part = divmod(self.delay_s * rate_hz, 1.0)
        given = np.append(np.zeros(int(whole) + 1), self._given(asked[-count - int(whole) - 1 :]))
        late = len(given) - count - int(whole)
        now, before = given[late:][:count], given[late - 1 :][:count]
        return self.config.torque_per_input * self.unit * ((1.0 - part) * now + part * before)

    def _controlled(self, state: AnyState, t: float) -> float:
        """Return the input requested by the controller, which turns the arm towards the angle of the program."""
        return float(self.config.kp * (self._program(t) - state.theta0) - self.config.kd * state.omega0)

    def _program(self, t: Array | float) -> Array:
        """Return the input, or angle of the arm, that the program requests at times since the release, s."""
        t = np.asarray(t, dtype=np.float64)
        if self.table is not None:
            return self.table.at(t)
        low, high = self.config.rates_hz
        if self.config.program == "chirp":
            swept = low * t + (high - low) * t**2 / (2 * self.config.sweep_s)
            shape = np.sin(2 * np.pi * np.where(t < self.config.sweep_s, swept, high * t))
        elif self.config.program == "prbs":
            bits = pseudo_random_bits()
            shape = bits[np.floor(t * 2 * high + 1e-9).astype(int) % len(bits)]
        else:
            shape = (np.sin(2 * np.pi * low * t) + np.sin(2 * np.pi * high * t)) / 2
        return self.config.amplitude * shape


def arm_drive_of(plant: PlantConfig) -> ArmDrive | None:
    """Return the drive of the arm of a plant, with its hidden delay, or None without a drive.

    Raises:
        ConfigError: the delay is negative.
    """
    if plant.arm_drive is None:
        return None
    delay = plant.effects.get(INPUT_DELAY.name, {}).get("delay_s", 0.0)
    if delay < 0.0:
        raise ConfigError(
            f"plant {plant.name}: effects: {INPUT_DELAY.name}.delay_s = {delay:g}: a delay cannot be negative"
        )
    return ArmDrive(plant.arm_drive, plant.seed, delay)


def replaying(drive: ArmDrive, file: str | Path) -> ArmDrive:
    """Return a copy of the drive whose program is a table (CSV): time since the release, s, and input.

    Raises:
        ConfigError: the table does not exist, or is for another input.
    """
    t, values = read_table(regular(Path(file), ConfigError), ("t_s", COLUMN[drive.config.input]))
    return replace(drive, table=InputTable(t, values[:, 0]))


def pseudo_random_bits() -> Array:
    """Return the maximum-length sequence (511,) of -1 and 1 of the polynomial x^9 + x^4 + 1."""
    register, bits = [1] * 9, []
    for _ in range(2**9 - 1):
        bits.append(2.0 * register[-1] - 1.0)
        register = [register[-1] ^ register[3], *register[:-1]]
    return np.array(bits)

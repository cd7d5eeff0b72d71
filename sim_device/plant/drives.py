"""Drives of the joints.

From the release on, they replay a table of torques and report commanded and measured torques. The drives are a part of
the rig, like the arm: no message starts, stops or changes them.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import regular
from firmware_protocol.messages import TorqueKind
from sim_device.plant.config import DriveConfig
from sim_device.plant.encoders import standard_noise
from sim_device.random_streams import RandomStream

FULL_SCALE = 0x7FFF
"""Maximum torque in a message, as a multiple of the unit of the drives."""

COLUMNS = ("t_s", "tau1_Nm", "tau2_Nm")

SLACK_S = 1e-9
"""Maximum time after a tick at which a row of the table still takes effect at this tick, s."""


@dataclass(frozen=True, slots=True, eq=False)
class JointDrives:
    """Drives of both joints, controlled by the board, with constant torques between ticks.

    Before the release and before the first row of the table the torque is zero. After the last row it stays constant.
    """

    t: NDArray[np.float64]
    """(m,) increasing device times since the release, s."""
    joints: NDArray[np.float64]
    """(m, 2) torques of joint 1 on the inner rod and of joint 2 on the outer rod, N m."""
    config: DriveConfig
    seed: int

    @property
    def kinds(self) -> tuple[TorqueKind, ...]:
        """Kinds of torques that the drives report."""
        return tuple(kind for kind in TorqueKind if kind.name.lower() in self.config.reports)

    @property
    def unit(self) -> float:
        """Resolution of the torques, N m."""
        return self.config.unit_uNm * 1e-6

    def exerted(self, first: int, count: int, rate_hz: float) -> NDArray[np.float64]:
        """Return the acting torques (count, 2) at the ticks `first`, `first` + 1, ... since the release, N m."""
        asked = self._asked(first, count, rate_hz, self.config.delay_s) * np.float64(self.unit)
        return asked * np.array(self.config.gain) + np.array(self.config.offset_Nm)

    def reported(self, release: int, first: int, count: int, rate_hz: float) -> NDArray[np.int64]:
        """Return the torques (count, kinds, 2) that TORQUE reports for these ticks, as multiples of `unit`.

        `release` is the number of the release.
        """
        commanded = self._asked(first, count, rate_hz, 0.0)
        noise = standard_noise(self.seed, RandomStream.DRIVES, release, first, count)[:, :2] * self.config.noise_Nm
        given = self._asked(first, count, rate_hz, self.config.delay_s) + np.rint(noise / self.unit)
        by_kind = {TorqueKind.MEASURED: given.astype(np.int64), TorqueKind.COMMANDED: commanded}
        return np.stack([by_kind[kind] for kind in self.kinds], axis=1)

    def _asked(self, first: int, count: int, rate_hz: float, later_s: float) -> NDArray[np.int64]:
        """Return the torques (count, 2) of the table, delayed by `later_s`, at the ticks, as multiples of `unit`."""
        t = np.arange(first, first + count) / rate_hz - later_s
        row = np.searchsorted(self.t, t + SLACK_S, side="right")
        units = np.rint(np.concatenate([np.zeros((1, 2)), self.joints]) / self.unit).astype(np.int64)
        return units[row]


def write_table(drives: JointDrives, file: Path) -> None:
    """Write the table that the drives replay, for `load_drives`."""
    rows = np.column_stack([drives.t, drives.joints]).tolist()
    file.write_text("\n".join([",".join(COLUMNS), *(",".join(map(repr, row)) for row in rows)]) + "\n", "utf-8")


def load_drives(file: str | Path, config: DriveConfig, seed: int) -> JointDrives:
    """Return the drives that replay a table (CSV): time since the release, s, and torques of both joints, N m.

    Raises:
        ConfigError: the table does not exist, is a pipe, or contains a torque that exceeds the range of the plant's
            unit.
    """
    path = regular(Path(file), ConfigError)
    t, joints = read_table(path, COLUMNS)
    most = FULL_SCALE * config.unit_uNm * 1e-6
    if (np.abs(joints) > most).any():
        raise ConfigError(
            f"torques: {path}: {np.abs(joints).max():g} N m is more than a message can contain in units of"
            f" {config.unit_uNm} uN m ({most:g} N m): give the plant's drives a larger unit_uNm"
        )
    return JointDrives(t, joints, config, seed)


def read_table(path: Path, names: Sequence[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the increasing times (m,), and values (m, n) of the other columns, from a table (CSV).

    Raises:
        ConfigError: the table does not exist, or has other columns or numbers that are not finite.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            header, *rows = csv.reader(text)
        named = {name.strip(): column for name, column in zip(header, zip(*rows, strict=True), strict=True)}
        t, *values = (np.array(named[name], dtype=np.float64) for name in names)
    except OSError as error:
        raise ConfigError(f"torques: {path}: cannot be read: {error.strerror}") from error
    except (KeyError, ValueError) as error:
        raise ConfigError(
            f"torques: {path}: needs a line with the names {', '.join(names)}, then one number for each name in every"
            " line"
        ) from error
    columns = np.stack(values, axis=1)
    if not np.isfinite(columns).all() or not np.isfinite(t).all() or (np.diff(t) <= 0).any():
        raise ConfigError(f"torques: {path}: needs finite numbers and increasing times")
    return t, columns

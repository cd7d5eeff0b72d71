r"""Input signals of joint drives: multi-sines and chirps within limits of torque, speed and angle.

A multi-sine is a sum of harmonics of one over its length, with the phases of Schroeder, which keep its peak low:

    tau(t) = A sum over k of cos(2 pi k t / T + phi_k),    phi_k = -pi k (k - 1) / K.

A chirp sweeps its frequency evenly from the lowest to the highest. Each acts on joint 1, on joint 2 or on both. The
amplitude is the largest at which the simulated swing keeps speeds and angles, the torque limit at most.

Source: M. R. Schroeder (1970), Synthesis of low-peak-factor signals and binary sequences with low autocorrelation, IEEE
Trans. Information Theory 16, 85-89.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import ConfigError
from dpr_lab.planning.information import PresentModel, simulated_states
from dpr_lab.planning.limits import DriveLimits, PlanLimits
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.setup import Torques
from dpr_lab.shown import percent

Array = NDArray[np.float64]

COLUMNS = ("t_s", "tau1_Nm", "tau2_Nm")
"""Columns of the file: time since the release, then the torque of each joint, which holds until the next row."""


@dataclass(frozen=True, slots=True)
class SignalSettings:
    """Settings of the input signals."""

    duration_s: float = 10.0
    """Duration of a signal, s."""
    lowest_hz: float = 0.3
    """Lowest frequency."""
    joints: tuple[tuple[float, float], ...] = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
    """Fractions of the torque limits of joint 1 and joint 2."""
    shrink: float = 0.75
    """Factor by which the amplitude is reduced until the swing stays within its limits."""
    least: float = 0.02
    """Fraction of the torque limit below which a signal is discarded."""


SIGNALS = SignalSettings()


def multisine(t: Array, lowest_hz: float, highest_hz: float) -> Array:
    """(n,) a sum of harmonics with a peak of one."""
    length = t[-1] + t[1]
    harmonics = np.arange(max(1, round(lowest_hz * length)), max(2, int(highest_hz * length)) + 1)
    k = np.arange(1, len(harmonics) + 1)
    phases = -np.pi * k * (k - 1) / len(k)
    values = np.cos(2 * np.pi * np.outer(t / length, harmonics) + phases).sum(axis=1)
    return values / np.abs(values).max()


def chirp(t: Array, lowest_hz: float, highest_hz: float) -> Array:
    """(n,) a sine whose frequency rises evenly, with a peak of one."""
    length = t[-1] + t[1]
    return np.sin(2 * np.pi * (lowest_hz * t + 0.5 * (highest_hz - lowest_hz) * t**2 / length))


SHAPES: dict[Literal["multisine", "chirp"], Callable[[Array, float, float], Array]] = {
    "multisine": multisine,
    "chirp": chirp,
}
"""Kind of signal -> its values at given instants, between two frequencies."""


def driven_releases(model: PresentModel, limits: PlanLimits) -> list[CandidateRelease]:
    """Releases from hanging under each signal that keeps the limits; none without drives.

    Raises:
        ConfigError: every signal breaks the limits.
    """
    if limits.drive is None:
        return []
    duration = min(max(SIGNALS.duration_s, limits.recording.shortest_s), limits.recording.longest_s)
    t = np.arange(round(duration * limits.drive.rate_hz)) / limits.drive.rate_hz
    releases = []
    for kind, shape in SHAPES.items():
        values = shape(t, SIGNALS.lowest_hz, min(limits.drive.highest_hz, limits.drive.rate_hz / 4))
        for shares in SIGNALS.joints:
            torque = values[:, None] * np.array(shares) * np.array(limits.drive.torque_Nm)
            release = CandidateRelease(np.pi, np.pi, duration, torques=Torques(t, torque, "commanded"), signal=kind)
            if (kept := _within(release, model, limits.drive)) is not None:
                releases.append(kept)
    if not releases:
        raise ConfigError(
            "drive: no signal stays within speed_rad_s and angle_rad of the limits file, even at"
            f" {percent(SIGNALS.least)} of torque_Nm: raise these limits, or remove [drive]"
        )
    return releases


def _within(release: CandidateRelease, model: PresentModel, limits: DriveLimits) -> CandidateRelease | None:
    """Release with the largest amplitude that stays within the limits of speed and angle; None if there is none."""
    share, torques = 1.0, release.torques
    assert torques is not None
    while share >= SIGNALS.least:
        tried = replace(release, torques=Torques(torques.t, share * torques.joints, torques.kind))
        if _keeps(tried, model, limits):
            return tried
        share *= SIGNALS.shrink
    return None


def _keeps(release: CandidateRelease, model: PresentModel, limits: DriveLimits) -> bool:
    states = simulated_states([release], model)[0]
    angles = np.stack([states[:, 0] - np.pi, states[:, 1] - states[:, 0]], axis=1)
    speeds = np.stack([states[:, 2], states[:, 3] - states[:, 2]], axis=1)
    pairs = ((angles, limits.angle_rad), (speeds, limits.speed_rad_s))
    return all((np.abs(values).max(axis=0) <= np.array(most)).all() for values, most in pairs)


def write_signal(torques: Torques, file: Path) -> None:
    """The input signal as a table (CSV) that a device replays."""
    rows = np.column_stack([torques.t, torques.joints]).tolist()
    lines = [",".join(COLUMNS), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")

r"""Input signals of drives: multi-sines and chirps within given limits.

The limits concern torque, speed and angle. A multi-sine of duration T is a sum of K harmonics of the frequency 1/T.
Schroeder phases keep its peak low:

    tau(t) = A sum over k of cos(2 pi k t / T + phi_k),    phi_k = -pi k (k - 1) / K.

The frequency of a chirp increases linearly from the lowest to the highest frequency. A signal acts on joint 1, on joint
2, on both joints, or on the motor of the arm. The input of this motor is the torque divided by the gain of the drive.
The amplitude is at most the limit of torque or input. It is reduced until the simulated swing respects the limits of
speed and angle.

Source: M. R. Schroeder (1970), Synthesis of low-peak-factor signals and binary sequences with low autocorrelation, IEEE
Trans. Information Theory 16, 85-89.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError
from dpr_lab.identification.moving_arm.setup import drive_gain, rods_measured
from dpr_lab.planning.acting import arm_states
from dpr_lab.planning.information import PresentModel, simulated_states
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.release import ArmState, CandidateRelease
from dpr_lab.rig import Rig
from dpr_lab.setup import Torques
from dpr_lab.shown import percent

COLUMNS = ("t_s", "tau1_Nm", "tau2_Nm")
"""Columns of the file of an input signal: time since the release, and torque of each joint.

Each torque is held until the next row.
"""

INPUTS = {"torque": "tau0_Nm", "current": "current_A", "voltage": "voltage_V"}
"""Column of the arm's motor in the file of an input signal, by the kind of input in `[motor]`."""


@dataclass(frozen=True, slots=True)
class SignalSettings:
    """Settings of the input signals."""

    duration_s: float = 10.0
    """Duration of a signal, s."""
    lowest_hz: float = 0.3
    """Lowest frequency of a signal, Hz."""
    joints: tuple[tuple[float, float], ...] = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
    """Combinations of joint torques, as fractions of the torque limits of joint 1 and joint 2."""
    shrink: float = 0.75
    """Factor by which the amplitude is reduced repeatedly until the swing stays within its limits."""
    least: float = 0.02
    """Smallest amplitude of a signal, as a fraction of the torque limit; a smaller signal is discarded."""


SIGNALS = SignalSettings()


def multisine(t: Array, lowest_hz: float, highest_hz: float) -> Array:
    """Return the (n,) sum of harmonics between two frequencies, with a peak of one."""
    length = t[-1] + t[1]
    last = max(1, int(highest_hz * length))
    harmonics = np.arange(min(max(1, round(lowest_hz * length)), last), last + 1)
    k = np.arange(1, len(harmonics) + 1)
    phases = -np.pi * k * (k - 1) / len(k)
    values = np.cos(2 * np.pi * np.outer(t / length, harmonics) + phases).sum(axis=1)
    return values / np.abs(values).max()


def chirp(t: Array, lowest_hz: float, highest_hz: float) -> Array:
    """Return an (n,) linear chirp of unit amplitude between two frequencies."""
    length = t[-1] + t[1]
    return np.sin(2 * np.pi * (lowest_hz * t + 0.5 * (highest_hz - lowest_hz) * t**2 / length))


SignalKind = Literal["multisine", "chirp"]

SHAPES: dict[SignalKind, Callable[[Array, float, float], Array]] = {
    "multisine": multisine,
    "chirp": chirp,
}
"""Functions that compute the values of each kind of signal, for given instants and a range of frequencies."""


def driven_releases(model: PresentModel, limits: PlanLimits, rig: Rig) -> list[CandidateRelease]:
    """Create a release from hanging for each signal that respects the limits.

    The list is empty if there are no drives.

    Raises:
        ConfigError: no signal of a drive respects its limits.
    """
    of_joints = _kept(_of_joints(limits, rig), model, limits, rig, "drive", "torque_Nm") if limits.drive else []
    of_arm = "driven" in arm_states(rig, limits)
    return [*of_joints, *(_kept(_of_arm(limits, rig), model, limits, rig, "arm", "input") if of_arm else [])]


def _of_joints(limits: PlanLimits, rig: Rig) -> Iterator[CandidateRelease]:
    """Yield releases with signals of the joint drives at the largest torques."""
    drive = limits.drive
    assert drive is not None
    alone = rig.rods.mounting != "both"
    t = _instants(limits, drive.rate_hz)
    for kind, values in _shaped(t, drive.highest_hz):
        for shares in SIGNALS.joints[:1] if alone else SIGNALS.joints:
            torque = values[:, None] * np.array(shares) * np.array(drive.torque_Nm)
            yield _driven(Torques(t, torque, "commanded"), kind, "held", rig)


def _of_arm(limits: PlanLimits, rig: Rig) -> Iterator[CandidateRelease]:
    """Yield releases with signals of the arm's motor at the largest input."""
    gain, largest = drive_gain(rig), limits.arm.input
    assert largest is not None
    t = _instants(limits, limits.arm.rate_hz)
    for kind, values in _shaped(t, limits.arm.highest_hz):
        torque, joints = gain.value * largest * values, np.zeros((len(t), 2))
        scaled = gain.known and not rods_measured(rig)
        yield _driven(Torques(t, joints, "commanded", torque, scaled), kind, "driven", rig)


def _instants(limits: PlanLimits, rate_hz: int) -> Array:
    duration = min(max(SIGNALS.duration_s, limits.recording.shortest_s), limits.recording.longest_s)
    return np.arange(round(duration * rate_hz)) / rate_hz


def _shaped(t: Array, highest_hz: float) -> Iterator[tuple[SignalKind, Array]]:
    """Yield a signal of each kind, up to a quarter of the sampling rate."""
    highest_hz = min(highest_hz, 0.25 / t[1])
    for kind, shape in SHAPES.items():
        yield kind, shape(t, min(SIGNALS.lowest_hz, highest_hz), highest_hz)


def _driven(torques: Torques, kind: SignalKind, arm: ArmState, rig: Rig) -> CandidateRelease:
    """Create a driven release from hanging; the current mounting is kept."""
    duration = len(torques.t) * float(torques.t[1])
    return CandidateRelease(np.pi, np.pi, duration, rig.rods.mounting, rig.added_mass, torques, kind, arm)


def _kept(
    signals: Iterable[CandidateRelease], model: PresentModel, limits: PlanLimits, rig: Rig, table: str, size: str
) -> list[CandidateRelease]:
    """Return releases whose amplitudes are reduced to the limits of speed and angle.

    Raises:
        ConfigError: no amplitude respects the limits; the message names the table and the key of the limit.
    """
    within_limits = [driven for signal in signals if (driven := _within(signal, model, limits, rig)) is not None]
    if not within_limits:
        which = size if table == "arm" else "[drive]"
        raise ConfigError(
            f"{table}: no signal stays within speed_rad_s and angle_rad of the limits file, even at"
            f" {percent(SIGNALS.least)} of {size}: raise these limits, or remove {which}"
        )
    return within_limits


def _within(release: CandidateRelease, model: PresentModel, limits: PlanLimits, rig: Rig) -> CandidateRelease | None:
    """Return the release with the largest amplitude within the limits of speed and angle.

    The result is None if no amplitude is within the limits.
    """
    share, torques = 1.0, release.torques
    assert torques is not None
    while share >= SIGNALS.least:
        on_arm = None if torques.on_arm is None else share * torques.on_arm
        tried = replace(release, torques=replace(torques, joints=share * torques.joints, on_arm=on_arm))
        if _keeps(tried, model, limits, rig):
            return tried
        share *= SIGNALS.shrink
    return None


def _keeps(release: CandidateRelease, model: PresentModel, limits: PlanLimits, rig: Rig) -> bool:
    states, bend = simulated_states([release], model)[0], float(not release.setup.alone)
    if release.arm == "driven":
        low, high = rig.arm.limits or (-np.inf, np.inf)
        angle, speed = states[:, 4], np.abs(states[:, 5])
        most = limits.arm.angle_rad
        return bool(
            speed.max() <= limits.arm.speed_rad_s and max(low, -most) <= angle.min() and angle.max() <= min(high, most)
        )
    drive = limits.drive
    assert drive is not None
    angles = np.stack([states[:, 0] - np.pi, bend * (states[:, 1] - states[:, 0])], axis=1)
    speeds = np.stack([states[:, 2], bend * (states[:, 3] - states[:, 2])], axis=1)
    pairs = ((angles, drive.angle_rad), (speeds, drive.speed_rad_s))
    return all((np.abs(values).max(axis=0) <= np.array(most)).all() for values, most in pairs)


def arm_input(torques: Torques, rig: Rig) -> Array:
    """Return the (n,) input of the arm's motor that produces the torques of a signal.

    The unit of the input is that of `[motor]`.
    """
    assert torques.on_arm is not None
    return np.asarray(torques.on_arm / drive_gain(rig).value, dtype=np.float64)


def write_signal(torques: Torques, file: Path, rig: Rig) -> None:
    """Write an input signal as a table (CSV) that a device replays.

    The table contains the torques of both joints, or the input of the arm's motor.

    Args:
        torques: the signal
        file: path of the table
        rig: the rig, whose `[motor]` defines the input of the arm's motor
    """
    columns, values = COLUMNS, torques.joints
    if torques.on_arm is not None:
        assert rig.motor is not None
        columns, values = ("t_s", INPUTS[rig.motor.input]), arm_input(torques, rig)
    rows = np.column_stack([torques.t, values]).tolist()
    lines = [",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")

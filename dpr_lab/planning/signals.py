r"""Input signals of drives: multi-sines and chirps within given limits.

The limits concern torque, speed and angle. A multi-sine of duration T is a sum of K harmonics of the frequency 1/T.
With the phases of Schroeder, its peak is low:

    tau(t) = A sum over k of cos(2 pi k t / T + phi_k),    phi_k = -pi k (k - 1) / K.

The frequency of a chirp increases linearly from the lowest to the highest frequency. A signal acts on joint 1, on joint
2, on both joints, or on the motor of the arm. The input of this motor is the torque divided by the gain of the drive.
The amplitude is at most the limit of torque or input, and is reduced until the simulated swing respects the limits of
speed and angle.

Source: M. R. Schroeder (1970), Synthesis of low-peak-factor signals and binary sequences with low autocorrelation, IEEE
Trans. Information Theory 16, 85-89.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import ConfigError
from dpr_lab.identification.moving_arm.setup import drive_gain, rods_measured
from dpr_lab.planning.information import PresentModel, joint_motion
from dpr_lab.planning.limits import ArmPlan, DriveLimits, PlanLimits, SignalLimits
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
"""Function of each kind of signal, which returns its values at given instants for a lowest and a highest frequency."""


def driven_releases(model: PresentModel, limits: PlanLimits, rig: Rig) -> list[CandidateRelease]:
    """Create a release from hanging for each signal that respects the limits.

    The list is empty if there are no drives.

    Raises:
        ConfigError: no signal of a drive respects its limits; the message names the table and the key of the limit.
    """
    drives = list[tuple[str, DriveLimits | ArmPlan, Iterator[CandidateRelease]]]()
    if limits.drive is not None:
        drives.append(("torque_Nm", limits.drive, _of_joints(limits, limits.drive, rig)))
    if "driven" in limits.arm_states(rig):
        drives.append(("input", limits.arm, _of_arm(limits, rig)))
    releases = list[CandidateRelease]()
    for size, drive, signals in drives:
        within_limits = [driven for signal in signals if (driven := _within(signal, model, drive, rig)) is not None]
        if not within_limits:
            table, which = ("arm", size) if drive is limits.arm else ("drive", "[drive]")
            raise ConfigError(
                f"{table}: no signal stays within speed_rad_s and angle_rad of the limits file, even at"
                f" {percent(SIGNALS.least)} of {size}: raise these limits, or remove {which}"
            )
        releases += within_limits
    return releases


def _of_joints(limits: PlanLimits, drive: DriveLimits, rig: Rig) -> Iterator[CandidateRelease]:
    """Yield releases with signals of the joint drives whose peaks are the largest torques."""
    combinations = SIGNALS.joints if rig.rods.mounting == "both" else SIGNALS.joints[:1]
    for kind, t, values in _shaped(limits, drive):
        for shares in combinations:
            torque = values[:, None] * np.array(shares) * np.array(drive.torque_Nm)
            yield _driven(Torques(t, torque, "commanded"), kind, "held", rig)


def _of_arm(limits: PlanLimits, rig: Rig) -> Iterator[CandidateRelease]:
    """Yield releases with signals of the arm's motor whose peak is the largest input."""
    gain, largest = drive_gain(rig), limits.arm.input
    assert largest is not None
    scaled = gain.known and not rods_measured(rig)
    for kind, t, values in _shaped(limits, limits.arm):
        torque = gain.value * largest * values
        yield _driven(Torques(t, np.zeros((len(t), 2)), "commanded", torque, scaled), kind, "driven", rig)


def _shaped(limits: PlanLimits, drive: SignalLimits) -> Iterator[tuple[SignalKind, Array, Array]]:
    """Yield the kind, the sampling times (s) and the values of each signal, scaled to a peak of 1.

    The highest frequency is at most a quarter of the sampling rate.
    """
    duration = min(max(SIGNALS.duration_s, limits.recording.shortest_s), limits.recording.longest_s)
    t = np.arange(round(duration * drive.rate_hz)) / drive.rate_hz
    highest_hz = min(drive.highest_hz, 0.25 / t[1])
    for kind, shape in SHAPES.items():
        yield kind, t, shape(t, min(SIGNALS.lowest_hz, highest_hz), highest_hz)


def _driven(torques: Torques, kind: SignalKind, arm: ArmState, rig: Rig) -> CandidateRelease:
    """Return a driven release from hanging with the current mounting."""
    duration = len(torques.t) * float(torques.t[1])
    return CandidateRelease(np.pi, np.pi, duration, rig.rods.mounting, rig.added_mass, torques, kind, arm)


def _within(
    release: CandidateRelease, model: PresentModel, drive: DriveLimits | ArmPlan, rig: Rig
) -> CandidateRelease | None:
    """Return the release with the largest amplitude within the limits of speed and angle.

    The result is None if no amplitude is within the limits.
    """
    share, torques, of_arm = 1.0, release.torques, release.arm == "driven"
    assert torques is not None
    moved, initial = ([0], 0.0) if of_arm else ([1, 2], np.array([[np.pi, 0.0], [0.0, 0.0]]))
    low, high = (of_arm and rig.arm.limits) or (-np.inf, np.inf)
    while share >= SIGNALS.least:
        on_arm = None if torques.on_arm is None else share * torques.on_arm
        candidate = replace(release, torques=replace(torques, joints=share * torques.joints, on_arm=on_arm))
        angles, speeds = np.split(joint_motion(candidate, model)[:, :, moved] - initial, 2, axis=1)
        inside = (np.abs(angles) <= drive.angle_rad) & (low <= angles) & (angles <= high)
        if (inside & (np.abs(speeds) <= drive.speed_rad_s)).all():
            return candidate
        share *= SIGNALS.shrink
    return None


def arm_input(torques: Torques, rig: Rig) -> Array:
    """Return the (n,) input of the arm's motor that produces the torque of a signal, in the unit of `[motor]`."""
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
    rows = np.column_stack([torques.t, values])
    np.savetxt(file, rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")

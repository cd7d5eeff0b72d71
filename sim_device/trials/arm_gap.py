"""Compute the gap of a plant whose arm is free or driven: residual of a model without effects.

`sim_device.trials.gap_size` computes it for a clamped arm.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.prediction import predict_batch
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.effects import effect_params, param_index
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup, Torques
from sim_device.plant.arm_drive import arm_drive_of
from sim_device.plant.config import PlantConfig
from sim_device.plant.plant import Plant
from sim_device.trials.gap_size import MEASURE, eliminated, reading_noise

Array = NDArray[np.float64]

ARM = [param_index(FREE_ARM.name, parameter.name) for parameter in FREE_ARM.amplitudes]
"""Indices of the arm's inertia and friction in the parameters."""

STEP = 1e-6
"""Step of the difference quotients: relative for parameters, in rad and rad/s for initial states."""

DURATION_S = 5.0
"""Duration of each release, s."""

SHARES = (0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0, 1.0, 1.0, 1.0)
"""Share of each segment, from its start, that each iteration of Gauss-Newton fits.

The share increases, because the initial estimates of the states are poor if the torque has steps.
"""

SHORTENED = (1.0, 0.3, 0.1, 0.0)
"""Tried factors on the step of an initial state. The best factor of each segment is used."""


@dataclass(frozen=True, slots=True)
class ArmRelease:
    """Release of a plant without noise."""

    readings: Array
    """(n, 3) readings, rad: theta1, joint 2 as read by its encoder, and theta0."""
    torque: Array | None
    """(n,) logged torque on the arm, N m; None without a drive."""


def arm_gap(config: PlantConfig, rig: Rig) -> float:
    """Return the rms residual of noiseless readings after the best fit without effects, in units of the noise."""
    releases = [noiseless_arm(config, rig, number) for number in range(1, len(rig.poses) + 1)]
    if not all(np.isfinite(release.readings).all() for release in releases):
        return float("inf")
    length = round(MEASURE.window * MEASURE.rate_hz)
    laid_out, wanted = _laid_out(releases, rig, length)
    base = whole_parameters(config.Z, rig.L1, rig.g)
    masses = config.Z[2:5] if rig.rods.mounting == "both" else config.Z[[2, 4]]
    back_emf = 0.0 if config.arm_drive is None else config.arm_drive.back_emf
    arm = [config.arm.J0 + float(masses.sum()) * rig.L0**2, config.arm.c0 + back_emf]
    values, starts = np.array([*base, *arm]), np.array([_start(piece, rig) for piece in wanted])
    sigma, rods, left = (
        reading_noise(config, rig),
        _moving(rig, scaled=config.arm_drive is not None),
        np.array([np.inf]),
    )
    for share in SHARES:
        free = rods.parameters if share == 1.0 else []
        part = np.s_[:, : round(share * length), rods.axes]
        expected, slopes = _linearised(values, starts, laid_out, rig_constants(rig), (free, rods.states))
        if not (np.isfinite(expected).all() and np.isfinite(slopes).all()):
            return float("inf")
        remaining = ((wanted - expected.reshape(wanted.shape)) / sigma)[part].reshape(len(wanted), -1)
        columns = (slopes.reshape(*wanted.shape, -1) / sigma[:, None])[part].reshape(*remaining.shape, -1)
        shift, start_shifts, left = eliminated(remaining, columns, len(free), rcond=1e-6)
        values[free] *= 1.0 + shift
        step = np.zeros_like(starts)
        step[:, rods.states] = start_shifts
        if 1 not in rods.states:
            step[:, 1] = starts[:, 0] + step[:, 0] - starts[:, 1]  # for a single rod, theta2 = theta1
        tried = starts + np.array(SHORTENED)[:, None, None] * step
        read = _read(np.tile(values, (len(tried), 1)), tried, laid_out, rig_constants(rig))
        off = np.square((wanted - read.reshape(-1, *wanted.shape)) / sigma)[(np.s_[:], *part)].sum(axis=(2, 3))
        best = np.argmin(np.where(np.isfinite(off), off, np.inf), axis=0)
        starts = tried[best, np.arange(len(starts))]
    return float(np.sqrt(np.mean(left**2)))


def noiseless_arm(config: PlantConfig, rig: Rig, number: int) -> ArmRelease:
    """Simulate a release from a pose of the rig file, counted from 1, without noise and rounding."""
    plant, pose, drive = Plant(config, rig), list(rig.poses.values())[number - 1], arm_drive_of(config)
    ticks = np.arange(round(DURATION_S * MEASURE.rate_hz))
    driven = None if drive is None else partial(drive.block, rate_hz=MEASURE.rate_hz)
    swing = plant.let_go(pose.theta, np.zeros(3), MEASURE.rate_hz, number, driven)
    asked = swing.asked(0, len(ticks))
    theta = plant.misread(swing.theta(0, len(ticks)), ticks / MEASURE.rate_hz, number - 1)
    readings = np.column_stack([theta[:, 1], plant.joint2(theta[:, 1], theta[:, 2]), theta[:, 0]])
    if drive is None:
        return ArmRelease(readings, None)
    return ArmRelease(readings, drive.logged(asked) * drive.config.torque_per_input)


@dataclass(frozen=True, slots=True)
class MovingParts:
    """Indices of the quantities on which the readings of the mounted rods depend."""

    parameters: list[int]
    """Indices into a, b, d, e1, c1, c2, p, inertia of the arm and friction of the arm."""
    states: list[int]
    """Indices into theta1, theta2, omega1, omega2, theta0, omega0."""
    axes: list[int]
    """Indices into theta1, angle of joint 2, theta0."""


def _moving(rig: Rig, *, scaled: bool) -> MovingParts:
    """Return the indices of the fitted quantities.

    Without a known torque only ratios to the first inertia are fitted.
    """
    first = [0] if scaled else []
    if rig.rods.mounting == "both":
        return MovingParts([*first, 1, 2, 3, 4, 5, 7, 8], [0, 1, 2, 3, 4, 5], [0, 1, 2])
    return MovingParts([*first, 3, 4, 7, 8], [0, 2, 4, 5], [0, 2])


def _laid_out(releases: list[ArmRelease], rig: Rig, length: int) -> tuple[Segments, Array]:
    """Divide all releases into segments, and return these and their readings (segments, length, 3)."""
    setups, times, runs, wanted = [], [], [], []
    for run, release in enumerate(releases):
        t = np.arange(len(release.readings)) / MEASURE.rate_hz
        torques = None if release.torque is None else Torques(t, np.zeros((len(t), 2)), on_arm=release.torque)
        setups.append(Setup(rig.rods.mounting, torques=torques, arm_moves=True))
        # without the first segment, which would start at the release and not at its first reading
        for k in range(length, len(t) - length + 1, length):
            times.append(t[k : k + length])
            runs.append(run)
            wanted.append(release.readings[k : k + length])
    return segments(times, runs, setups, step=MEASURE.step), np.array(wanted)


def _start(piece: Array, rig: Rig) -> Array:
    """Return the approximate state (6,) at the first reading of a piece."""
    theta = piece[:3].copy()
    if rig.encoders.joint2 == "relative":
        theta[:, 1] += theta[:, 0]
    if rig.rods.mounting != "both":
        theta[:, 1] = theta[:, 0]
    omega = (-3 * theta[0] + 4 * theta[1] - theta[2]) * MEASURE.rate_hz / 2
    return np.array([theta[0, 0], theta[0, 1], omega[0], omega[1], theta[0, 2], omega[2]])


def _linearised(
    values: Array, starts: Array, laid_out: Segments, constants: RigConstants, moving: tuple[list[int], list[int]]
) -> tuple[Array, Array]:
    """Compute readings (N, 3) and their derivatives (N, 3, k).

    The derivatives are with respect to the logarithm of the parameters and to the initial states of each segment;
    `moving` contains the indices of both.
    """
    parameters, states = moving
    count = 1 + len(parameters) + len(states)
    candidates, initial = np.tile(values, (count, 1)), np.tile(starts, (count, 1, 1))
    for row, place in enumerate(parameters, 1):
        candidates[row, place] *= 1.0 + STEP
    for row, place in enumerate(states, 1 + len(parameters)):
        initial[row, :, place] += STEP
        if place == 0 and 1 not in states:
            initial[row, :, 1] += STEP
    read = _read(candidates, initial, laid_out, constants)
    return read[0], np.moveaxis(read[1:] - read[0], 0, -1) / STEP


def _read(candidates: Array, initial: Array, laid_out: Segments, constants: RigConstants) -> Array:
    """Return the readings (n, N, 3) of candidates (n, 9) from the initial states (n, segments, 6)."""
    params = np.tile(effect_params({}), (len(candidates), 1))
    params[:, ARM] = candidates[:, 7:]
    return predict_batch(candidates[:, :7], params, constants, laid_out, initial, arm=True)

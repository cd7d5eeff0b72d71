"""Preprocess runs: estimate the noise of the readings and the state at every sample."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.estimation.noise import NoiseFloor, noise_floor
from dpr_lab.estimation.usable_runs import refuse_moving_arms
from dpr_lab.estimation.velocity import smooth
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class PreprocessedRun:
    """A run from its release on, with noise and states."""

    run: Run
    noise: NoiseFloor
    states: Array
    """(n, 4) smoothed theta1, theta2, omega1, omega2 at each sample, rad and rad/s."""


def preprocess(run: Run, rig: Rig, every: int = 1) -> PreprocessedRun:
    """Estimate the noise and the velocities of a run.

    A Kalman filter and an RTS smoother estimate the velocities.

    Args:
        run: the recording
        rig: the recorded rig
        every: decimation factor of the samples; the noise is estimated from all samples

    Raises:
        RunError: the run has too few samples or no motion, or its arm was free or driven.
    """
    refuse_moving_arms([run])
    refuse_without_motion(run, rig)
    noise = noise_floor(run, rig)
    thinned = run.swing if every == 1 else _thinned(run.swing, every)
    return PreprocessedRun(thinned, noise, smooth(thinned, noise))


def rms_noise(noises: Iterable[NoiseFloor]) -> Array:
    """Return the rms noise (2,) of a single reading of theta1 and theta2 over runs, rad."""
    return np.sqrt(np.mean([np.diag(noise.covariance) for noise in noises], axis=0))


def _thinned(swing: Run, every: int) -> Run:
    """Return a swing that contains only every n-th sample, where n is `every`.

    A torque that is constant between samples is averaged over all samples up to the next remaining one, so that its
    impulse is conserved.
    """
    mask = np.arange(len(swing.t)) % every == 0
    thinned, first = swing.only(mask), np.flatnonzero(mask)
    if swing.torques is None or swing.continuous:
        return thinned
    held_s = np.diff(swing.t, append=2 * swing.t[-1:] - swing.t[-2:-1])
    impulses = np.add.reduceat(swing.torques * held_s[:, None], first)
    return replace(thinned, torques=impulses / np.add.reduceat(held_s, first)[:, None])

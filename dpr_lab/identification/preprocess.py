"""Preprocessing of runs: noise, and the state at every sample."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.estimation.noise import NoiseFloor, noise_floor
from dpr_lab.estimation.velocity import smooth
from dpr_lab.rig import Rig
from dpr_lab.run import Run, refuse_moving_arms


@dataclass(frozen=True, slots=True)
class PreprocessedRun:
    """A run from its release on, with additional data for the fit."""

    run: Run
    noise: NoiseFloor
    states: NDArray[np.float64]
    """(n, 4) smoothed theta1, theta2, omega1, omega2 at each sample, rad and rad/s."""


def preprocess(run: Run, rig: Rig) -> PreprocessedRun:
    """Measure a run's noise and estimate its velocities (Kalman filter and RTS smoother).

    Raises:
        RunError: too few samples, no motion, or an arm that was free or driven.
    """
    refuse_moving_arms([run])
    refuse_without_motion(run, rig)
    noise = noise_floor(run, rig)
    return PreprocessedRun(run.swing, noise, smooth(run.swing, noise).states)

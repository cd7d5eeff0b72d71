"""A run made ready for fitting: its noise floor and the state at every sample."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import added_base
from dpr_lab.estimation.least_squares import Conditions
from dpr_lab.estimation.noise import NoiseFloor, noise_floor
from dpr_lab.estimation.velocity import smooth
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class Evidence:
    """A run from its release on, with what the fit needs beside it."""

    run: Run
    noise: NoiseFloor
    states: NDArray[np.float64]
    """(n, 4) smoothed theta1, theta2, omega1, omega2 at each sample, rad and rad/s."""


def gather(run: Run, rig: Rig) -> Evidence:
    """Measure a run's noise and estimate its velocities (Kalman filter and RTS smoother)."""
    noise = noise_floor(run, rig)
    return Evidence(run.swing, noise, smooth(run.swing, noise).states)


def conditions(evidence: Sequence[Evidence], rig: Rig) -> Conditions:
    """What a fit to these runs takes as known: lengths, each run's noise, and any mass clamped on."""
    L1, g = rig.rig.L1, rig.rig.g
    return Conditions(
        L1,
        g,
        whitening=tuple(item.noise.whitening for item in evidence),
        added=tuple(added_base(item.run.added_mass, L1, g) for item in evidence),
    )

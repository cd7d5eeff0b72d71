"""Test whether energy enters the rods from a source that is not described.

The energy of the rods over b is linear in their ratios, and so is the work of known torques in 1/b:

    E/b = a/b omega1^2 / 2 + omega2^2 / 2 + d/b (cos(theta1 - theta2) omega1 omega2 + g/L1 cos theta2) + e1/b cos theta1

Rods that nothing else drives only lose energy. So the least sum of rises over all positive ratios is zero for a passive
rig, with any friction. It is computed by linear programming, without a fit of the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class EnergyRiseSettings:
    """Settings of the test for energy rises."""

    apart_s: float = 0.1
    """Between two means of the energy, which noise of the speeds then hardly touches."""
    quiet_rad: float = 0.01
    """Standard deviation of a reading from which the speeds, and so the energy, are too uncertain."""
    least_ratio: float = 0.01
    """Smallest ratio allowed; of double pendulums on a bench none is below 0.3."""
    entering: float = 0.3
    """Sum of rises over the range of the energy from which something drives the rods. Free rods reach 1e-4, rods with
    an error of 6 % in L1 0.013, driven rods and rods on a moving arm 0.9 and more."""


SETTINGS = EnergyRiseSettings()


def energy_rise(runs: Sequence[PreprocessedRun], rig: Rig, settings: EnergyRiseSettings = SETTINGS) -> float:
    """Least sum of energy rises over the energy's range, for any ratios; 0 for passive rods or where it is unknown.

    Runs with a moving arm, not of both rods, or with much noise do not count.
    """
    from scipy.optimize import linprog

    free = [
        prepared
        for prepared in runs
        if prepared.run.arm is None
        and not prepared.run.setup.held
        and prepared.noise.std_joint.max() < settings.quiet_rad
    ]
    parts = [_terms(prepared, rig) for prepared in free]
    means = [_means(terms, prepared.run.t, settings.apart_s) for terms, prepared in zip(parts, free, strict=True)]
    rises = np.concatenate([np.diff(mean, axis=0) for mean in means]) if means else np.zeros((0, 5))
    if not len(rises) or not np.isfinite(rises).all():
        return 0.0
    count, driven = len(rises), bool(rises[:, 4].any())
    solution = linprog(
        np.concatenate([np.zeros(4), np.ones(count)]),
        A_ub=np.hstack([rises[:, [1, 2, 3, 4]], -np.eye(count)]),
        b_ub=-rises[:, 0],
        bounds=[(settings.least_ratio, None)] * 3 + [(0.0, None if driven else 0.0)] + [(0.0, None)] * count,
        method="highs",
    )
    if not solution.success:
        return 0.0
    at = np.concatenate([[1.0], solution.x[:4]])
    spread = sum(float(np.ptp(terms[:, :4] @ at[:4])) for terms in parts)
    return float(solution.fun / spread) if spread > 0 else 0.0


def _terms(prepared: PreprocessedRun, rig: Rig) -> Array:
    """(n, 5) terms of the energy over b: of b, a, d, e1 and, less the work done, of 1/b."""
    theta1, theta2, omega1, omega2 = prepared.states.T
    mixed = np.cos(theta1 - theta2) * omega1 * omega2 + rig.g / rig.L1 * np.cos(theta2)
    work = np.zeros(len(theta1))
    if prepared.run.torques is not None:
        power = prepared.run.torques[:, 0] * omega1 + prepared.run.torques[:, 1] * (omega2 - omega1)
        work[1:] = np.cumsum(power[:-1] * np.diff(prepared.run.t))
    return np.stack([0.5 * omega2**2, 0.5 * omega1**2, mixed, np.cos(theta1), -work], axis=1)


def _means(terms: Array, t: Array, apart_s: float) -> Array:
    """Means over stretches of time, (stretches, 5)."""
    edges = np.flatnonzero(np.diff(np.floor((t - t[0]) / apart_s), prepend=-1.0))
    return np.add.reduceat(terms, edges) / np.diff(edges, append=len(t))[:, None]

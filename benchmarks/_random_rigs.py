"""Random rigs for benchmarks: true parameters near the rig `paper`, three recordings of each, and search boxes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.fitting.estimate import unknown_ratios
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.ratio_fit import information, rods_estimate, segmented
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.run import Run

RATE_HZ, REST_S, SWING_S = 200, 1.0, 10.0
TRUTH_STEP = 2.5e-4  # s; finer than the steps of dpr-lab, so that the true swing does not share the error of its solver
WITHIN = 0.15
PLACEMENT_STD, RELEASE_SPEED_STD = 0.01, 0.002  # errors of a release by hand, rad and rad/s
BOXES = {"20 %": (0.8, 1.2), "50 %": (0.5, 1.5), "factor 3": (1 / 3, 3.0)}
"""Lower and upper bound of every parameter relative to its nominal value, by name of the box."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Trial:
    """Random rig with its recordings."""

    Z: Array
    """(9,) true parameters, SI units."""
    ratios: Array
    """(5,) true ratios."""
    runs: list[PreprocessedRun]
    cramer_rao_std: Array
    """(5,) Cramer-Rao bounds of the standard deviations of the ratios, from three whole swings with unknown start
    states."""


def draw(seed: int, rate_hz: int = RATE_HZ) -> Trial:
    """Draw a rig with parameters within 15 % of the rig `paper`, and record it.

    Each recording starts from one of three poses and lasts 10 s. Encoders have 14 bits and a noise of half a count.
    """
    rig = load_rig("paper")
    L1, g = rig.L1, rig.g
    rng = np.random.default_rng(seed)
    Z = rig.nominal * rng.uniform(1 - WITHIN, 1 + WITHIN, len(PARAMETERS))
    base = base_parameters(Z, L1, g)
    recorded = [_record(rig, base, name, rate_hz, rng) for name in rig.poses]
    runs = [preprocess(run, rig) for run, _ in recorded]
    whole, _ = segmented(runs, rig, np.inf)
    known = information(whole, rods_estimate(unknown_ratios(base), np.array([start for _, start in recorded])))
    return Trial(Z, ratios(base), runs, np.sqrt(np.diag(np.linalg.inv(known))))


def boxed(box: str) -> Rig:
    """Return the rig `paper` with the bounds of a box."""
    below, above = BOXES[box]
    described = load_rig("paper").model_dump()
    for parameter in described["parameters"].values():
        nominal = parameter["nominal"]
        parameter.update(lower=below * nominal, upper=above * nominal)
    return Rig.model_validate(described)


def _record(rig: Rig, base: Array, pose: str, rate_hz: int, rng: np.random.Generator) -> tuple[Run, Array]:
    """Record a release from a pose, in counts, and return the recording and its true initial state."""
    return recorded(rig, pose, lambda start, t: simulate(base, rig.L1, rig.g, start, t, TRUTH_STEP), rate_hz, rng)


def recorded(
    rig: Rig, pose: str, swing: Callable[[Array, Array], Array], rate_hz: int, rng: np.random.Generator
) -> tuple[Run, Array]:
    """Record a swing that is released by hand, and return the recording and its true initial state.

    Args:
        rig: the rig
        pose: name of the pose
        swing: function that returns the (n, 4) states for a start state and instants
        rate_hz: sample rate
        rng: generator of the placement errors and the noise
    """
    t = np.arange(-round(REST_S * rate_hz), round(SWING_S * rate_hz) + 1) / rate_hz
    start = np.append(rig.poses[pose].theta[1:], np.zeros(2))
    start += rng.normal(0, [PLACEMENT_STD] * 2 + [RELEASE_SPEED_STD] * 2)
    theta = np.zeros((len(t), 3))
    theta[t < 0, 1:] = start[:2]
    theta[t >= 0, 1:] = swing(start, t[t >= 0])[:, :2]
    noise = rng.normal(0, rig.encoders.noise_counts, theta.shape)
    counts = np.rint(rig.positions(theta) + noise).astype(np.int64)
    return Run(pose, t, rig.theta(counts), counts, pose, rig.name, "", rate_hz), start

"""Noise that drives the rods: of the torques that are known only as well as they were measured.

A reading of a torque that is off by v while it holds, for h, is an impulse v h that the rods were not given. Where v is
white that is white noise of intensity std^2 h, carried along the swing like any torque (`dpr_lab.fitting.response`).
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import trajectory
from dpr_lab.fitting.robust import NORMAL_MAD
from dpr_lab.fitting.whitening import Disturbance
from dpr_lab.setup import Setup, Torques

Array = NDArray[np.float64]

ORDERS = range(1, 7)
"""Orders of differences: the first sees past the steps of a held command, the sixth past any smooth course."""

ONTO_RODS = np.array([[1.0, -1.0], [0.0, 1.0]])
"""Torques on theta1, theta2 of those of joint 1 and joint 2."""


def torque_noise(torques: Torques) -> Array:
    """(2,) standard deviation of the white noise of measured torques from the release on, N m; none of commanded ones.

    The least that differences of any order leave, by their median absolute value: what is left of the course of the
    torque itself can only make it look larger.
    """
    joints = torques.joints[torques.t >= 0.0]
    if torques.kind == "commanded" or len(joints) <= max(ORDERS):
        return np.zeros(2)
    left = [np.median(np.abs(np.diff(joints, n, axis=0)), axis=0) / comb(2 * n, n) ** 0.5 for n in ORDERS]
    return NORMAL_MAD * np.min(left, axis=0)


def disturbance(problem: Problem, at: Estimate) -> Disturbance | None:
    """What the noise of known torques does to the readings, along the swings of an estimate; none without any."""
    spread = np.array([_spread(setup) for setup in problem.segments.setups])
    if not spread.any():
        return None
    along = trajectory(problem, at)
    into = along.into @ spread[along.run]
    rate = into @ into.transpose(0, 2, 1)
    between = np.diff(along.t)[:, None, None] * 0.5 * (rate[1:] + rate[:-1])
    between[along.edges[1:-1] - 1] = 0.0
    up_to = np.concatenate([np.zeros((1, 4, 4)), np.cumsum(between, axis=0)])
    lower = np.minimum(along.at.astype(np.int64), len(up_to) - 2)
    share = (along.at - lower)[:, None, None]
    walk = np.diff((1 - share) * up_to[lower] + share * up_to[lower + 1], axis=0, prepend=0.0)
    walk[problem.segments.offsets[:-1]] = 0.0  # what was before the first sample is the initial state's
    return Disturbance(np.ascontiguousarray(walk), along.out)


def _spread(setup: Setup) -> Array:
    """(2, 2) root of the intensity of the noise on theta1, theta2, N m s^(1/2)."""
    if setup.torques is None:
        return np.zeros((2, 2))
    held = float(np.median(np.diff(setup.torques.t))) if len(setup.torques.t) > 1 else 0.0
    return ONTO_RODS * torque_noise(setup.torques) * held**0.5

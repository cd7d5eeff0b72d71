"""Process noise: measurement noise of known torques and prescribed motions.

If a torque reading with the error v is held for the time h, the simulation contains an impulse v h that did not act on
the rods. For white v, this is white process noise of intensity std^2 h. It propagates along the swing like any torque
(`dpr_lab.fitting.response`). The same applies to the noise of a prescribed angle, because the second derivative of the
angle drives the rods. A simulated inner rod with prescribed motion follows its own readings, so their noise affects
only the predicted readings of joint 2.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import Trajectory, trajectory
from dpr_lab.fitting.uncompiled import NORMAL_MAD
from dpr_lab.fitting.whitening import Disturbance
from dpr_lab.setup import PRESCRIBED, ArmMotion, Setup, Torques

ORDERS = range(1, 7)
"""Orders of differences for the noise estimate.

The first order is insensitive to the steps of a held command, the sixth to any smooth signal.
"""

ONTO_RODS = np.array([[1.0, -1.0], [0.0, 1.0]])
"""Matrix that converts torques of joints 1 and 2 to generalised torques on theta1 and theta2."""


def torque_noise(torques: Torques) -> Array:
    """Return the (2,) standard deviation of the white noise of measured torques, N m.

    The value is zero for torques that were not measured. It is estimated from the median absolute differences of
    several orders. The smallest estimate is used, because changes of the torque itself can only increase an estimate.
    For interpolated torques, the original rows are used, because high-order differences of a cubic polynomial are zero.
    """
    rows = torques.interpolated or torques
    joints = rows.joints[rows.t >= 0.0]
    if torques.kind != "measured" or len(joints) <= max(ORDERS):
        return np.zeros(2)
    estimates = [np.median(np.abs(np.diff(joints, n, axis=0)), axis=0) / comb(2 * n, n) ** 0.5 for n in ORDERS]
    return NORMAL_MAD * np.min(estimates, axis=0)


def disturbance(
    problem: Problem,
    estimate: Estimate,
    begins: Callable[[float], float] = segment_start,
    most_Nm: ArrayLike = np.inf,
) -> Disturbance | None:
    """Compute the effect of the process noise on the readings of a problem.

    The result is None for free swings.

    Args:
        problem: segments with their inputs
        estimate: estimate that defines the trajectories
        begins: as in `trajectory`
        most_Nm: (2,) upper limit of the standard deviation of the measured torques, N m
    """
    setups = problem.segments.setups
    spread = np.array([_spread(setup, most_Nm) for setup in setups])
    arm = np.array([_of_motion(setup.arm) for setup in setups])
    inner = np.array([_of_motion(setup.inner) for setup in setups])
    if not (spread.any() or arm.any() or inner.any()):
        return None
    reference = trajectory(problem, estimate, begins)
    into = reference.into @ spread[reference.motion.run]
    rate, shared = into @ into.transpose(0, 2, 1), np.zeros((len(problem.t), 2))
    for noise, push in ((arm, _push_of_arm), (inner, _push_of_inner)):
        if noise.any():
            slope, bend = _derivatives(push(reference, problem), reference)
            rate += (noise[reference.motion.run] ** 2)[:, None, None] * bend[:, :, None] * bend[:, None, :]
            shared_std = noise[problem.segments.run[problem.owner]] / float(np.median(np.diff(problem.t))) ** 0.5
            shared += np.einsum("nja,na->nj", reference.out, _at(slope, reference.at)) * shared_std[:, None]
    shared[inner[problem.segments.run[problem.owner]] > 0.0, 0] = 0.0
    between = np.diff(reference.motion.t)[:, None, None] * 0.5 * (rate[1:] + rate[:-1])
    between[reference.edges[1:-1] - 1] = 0.0
    walk = np.diff(
        _at(np.concatenate([np.zeros((1, 4, 4)), np.cumsum(between, axis=0)]), reference.at), axis=0, prepend=0.0
    )
    walk[problem.segments.offsets[:-1]] = 0.0  # the effect of earlier noise is part of the initial state
    return Disturbance(np.ascontiguousarray(walk), reference.out, shared)


def most_noise(problem: Problem) -> Array:
    """Return the (2,) largest `torque_noise` of all runs, N m."""
    return np.max([np.zeros(2), *(torque_noise(s.torques) for s in problem.segments.setups if s.torques)], axis=0)


def likeliest_noise(problem: Problem, model: Fit, halvings: int = 8) -> Array:
    """Return the (2,) maximum-likelihood noise of measured torques from a fit, N m.

    The restricted likelihood of the innovations (Patterson & Thompson 1971, Biometrika 58) is maximised by halving the
    variance of each joint. The search starts from the upper limits `torque_noise`. They are upper limits because the
    torque of a controller varies from sample to sample. Differences cannot distinguish this variation from noise.

    Args:
        problem: segments, some of which have measured torques
        model: fit to these segments
        halvings: maximum number of halvings of the variance; if the likelihood still increases, the noise is set to
            zero
    """
    upper = most_noise(problem)
    if not upper.any():
        return upper
    estimate, free = model.estimate, model.free
    shares = np.append(2.0 ** (-0.5 * np.arange(halvings + 1)), 0.0)
    none, *by_noise = (disturbance(problem, estimate, most_Nm=upper * chosen) for chosen in ([0, 0], [1, 0], [0, 1]))
    noisy = next(noise for noise in by_noise if noise is not None)
    quiet = np.zeros_like(noisy.walk) if none is None else none.walk
    walks = [quiet if noise is None else noise.walk - quiet for noise in by_noise]
    predicted = problem.predict(estimate)
    slopes = problem.slopes(estimate, free, predicted)

    @cache
    def cost(level1: int, level2: int) -> float:
        walk = quiet + shares[level1] ** 2 * walks[0] + shares[level2] ** 2 * walks[1]
        changed = replace(problem, disturbance=replace(noisy, walk=np.ascontiguousarray(walk)))
        squares, volume = restricted(changed, model, predicted, slopes)
        return squares + volume

    levels = (0, 0)
    while True:
        near = [(max(levels[0] + i, 0), max(levels[1] + j, 0)) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        best = min((pair for pair in near if max(pair) < len(shares)), key=lambda pair: cost(*pair))
        if best == levels:
            return upper * shares[list(levels)]
        levels = best


def restricted(problem: Problem, model: Fit, predicted: Array, slopes: Array) -> tuple[float, float]:
    """Return the two parts of -2 log restricted likelihood of the noise of a problem.

    The first part is the sum of squared residuals with all unknowns fitted. The second part is the logarithm of the
    determinants of the covariance and of the normal equations, which does not depend on the readings.

    Args:
        problem: segments with the noise
        model: fit to the same segments
        predicted: (samples, 2) readings of the fit, rad
        slopes: derivatives of these readings, as `Problem.slopes`
    """
    linear = linearise(problem, model.estimate, model.free, predicted, slopes)
    space = ColumnSpace.of(linear.A[:, :, model.inside], linear.e)
    space = space.with_prior(model.prior[:, model.inside], np.zeros(len(model.prior)))
    starts = 2 * float(np.log(np.abs(np.diagonal(linear.R, axis1=1, axis2=2))).sum())
    ratios = float(np.linalg.slogdet(space.H)[1] - 2 * np.log(space.scale).sum())
    return float(linear.e.ravel() @ linear.e.ravel()) - space.gain(), problem.log_variance + starts + ratios


def _at(values: Array, place: Array) -> Array:
    """Interpolate values (n, ...) linearly at positions (m,) in grid points."""
    lower = np.minimum(place.astype(np.int64), len(values) - 2)
    share = (place - lower).reshape(-1, *[1] * (values.ndim - 1))
    return (1 - share) * values[lower] + share * values[lower + 1]


def _push_of_arm(reference: Trajectory, problem: Problem) -> Array:
    """Return the (n, 4) initial-state change equivalent to a unit step of the speed of the arm."""
    rig = problem.model.constants
    d, e1 = reference.bases[reference.motion.run][:, 2], reference.bases[reference.motion.run][:, 3]
    levers = -rig.L0 / rig.g * np.stack([e1, d * rig.g / rig.L1], axis=1) * np.cos(reference.motion.theta)
    return (reference.into @ levers[:, :, None])[:, :, 0]


def _push_of_inner(reference: Trajectory, problem: Problem) -> Array:
    """Return the (n, 4) initial-state change equivalent to a unit step of the speed of the inner rod."""
    return PRESCRIBED.inertia * reference.into[:, :, 0]


def _derivatives(push: Array, reference: Trajectory) -> tuple[Array, Array]:
    """Return the first and second time derivative, (n, 4) each, of `push`.

    push(s) is the change of the initial state that is equivalent to a unit step of the prescribed speed at the instant
    s. An error e of a prescribed angle acts as the acceleration e''. With out(t), the derivative of the readings with
    respect to the initial state, two integrations by parts of out(t) times the integral of push e'' give the change of
    the readings

        dy(t) = -out(t) push'(t) e(t) + out(t) * integral of push''(s) e(s) ds up to t
    """
    slope, bend = np.empty_like(push), np.empty_like(push)
    for first, last in pairwise(reference.edges):
        slope[first:last] = np.gradient(push[first:last], reference.motion.t[first:last], axis=0)
        bend[first:last] = np.gradient(slope[first:last], reference.motion.t[first:last], axis=0)
    return slope, bend


def _of_motion(motion: ArmMotion | None) -> float:
    """Return the square root of the noise intensity of a prescribed angle, rad s^(1/2).

    The value is zero if no motion is prescribed.
    """
    return 0.0 if motion is None else motion.noise * float(np.median(np.diff(motion.t))) ** 0.5


def _spread(setup: Setup, most_Nm: ArrayLike) -> Array:
    """Return the (2, 2) square root of the torque noise intensity, N m s^(1/2).

    The rows are theta1 and theta2, the columns are joints 1 and 2.
    """
    if setup.torques is None:
        return np.zeros((2, 2))
    t = (setup.torques.interpolated or setup.torques).t
    held = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    return ONTO_RODS * np.minimum(torque_noise(setup.torques), most_Nm) * held**0.5

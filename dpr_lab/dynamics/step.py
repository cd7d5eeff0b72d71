"""One Runge-Kutta step of the rig with all its effects: the right-hand side that the simulator and the fits share."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import arm_accelerations
from dpr_lab.effects.folded import given, gives, grips, loaded, loads, mechanics, moved, switched
from dpr_lab.effects.quantities import NOTHING, Known, Motion, Mount, Rods, plus
from dpr_lab.kernels import njit


class Model(NamedTuple):
    """A rig and its effects, as compiled code takes them."""

    rods: Rods
    known: Known
    mount: Mount
    vector: NDArray[np.float64]
    """(SIZE,) parameters of all effects."""
    on: NDArray[np.bool_]
    """(effects,) which are on."""
    gives: bool
    """Whether one lets the arm move, which is then mounted as it says."""
    moved: bool
    """Whether any acts on the rods."""
    loaded: bool
    """Whether any that acts on the rods needs the joint forces."""


class State(NamedTuple):
    """Angles rad, speeds rad/s, presliding of both joints (-1 to 1)."""

    theta0: float
    theta1: float
    theta2: float
    omega0: float
    omega1: float
    omega2: float
    grip1: float
    grip2: float


@njit
def model_of(rods: Rods, known: Known, mount: Mount, vector: NDArray[np.float64]) -> Model:
    """The rig with the effects of a vector; `mount` holds its arm unless an effect does."""
    on = switched(vector)
    moves = gives(on)
    if moves:
        mount = given(known, vector)
    return Model(rods, known, mount, vector, on, moves, moved(on), loaded(on))


@njit
def joint_forces(motion: Motion, alphas: tuple[float, float, float], rods: Rods, known: Known) -> tuple[float, float]:
    """Forces that joint 1 and joint 2 carry, N: mass times acceleration less weight of all that hangs on them.

    Across and along the vertical; the part along the arm, which a held arm's rods lack, is left out.
    """
    alpha0, alpha1, alpha2 = alphas
    whirl1, whirl2 = motion.omega1 * motion.omega1, motion.omega2 * motion.omega2
    across1, up1 = motion.cos1 * alpha1 - motion.sin1 * whirl1, -motion.sin1 * alpha1 - motion.cos1 * whirl1
    across2, up2 = motion.cos2 * alpha2 - motion.sin2 * whirl2, -motion.sin2 * alpha2 - motion.cos2 * whirl2
    moment1, moment2, carried = rods.e1 / known.g, rods.e2 / known.g, known.m2 * known.L1
    whole, tip = known.m1 + known.m2 + known.mb, known.L0 * alpha0 if alpha0 != 0.0 else 0.0
    force1 = math.hypot(
        moment1 * across1 + moment2 * across2 + whole * tip, moment1 * up1 + moment2 * up2 + whole * known.g
    )
    force2 = math.hypot(
        carried * across1 + moment2 * across2 + known.m2 * tip, carried * up1 + moment2 * up2 + known.m2 * known.g
    )
    return force1, force2


@njit
def accelerations_at(
    t: float, x: State, slip1: float, slip2: float, model: Model, mode: int, drive: float
) -> tuple[float, float, float]:
    """(alpha0, alpha1, alpha2), rad/s^2, of a state whose joints have turned by slip1, slip2 since its grips held."""
    sin1, cos1, sin2, cos2 = math.sin(x.theta1), math.cos(x.theta1), math.sin(x.theta2), math.cos(x.theta2)
    motion = Motion(
        t, x.theta0, x.theta1, x.theta2, x.omega0, x.omega1, x.omega2,
        sin1, cos1, sin2, cos2, x.grip1, x.grip2, slip1, slip2, 0.0, 0.0,
    )  # fmt: skip
    terms = NOTHING
    if model.moved:
        terms = mechanics(motion, model.rods, model.known, model.vector, model.on)
    alphas = arm_accelerations(motion, model.rods, terms, model.mount, mode, drive)
    if model.loaded:
        force1, force2 = joint_forces(motion, alphas, model.rods, model.known)
        motion = Motion(
            t, x.theta0, x.theta1, x.theta2, x.omega0, x.omega1, x.omega2,
            sin1, cos1, sin2, cos2, x.grip1, x.grip2, slip1, slip2, force1, force2,
        )  # fmt: skip
        terms = plus(terms, loads(motion, model.rods, model.known, model.vector, model.on))
        alphas = arm_accelerations(motion, model.rods, terms, model.mount, mode, drive)
    return alphas


@njit
def stepped(t: float, x: State, h: float, model: Model, mode: int, drive: float) -> State:
    """The state one classical Runge-Kutta step of h later."""
    k0, k1, k2 = accelerations_at(t, x, 0.0, 0.0, model, mode, drive)
    p0, p1, p2 = x.omega0, x.omega1, x.omega2
    turn0, turn1, turn2, sum0, sum1, sum2 = p0, p1, p2, k0, k1, k2
    for stage in range(3):
        ahead, weight = (0.5 * h, 2.0) if stage < 2 else (h, 1.0)
        slip1, slip2 = ahead * p1, ahead * (p2 - p1)
        at = State(
            x.theta0 + ahead * p0, x.theta1 + ahead * p1, x.theta2 + ahead * p2,
            x.omega0 + ahead * k0, x.omega1 + ahead * k1, x.omega2 + ahead * k2, x.grip1, x.grip2,
        )  # fmt: skip
        p0, p1, p2 = at.omega0, at.omega1, at.omega2
        k0, k1, k2 = accelerations_at(t + ahead, at, slip1, slip2, model, mode, drive)
        turn0, turn1, turn2 = turn0 + weight * p0, turn1 + weight * p1, turn2 + weight * p2
        sum0, sum1, sum2 = sum0 + weight * k0, sum1 + weight * k1, sum2 + weight * k2
    sixth = h / 6.0
    grip1, grip2 = grips(x.grip1, x.grip2, sixth * turn1, sixth * (turn2 - turn1), model.vector, model.on)
    return State(
        x.theta0 + sixth * turn0, x.theta1 + sixth * turn1, x.theta2 + sixth * turn2,
        x.omega0 + sixth * sum0, x.omega1 + sixth * sum1, x.omega2 + sixth * sum2, grip1, grip2,
    )  # fmt: skip

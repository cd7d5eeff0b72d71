"""A rig with a moving arm as a Python module without dependencies but numpy, from dpr-lab's own equation of motion."""

from dpr_lab.dynamics.arm import DRIVEN, FREE, arm_accelerations
from dpr_lab.effects.quantities import SMOOTHING, ArmModel, BaseParameters, Motion, Terms
from dpr_lab.exports.moving_arm.bodies import absolute_parameters
from dpr_lab.exports.source import PREAMBLE, sources
from dpr_lab.identification.moving_arm.model import MovingArmModel

_HEAD = '''"""Rods on an arm that moves: dpr-lab's own equation of motion with the identified values.

simulate(x0, t, inputs)  states at the instants t, the input held from each instant to the next
derivative(x, u)         time derivative of a state
step(x, u, h)            the state after h, s

A state is theta0, theta1, theta2, omega0, omega1, omega2: arm, inner and outer rod, absolute angles, rad, rods 0 =
upright, pi = hanging; speeds, rad/s. Without an outer rod theta2 stays as it is. The input is INPUT; SI.
"""

import math
from collections import namedtuple
from itertools import pairwise

import numpy as np

RIG = {rig!r}
SCALE = {scale!r}
INPUT = {input!r}  # torque (N m), current (A), voltage (V) or acceleration (rad/s^2) of the arm; empty without one
VALUES = {values!r}
L1, G = {L1!r}, {g!r}

'''

_TAIL = '''
MODE, OUTER = {mode}, {outer}  # what the input is, and whether the outer rod is mounted
A, B, D, E1, C1, C2 = (VALUES[name] for name in ("a", "b", "d", "e1", "c1", "c2"))
BASE = BaseParameters(A, B, D, E1, D * G / L1, C1, C2)
ARM = ArmModel(VALUES["A"], VALUES["L0"] / G, VALUES["c0"], VALUES["k0"])
NOTHING = Terms(*[0.0] * len(Terms._fields))


def derivative(x, u=0.0):
    """(6,) time derivative of a state (6,) under the input u."""
    theta0, theta1, theta2, omega0, omega1, omega2 = map(float, x)
    theta2, omega2 = (theta2, omega2) if OUTER else (0.0, 0.0)
    known = dict.fromkeys(Motion._fields, 0.0)
    known.update(theta0=theta0, theta1=theta1, theta2=theta2, omega0=omega0, omega1=omega1, omega2=omega2)
    known.update(sin1=math.sin(theta1), cos1=math.cos(theta1), sin2=math.sin(theta2), cos2=math.cos(theta2))
    drive = u if MODE == {driven} else VALUES["gain"] * u - VALUES["f0"] * math.tanh(omega0 / {smoothing!r})
    alpha0, alpha1, alpha2 = arm_accelerations(Motion(**known), BASE, NOTHING, ARM, MODE, drive)
    return np.array([omega0, omega1, omega2, alpha0, alpha1, alpha2 if OUTER else 0.0])


def step(x, u, h):
    """(6,) the state after h, s, by the classical Runge-Kutta rule."""
    k1 = derivative(x, u)
    k2 = derivative(x + 0.5 * h * k1, u)
    k3 = derivative(x + 0.5 * h * k2, u)
    k4 = derivative(x + h * k3, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def simulate(x0, t, inputs=None, max_step=1e-3):
    """(n, 6) states at the instants t (n,) from x0 (6,) at t[0]; inputs (n,) are held until the next instant."""
    t = np.asarray(t, dtype=float)
    inputs = np.zeros(len(t)) if inputs is None else np.asarray(inputs, dtype=float)
    states = np.empty((len(t), 6))
    states[0] = x = np.asarray(x0, dtype=float)
    for i, (begin, end) in enumerate(pairwise(t.tolist())):
        count = max(1, math.ceil((end - begin) / max_step - 1e-9))
        for _ in range(count):
            x = step(x, float(inputs[i]), (end - begin) / count)
        states[i + 1] = x
    return states
'''


def python_module(model: MovingArmModel) -> str:
    """The model as a self-contained module."""
    functions = {"arm_accelerations": arm_accelerations}
    records = {kind.__name__: kind for kind in (BaseParameters, ArmModel, Motion, Terms)}
    head = _HEAD.format(
        rig=model.rig.name,
        scale=model.scale_sentence,
        input=model.input,
        values=absolute_parameters(model),
        L1=model.rig.L1,
        g=model.rig.g,
    )
    mode = DRIVEN if model.input == "acceleration" else FREE
    tail = _TAIL.format(mode=mode, outer=model.mounted == "both", driven=DRIVEN, smoothing=SMOOTHING)
    return f"{head}{PREAMBLE}\n\n{sources(records | functions)}\n\n{tail}"

"""Arguments and results of effect kernels, as tuples of numbers, which compiled code passes in registers."""

import math
from typing import NamedTuple

from dpr_lab.kernels import inlined

SMOOTHING = 0.02
"""Speed scale of the smoothed sign of a friction torque, rad/s, if the friction law defines none.

The value is far below the speeds of any swing.
"""


class RigConstants(NamedTuple):
    """Measured constants of a rig.

    Lengths are in m, masses in kg, and gravity in m/s^2. An unknown length or mass is nan, and so is every result that
    depends on it.
    """

    L0: float
    L1: float
    L2: float
    g: float
    m1: float
    m2: float
    mb: float
    counts_per_rev1: float
    counts_per_rev2: float
    relative2: float
    """1 if the encoder of joint 2 reads theta2 - theta1, 0 if it reads theta2."""
    counts_per_rev0: float
    """Counts per turn of the arm's encoder."""


class BaseParameters(NamedTuple):
    """Absolute base parameters and e2 = d g / L1.

    a, b and d are in kg m^2, e1 and e2 in N m, c1 and c2 in N m s/rad.
    """

    a: float
    b: float
    d: float
    e1: float
    e2: float
    c1: float
    c2: float


class Motion(NamedTuple):
    """State of motion at the time t since the release, s.

    Angles are absolute, rad, with 0 = upright; speeds are in rad/s. The sines and cosines are those of theta1 and
    theta2.
    """

    t: float
    theta0: float
    theta1: float
    theta2: float
    omega0: float
    omega1: float
    omega2: float
    sin1: float
    cos1: float
    sin2: float
    cos2: float
    displacement1: float
    """Rotation of joint 1 since the start of the integration step, rad."""
    displacement2: float
    force1: float
    """Force on joint 1, N; 0 outside the stage `load`."""
    force2: float
    direction1: float
    """Direction in which joint 1 slides, 1 or -1.

    0: Coulomb friction holds the joint at rest. nan: the joint has no Coulomb friction.
    """
    direction2: float
    displacement0: float
    """Rotation of the arm since the start of the step, rad."""
    direction0: float


class Joint(NamedTuple):
    """Motion of one joint: time, s, angle, rad (0 = hanging), and speed, rad/s.

    The other fields have the meaning that they have in `Motion`.
    """

    t: float
    angle: float
    speed: float
    displacement: float
    force: float
    direction: float


class EncoderReading(NamedTuple):
    """One encoder reading before the encoder errors are added."""

    number: int
    """Number of the encoder and of its joint: 0, 1 or 2."""
    angle: float
    """Reading without errors, rad."""
    hanging: float
    """Reading while the rods hang, rad."""
    counts_per_rev: float
    t: float
    """Device time since the release, s."""
    run: int
    """Number of the release, from 0."""


class Terms(NamedTuple):
    """Contribution to equation (1): mass matrix, kg m^2, and right-hand side, N m."""

    a: float
    b: float
    coupling: float
    torque1: float
    torque2: float


NOTHING = Terms(0.0, 0.0, 0.0, 0.0, 0.0)


class ArmModel(NamedTuple):
    """Constants of the arm.

    `inertia` is the inertia about the arm's axis with the masses of the rods at the arm's tip, kg m^2. `reach` is L0 /
    g, s^2. `friction` is in N m s/rad and `stiffness` in N m/rad.
    """

    inertia: float
    reach: float
    friction: float
    stiffness: float


HELD_ARM = ArmModel(math.inf, 0.0, 0.0, 0.0)
"""Model of an arm that does not move."""


@inlined
def joint0(motion: Motion) -> Joint:
    """Return the joint of the arm in a motion of the rig, without its force."""
    return Joint(motion.t, motion.theta0, motion.omega0, motion.displacement0, 0.0, motion.direction0)


@inlined
def joint1(motion: Motion) -> Joint:
    """Return joint 1 in a motion of the rig."""
    angle = motion.theta1 - math.pi
    return Joint(motion.t, angle, motion.omega1, motion.displacement1, motion.force1, motion.direction1)


@inlined
def joint2(motion: Motion) -> Joint:
    """Return joint 2 in a motion of the rig."""
    angle, speed = motion.theta2 - motion.theta1, motion.omega2 - motion.omega1
    return Joint(motion.t, angle, speed, motion.displacement2, motion.force2, motion.direction2)


@inlined
def yielding(joint: Joint, push: float) -> Joint:
    """Return a resting joint as if it slid in the direction of the torque `push`, N m."""
    return Joint(joint.t, joint.angle, 0.0, joint.displacement, joint.force, math.copysign(1.0, push))


@inlined
def encoder0(angle: float, t: float, run: int, constants: RigConstants) -> EncoderReading:
    """Return the reading of the arm's encoder at an angle of the arm, rad."""
    return EncoderReading(0, angle, 0.0, constants.counts_per_rev0, t, run)


@inlined
def encoder1(angle: float, t: float, run: int, constants: RigConstants) -> EncoderReading:
    """Return the reading of encoder 1 at an absolute angle, rad."""
    return EncoderReading(1, angle, math.pi, constants.counts_per_rev1, t, run)


@inlined
def encoder2(angle: float, t: float, run: int, constants: RigConstants) -> EncoderReading:
    """Return the reading of encoder 2 at an angle of joint 2, rad."""
    return EncoderReading(2, angle, (1.0 - constants.relative2) * math.pi, constants.counts_per_rev2, t, run)


@inlined
def torques(torque1: float, torque2: float) -> Terms:
    """Return the terms of generalised torques on theta1 and theta2, N m."""
    return Terms(0.0, 0.0, 0.0, torque1, torque2)


@inlined
def plus(x: Terms, y: Terms) -> Terms:
    """Return the sum of two contributions to equation (1)."""
    return Terms(x.a + y.a, x.b + y.b, x.coupling + y.coupling, x.torque1 + y.torque1, x.torque2 + y.torque2)

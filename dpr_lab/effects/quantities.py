"""What kernels of effects read and return: plain tuples of numbers that compiled code passes in registers."""

from typing import NamedTuple

from dpr_lab.kernels import njit

SMOOTHING = 0.02
"""Speed below which dry friction fades linearly, rad/s: far below any swing, and still smooth for a 2.5 ms step."""


class Known(NamedTuple):
    """What was measured on this rig: lengths m, gravity m/s^2, masses kg; counts per turn; how joint 2 is read.

    A length or mass that nobody gave is nan, and so is then whatever an effect makes of it.
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
    """1 where the encoder of joint 2 reads theta2 - theta1, 0 where it reads theta2."""


class Rods(NamedTuple):
    """Base parameters and e2 = d g / L1, absolute SI: kg m^2, N m, N m s/rad."""

    a: float
    b: float
    d: float
    e1: float
    e2: float
    c1: float
    c2: float


class Motion(NamedTuple):
    """Where the rig is: t since the release (s), absolute angles (rad, 0 = upright), speeds (rad/s), sines, cosines."""

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
    grip1: float
    """Presliding of joint 1 at the start of the step, -1 to 1."""
    grip2: float
    slip1: float
    """How far joint 1 has turned since the start of the step, rad."""
    slip2: float
    force1: float
    """Force that joint 1 carries, N; 0 outside the stage `load`."""
    force2: float


class Joint(NamedTuple):
    """One joint: time s, angle rad (0 = hanging straight), speed rad/s; grip, slip and force as in `Motion`."""

    t: float
    angle: float
    speed: float
    grip: float
    slip: float
    force: float


class Terms(NamedTuple):
    """What an effect adds to equation (1): to the mass matrix, kg m^2, and to its right-hand side, N m."""

    a: float
    b: float
    coupling: float
    torque1: float
    torque2: float


NOTHING = Terms(0.0, 0.0, 0.0, 0.0, 0.0)


class Mount(NamedTuple):
    """The arm: inertia with all rods at its tip kg m^2, L0 / g s^2, friction N m s/rad, spring N m/rad."""

    inertia: float
    reach: float
    friction: float
    stiffness: float


@njit
def torques(torque1: float, torque2: float) -> Terms:
    """An effect that is nothing but generalised torques on theta1 and theta2, N m."""
    return Terms(0.0, 0.0, 0.0, torque1, torque2)


@njit
def plus(x: Terms, y: Terms) -> Terms:
    """The sum of two effects."""
    return Terms(x.a + y.a, x.b + y.b, x.coupling + y.coupling, x.torque1 + y.torque1, x.torque2 + y.torque2)

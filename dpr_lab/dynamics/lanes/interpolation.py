"""Angles within a step, interpolated by the cubic polynomial through the states at both ends."""

from dpr_lab.dynamics.lanes.workspace import LaneWorkspace
from dpr_lab.kernels import subroutine


@subroutine
def cubic(u: float, h: float, y0: float, v0: float, y1: float, v1: float) -> float:
    """Interpolate at the fraction u of a step of length h by a cubic polynomial.

    The polynomial has the values y0, y1 and the derivatives v0, v1 at the ends of the step.
    """
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y0 + u * h * v0) + u * u * ((3.0 - 2.0 * u) * y1 - v * h * v1)


@subroutine
def angle1(w: LaneWorkspace, k: int, u: float) -> float:
    """Return theta1 of lane k at the fraction u of its step, rad."""
    return cubic(u, w.h[k], w.old_theta1[k], w.old_omega1[k], w.theta1[k], w.omega1[k])


@subroutine
def angle2(w: LaneWorkspace, k: int, u: float, relative2: float) -> float:
    """Return the angle of encoder 2 at the fraction u of the step of lane k, rad."""
    theta2 = cubic(u, w.h[k], w.old_theta2[k], w.old_omega2[k], w.theta2[k], w.omega2[k])
    return theta2 - relative2 * angle1(w, k, u)


@subroutine
def angle0(w: LaneWorkspace, k: int, u: float) -> float:
    """Return theta0 of lane k at the fraction u of its step, rad."""
    return cubic(u, w.h[k], w.old_theta0[k], w.old_omega0[k], w.theta0[k], w.omega0[k])


@subroutine
def speed0(w: LaneWorkspace, k: int, u: float) -> float:
    """Return the arm speed of lane k at the fraction u of its step, rad/s."""
    return w.old_omega0[k] + u * (w.omega0[k] - w.old_omega0[k])

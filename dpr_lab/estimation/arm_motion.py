"""Estimate the motion of an arm by a smoothing spline with generalised cross-validation."""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import ORDER, difference_std
from dpr_lab.rig import Rig
from dpr_lab.setup import ArmMotion

FEWEST = 5
"""Minimum number of readings that a smoothing spline needs."""


def prescribed_arm(t: Array, theta0: Array, rig: Rig, name: str) -> ArmMotion:
    """Estimate the motion of a prescribed arm; see `arm_motion` for the arguments.

    Raises:
        RunError: the rig file does not contain L0, there are too few readings, or an angle is missing.
    """
    if "L0" not in rig.rig.model_fields_set:
        raise RunError(f"{name}: a moving arm needs its length L0 in [rig]")
    return arm_motion(t, theta0, name)


def prescribed_inner(t: Array, theta1: Array, name: str) -> ArmMotion:
    """Estimate the motion of a prescribed inner rod; see `arm_motion` for the arguments.

    Raises:
        RunError: the rod does not move, there are too few readings, or an angle is missing.
    """
    if not np.ptp(theta1) > 0.0:
        raise RunError(
            f"{name}: joint 1 is prescribed, but stands still. If only the outer rod is mounted, use --rods outer"
        )
    return arm_motion(t, theta1, name, "theta1")


def arm_motion(t: Array, theta0: Array, name: str, angle: str = "theta0") -> ArmMotion:
    """Estimate the motion of the arm or of a prescribed inner rod from its readings.

    The spline minimises the sum of squared errors plus the integral of the squared second derivative. The weight of the
    second term is determined by generalised cross-validation (Woltring 1986, A Fortran package for generalized,
    cross-validatory spline smoothing and differentiation).

    Args:
        t: (n,) times, s
        theta0: (n,) readings, rad
        name: name of the recording for messages
        angle: name of the angle for messages

    Raises:
        RunError: there are too few readings, or the angle was not measured in every row.
    """
    from scipy.interpolate import make_smoothing_spline

    if len(t) < FEWEST:
        raise RunError(f"{name}: {len(t)} readings of {angle} are too few: at least {FEWEST} are needed")
    if not np.isfinite(theta0).all():
        raise RunError(
            f"{name}: the angle of a prescribed joint is required in every row: name the columns of {angle} and t"
        )
    spacing = float(np.median(np.diff(t)))
    # time in samples, because the search for the weight of the spline depends on the unit
    normalised = (t - t[0]) / spacing
    spline = make_smoothing_spline(normalised, theta0)
    noise = float(difference_std(t, theta0[:, None])[0]) if len(t) > ORDER else 0.0
    return ArmMotion(t, np.asarray(spline(normalised)), np.asarray(spline.derivative()(normalised)) / spacing, noise)


def refuse_still_arm(theta0: Array, mode: str, path: object, least_rad: float = 0.01) -> None:
    """Check that a free or driven arm moved by at least `least_rad`.

    Raises:
        RunError: the arm moved less.
    """
    if np.ptp(theta0) < least_rad:
        raise RunError(
            f"{path}: the arm moves by only {np.ptp(theta0):.2g} rad although it is {mode}. Check its encoder, and"
            " the column and unit of theta0 in a table. If the arm was held or pressed against a stop, use --arm"
            " clamped"
        )

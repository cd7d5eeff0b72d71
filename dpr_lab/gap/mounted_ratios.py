"""Ratios of fitted parameters to the inertia b, or to a if only the inner rod is mounted."""

from dpr_lab.dynamics.base import GAINS, RATIOS
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, Estimate, FreeParameter, alone_share
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig


def ratio_of(parameter: FreeParameter, estimate: Estimate, rig: Rig, *, alone: bool) -> tuple[str, float, float] | None:
    """Return a fitted parameter of rods, arm or drive as a ratio to b, or to a with `alone`.

    Args:
        parameter: the fitted parameter
        estimate: the estimate that contains its value
        rig: the rig
        alone: whether only the inner rod is mounted

    Returns:
        name of the ratio, its value, and the divisor that converts errors of the parameter; None for other parameters
    """
    unknown, value = estimate.ratios, parameter.read(estimate)
    on_elbow, inertia = (float(unknown[ON_ELBOW]), alone_share(unknown)) if alone else (0.0, 1.0)
    scale, letter = float(unknown[SCALE]) * inertia, "a" if alone else "b"
    if parameter.block == "ratios" and parameter.place < len(RATIOS):
        if parameter.name == "e1/b":  # ratio of the rod alone, without the parts at the elbow of the complete rig
            value -= on_elbow * rig.g / rig.L1
        return f"{parameter.name.partition('/')[0]}/{letter}", value / inertia, inertia
    if parameter.effect == FREE_ARM.name:
        return f"{'A' if parameter.name.startswith('inertia') else 'c0'}/{letter}", value / scale, scale
    if parameter.effect == DRIVE_GAIN.name and rig.motor is not None:
        per = scale / drive_gain(rig).value
        return GAINS[rig.motor.input].format(letter), (1.0 + value) / per, per
    return None

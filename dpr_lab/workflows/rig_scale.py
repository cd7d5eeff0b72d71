"""Measured values of a rig file that determine the scale of masses and torques."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dpr_lab.rig import Rig


def values_of_scale(mounted: str, elbow: str, arm_mode: str, mb: float = 0.0) -> str:
    """List parameters whose measured values together determine the scale.

    `mb` is the mass at joint 2 in kg, which matters for a single rod.
    """
    from dpr_lab.rig import of_inner_rod

    rod = 1 if mounted == "inner" else 2
    if arm_mode in ("free", "driven"):
        return f"m{rod}, l{rod} and J{rod}"
    if (mounted, elbow) == ("both", "clamped"):
        return "m1, l1, m2, l2 and mb"
    return "m1, l1 and mb" if rod == 1 and "mb" in of_inner_rod(mb) else f"m{rod} and l{rod}"


def scale_known(rig: "Rig") -> bool:
    """Check whether an added mass, the motor or measured values of a rig file determine the scale.

    The measured values are checked as in `identify`, but for rods that are not exactly uniform. With the centre of
    mass exactly in the middle of a rod, the derivative of its inertia would be zero, and the result could be wrong.
    """
    import numpy as np

    from dpr_lab.dynamics.base import whole_parameters
    from dpr_lab.fitting.estimate import unknown_ratios, visible_ratios
    from dpr_lab.identification.moving_arm.setup import rods_measured
    from dpr_lab.identification.prior_update import clamped_cosine, posterior_of
    from dpr_lab.setup import Setup

    motor = rig.motor if rig.arm.mode == "driven" else None
    known_current = motor and motor.input == "current" and motor.kt and motor.kt.std
    if rig.added_mass or known_current or (motor and motor.input == "torque"):
        return True
    if rig.arm.mode in ("free", "driven"):
        return rods_measured(rig)
    mounting = rig.rods.mounting if rig.joints.inner == "free" else "outer"
    bends = [pose.theta[2] - pose.theta[1] for pose in rig.poses.values()] if mounting == "clamped" else []
    setups = [Setup(mounting, elbow=round(bend, 1)) for bend in bends or [0.0]]
    Z = rig.nominal
    Z[rig.searched] *= np.linspace(0.9, 0.95, int(rig.searched.sum()))
    ratios, clamped = unknown_ratios(whole_parameters(Z, rig.L1, rig.g)), clamped_cosine(setups)
    visible = visible_ratios(setups)
    return posterior_of(ratios, rig, visible, alone=mounting == "inner", clamped=clamped).scale().known

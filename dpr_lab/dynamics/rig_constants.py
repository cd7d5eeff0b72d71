"""Measured constants of a rig in one run, for the kernels of effects."""

import math

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.setup import Setup

UNKNOWN = RigConstants._make([math.nan] * len(RigConstants._fields))._replace(relative2=1.0)
"""Constants of a rig of which no length or mass is known; encoder 2 reads theta2 - theta1."""


def rig_constants(rig: Rig) -> RigConstants:
    """Return the constants of a rig without an attached mass, from measured or nominal values.

    The length L2, if unknown, is assumed to be twice the distance to the centre of mass.
    """
    best = dict(zip(PARAMETERS, rig.nominal.tolist(), strict=True))
    frame, encoders = rig.rig, rig.encoders
    counts0, counts1, counts2 = encoders.counts_per_rev
    return RigConstants(
        L0=frame.L0,
        L1=frame.L1,
        L2=frame.L2 or 2.0 * best["l2"],
        g=frame.g,
        m1=best["m1"],
        m2=best["m2"],
        mb=best["mb"],
        counts_per_rev1=float(counts1 * encoders.direction[1]),
        counts_per_rev2=float(counts2 * encoders.direction[2]),
        relative2=float(encoders.joint2 == "relative"),
        counts_per_rev0=float(counts0 * encoders.direction[0]),
    )


def constants_of_run(constants: RigConstants, setup: Setup) -> RigConstants:
    """Return the rig constants in one run, with its mounted parts and attached mass."""
    if (added := setup.added) is not None:
        heavier = {"m1": constants.m1 + added.mass} if added.rod == "inner" else {"m2": constants.m2 + added.mass}
        constants = constants._replace(**heavier)
    if setup.mounting == "inner":
        return constants._replace(m2=0.0, L2=0.0)
    if setup.mounting == "outer":
        return constants._replace(m1=constants.m2, m2=0.0, mb=0.0, L1=constants.L2, L2=0.0)
    return constants

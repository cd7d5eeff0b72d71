"""What was measured on a rig and what a run carried besides, as the kernels of effects read it."""

import math

from dpr_lab.effects.quantities import Known
from dpr_lab.rig import PARAMETERS, AddedMass, Rig

UNKNOWN = Known._make([math.nan] * len(Known._fields))._replace(relative2=1.0)
"""A rig of which nothing was measured, its joint-2 encoder on the joint."""


def known_of(rig: Rig) -> Known:
    """Lengths, gravity, best known masses and encoders of a rig, without any mass clamped on.

    A rod whose length nobody gave is taken as twice its centroid's distance.
    """
    best = dict(zip(PARAMETERS, rig.nominal.tolist(), strict=True))
    frame, encoders = rig.rig, rig.encoders
    _, counts1, counts2 = encoders.counts_per_rev
    return Known(
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
    )


def carrying(known: Known, added: AddedMass | None) -> Known:
    """The same rig with a mass clamped to a rod."""
    if added is None:
        return known
    if added.rod == "inner":
        return known._replace(m1=known.m1 + added.mass)
    return known._replace(m2=known.m2 + added.mass)

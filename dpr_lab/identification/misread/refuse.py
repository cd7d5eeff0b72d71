"""Refuse recordings that were read with another zero, unit, sign or order than they were written with.

A fit of such a reading ends with physically impossible ratios or with a large residual. A reading that explains the
recordings ten times better is then the likely cause.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.fitting.estimate import SCALE, unknown_ratios
from dpr_lab.identification.misread.tried import SETTINGS, better_readings, fitted, impossible, residual, second_look
from dpr_lab.identification.ratio_fit import RatioFit
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Array = NDArray[np.float64]


def refuse_misread(runs: Sequence[Run], rig: Rig) -> None:
    """Make sure that recordings can be of the rig.

    Raises:
        IdentificationError: they cannot; with the likely cause, which was tried.
        RunError: a run without enough samples or motion, however it is read.
    """
    ratio_fit, refused = _as_read(runs, rig)
    possible = ratio_fit is not None and not impossible(ratio_fit.ratios, rig)
    if ratio_fit is not None and possible and residual(ratio_fit) < SETTINGS.suspicious:
        return
    causes = [
        reading.cause
        for reading, _ in better_readings(runs, rig, np.inf if ratio_fit is None else ratio_fit.chi2_per_dof)
    ]
    if causes:
        raise IdentificationError(
            f"these recordings do not fit this rig as interpreted; another interpretation fits: {', or '.join(causes)}"
        )
    if refused is not None:
        raise refused
    driven = any(run.torques is not None for run in runs)
    if ratio_fit is None or not possible or residual(ratio_fit) > SETTINGS.hopeless:
        raise IdentificationError(
            "these recordings are of no double pendulum with the lengths and masses of the rig file"
            + (f": {impossible(ratio_fit.ratios, rig)}" if ratio_fit is not None and not possible else "")
            + "; another zero, sign, unit or order of the angles was tried and does not explain it: check the unit of"
            f" time{', torques (in N m)' * driven}, L1 and g in the rig file, masses, counts_per_rev, and that the arm"
            " is clamped"
        )


def _as_read(runs: Sequence[Run], rig: Rig) -> tuple[RatioFit | None, RunError | None]:
    """The fit of the recordings as they are read, or the reason why there is none."""
    try:
        return fitted(runs, rig), None
    except RunError as error:
        return None, error


def refuse_negative_scale(unknown: Array, runs: Sequence[Run], rig: Rig) -> None:
    """Make sure that ratios, and the inertia b that known torques or masses give, are positive and finite.

    Torques that contradict the motion send b to infinity of either sign: far beyond the rig file's value it is as
    impossible as a negative one.

    Args:
        unknown: (7,) ratios, b and p/b of a fit
        runs: that were fitted
        rig: that they were recorded on

    Raises:
        IdentificationError: they are not; with the likely cause.
    """
    *ratios, b, _ = unknown.tolist()
    nominal = float(unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))[SCALE])
    if 0 < b < SETTINGS.largest_inertia * nominal and min(ratios[:3]) > 0:
        return
    kind = "a negative" if b < 0 else "an impossibly large"
    wrong = f"the known torques or masses fit only {kind} inertia (b = {b:.3g} kg m^2, by the rig file {nominal:.3g})"
    wrong = wrong if min(ratios[:3]) > 0 else impossible(unknown[: len(ratios)], rig)
    hint = second_look(runs, rig).sentence or "Check the signs and units of angles and torques, and the unit of time."
    raise IdentificationError(f"{wrong}. {hint}")


def refuse_impossible(ratios: Array, rig: Rig) -> None:
    """Refuse (5,) ratios unless they belong to rods with positive masses.

    Raises:
        IdentificationError: they cannot.
    """
    if why := impossible(ratios, rig):
        raise IdentificationError(f"{why}: check zero, unit, sign and order of the angles, and L1 in the rig file")

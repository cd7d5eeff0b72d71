"""Refuse recordings for which zero, unit, sign or order of the angles is specified incorrectly.

A fit with an incorrect interpretation ends with physically impossible ratios or a large residual. If another
interpretation explains the recordings ten times better, it is probably the correct one.
"""

from collections.abc import Sequence

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects.spring import SPRING
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.identification.misread.readings import HELD_BY_SPRING, listed_causes
from dpr_lab.identification.misread.tried import (
    SETTINGS,
    better_readings,
    check_description,
    fitted,
    impossible,
    impossible_fit,
    impossible_scale,
    residual,
)
from dpr_lab.identification.ratio_fit import RatioFit
from dpr_lab.rig import Rig
from dpr_lab.run import Run, moves


def refuse_misread(runs: Sequence[Run], rig: Rig) -> None:
    """Check that the recordings are consistent with the described rig.

    Raises:
        IdentificationError: the recordings are inconsistent with the rig; the message names the interpretation that
            fits, or the contradiction.
        RunError: a run has too few samples or too little motion in every interpretation.
    """
    if moves(runs):
        return  # signs and units of arm and input are tested in `gap.screen.input` and `moving_arm.doubts`
    ratio_fit, refused = _as_read(runs, rig)
    contradiction = "" if ratio_fit is None else impossible_fit(ratio_fit, runs, rig)
    possible = ratio_fit is not None and not contradiction
    if ratio_fit is not None and possible and residual(ratio_fit) < SETTINGS.suspicious:
        return
    chi2 = np.inf if ratio_fit is None else ratio_fit.chi2_per_dof
    # impossible masses may fit the readings down to the noise, so another interpretation need not fit better
    if not possible:
        chi2 = max(chi2, SETTINGS.explained * SETTINGS.better)
    better = better_readings(runs, rig, chi2, chi2 / SETTINGS.better)
    if causes := listed_causes([reading for reading, _ in better], runs):
        raise IdentificationError(
            f"these recordings do not fit this rig as interpreted; another interpretation fits: {causes}"
        )
    if refused is not None:
        raise refused
    driven = any(run.torques is not None for run in runs)
    if ratio_fit is None or not possible or residual(ratio_fit) > SETTINGS.hopeless:
        raise IdentificationError(
            "these recordings are not compatible with the lengths and masses of the rig file"
            + (f": {contradiction}" if contradiction else "")
            + ". Zeros in the opposite direction and other signs, units or orders of the angles do not explain them."
            " Check the zero of each angle (--offset or zero_counts), --wrap, the unit of time"
            f"{', torques (in N m)' * driven}, L1 and g in the rig file, masses, and counts_per_rev. Check that the arm"
            f" is clamped{_UNKNOWN_DRIVE * (not driven)}"
        )


_UNKNOWN_DRIVE = (
    ". Rods that a motor, a hand or a stop moves do not swing freely: import their torques with the angles (columns"
    " tau1 and tau2), or only the free part (--start-s, --duration-s)"
)


_NO_GRAVITY = (
    "The model contains a spring of joint 1 instead of gravity, because the period of the swing hardly depends on its"
    f" amplitude. The readings are then larger than the angles, or {HELD_BY_SPRING}, and correct the scale (--scale,"
    " --unit, counts_per_rev)"
)


def _as_read(runs: Sequence[Run], rig: Rig) -> tuple[RatioFit | None, RunError | None]:
    """Fit the recordings as described; return the fit, or the error that prevents it."""
    try:
        return fitted(runs, rig), None
    except RunError as error:
        return None, error


def refuse_impossible_scale(unknown: Array, runs: Sequence[Run], rig: Rig, effects: Sequence[str] = ()) -> None:
    """Check that a rig can have the fitted ratios and the fitted inertia b.

    Known torques or masses determine b. If the torques contradict the motion, the estimate of 1/b is near zero, so that
    b is very large and may be negative. Torques in another unit result in a b that is far from the value of the rig
    file.

    Args:
        unknown: (7,) ratios, b and p/b of a fit
        runs: the fitted runs
        rig: rig of the recordings
        effects: effects of the fitted model

    Raises:
        IdentificationError: the rig cannot have these values; the message names the probable cause.
    """
    ratios, inertia = unknown[:SCALE], float(unknown[SCALE])
    wrong = impossible(ratios, rig) if ratios[:3].min() <= 0 else impossible_scale(inertia, runs, rig)
    if not wrong:
        return
    replaced = SPRING[0].name in effects and ratios[RATIOS.index("e1/b")] <= 0
    hint = _NO_GRAVITY if replaced else "" if moves(runs) else check_description(runs, rig).sentence
    hint = hint or "Check the signs and units of angles and torques, and the unit of time."
    raise IdentificationError(f"{wrong}. {hint}")


def refuse_impossible(ratios: Array, rig: Rig) -> None:
    """Check that rods with positive masses can have the given ratios (5,).

    Raises:
        IdentificationError: no positive masses have these ratios.
    """
    if reason := impossible(ratios, rig):
        raise IdentificationError(f"{reason}: check zero, unit, sign and order of the angles, and L1 in the rig file")

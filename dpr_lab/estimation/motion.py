"""Check the minimum content of a recording: samples, duration, and motion of both joints."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.estimation.noise import noise_floor
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class MotionSettings:
    """Limits of the minimum content of a recording."""

    samples: int = 16
    """Minimum number of samples after the release: two segments of eight, one to fit and one to validate."""
    duration_s: float = 0.35
    """Minimum duration after the release, s.

    One segment takes 0.25 s, and the initial state of a free run is fitted to 0.3 s; the remainder is compared.
    """
    turn_rad: float = 0.01
    """Minimum range of an angle of a swinging rod, rad; a hanging rod that is touched moves by some milliradians."""
    above_noise: float = 10.0
    """Minimum range of an angle of a swinging rod, in standard deviations of a reading.

    The range is about five for noise alone, and three for shuffled rows. Late time stamps of camera frames increase it
    to sixteen.
    """
    elbow: float = 0.02
    """Minimum ratio of the range of joint 2 to the range of joint 1 for an elbow that turns.

    A free elbow turns by a fifth of joint 1 even in the slow mode, in which both rods swing together. A clamp has a
    play of at most 0.1 rad.
    """
    tail: float = 0.01
    """Fraction of the readings that is ignored at each end of a range, because extreme readings may be faults."""


SETTINGS = MotionSettings()


def refuse_without_motion(run: Run, rig: Rig) -> None:
    """Check that a run contains a swing of all joints that can turn.

    Raises:
        RunError: the run has too few samples or is too short, a joint is at rest, or the noise is as large as the
            motion.
    """
    swing, name = run.swing, run.file or run.name
    duration = float(np.ptp(swing.t)) if len(swing.t) else 0.0
    if len(swing.t) < SETTINGS.samples or duration < SETTINGS.duration_s:
        raise RunError(
            f"{name}: {len(swing.t)} samples over {duration:.3g} s after the release: at least {SETTINGS.samples}"
            f" samples over {SETTINGS.duration_s:g} s are needed. Record a longer swing, and check the unit of time"
        )
    if not np.isfinite(swing.theta[:, 1:]).all():
        raise RunError(f"{name}: an angle is not a finite number: remove such rows from the table")
    rods = _ranges(swing.theta[:, 1:])
    _refuse_still(str(name), run, rods)
    noise = float(noise_floor(run, rig).std_joint[0])
    if SETTINGS.above_noise * noise > rods[0]:
        raise RunError(
            f"{name}: the noise of joint 1 is {noise:.2g} rad and the range of its motion {rods[0]:.2g} rad, so the"
            " noise hides the swing: check the unit of the angles and the order of the rows, or record a larger swing"
        )
    elbow = float(_ranges(swing.theta[:, 2] - swing.theta[:, 1]))
    if not run.setup.held and run.torques is None and elbow < SETTINGS.elbow * rods[0]:
        raise RunError(
            f"{name}: joint 2 does not turn: theta2 - theta1 changes by {elbow:.2g} rad while theta1 changes by"
            f' {rods[0]:.2g} rad. If the elbow is clamped, import with --elbow clamped, or set elbow = "clamped" in'
            " [rods] of the rig file. If only one rod is mounted, use --rods inner or --rods outer. If both"
            " rods swing, the columns of theta1 and theta2 belong to the same rod: check --columns"
        )


def _refuse_still(name: str, run: Run, rods: Array) -> None:
    still = [f"theta{i + 1}" for i, size in enumerate(rods.tolist()) if size < SETTINGS.turn_rad]
    if run.setup.alone:
        still = [axis for axis in still if axis == "theta1"]
    if not still:
        return
    if run.keep_rest:
        cure = "if the rods are held there, import the table without --keep-rest"
    elif still == ["theta2"]:
        cure = "if only the inner rod is mounted, use --rods inner, otherwise check the column of theta2 (--columns)"
    elif still == ["theta1"] and not run.setup.held:
        cure = (
            "check the column of theta1 (--columns); the angle of a single rod on joint 1 is theta1: import it with"
            " --rods inner or --rods outer"
        )
    else:
        cure = "record a release, or check the columns (--columns) and the unit of the angles (--unit)"
    raise RunError(
        f"{name}: {' and '.join(still)} {'is' if len(still) == 1 else 'are'} at rest after the release (range below"
        f" {SETTINGS.turn_rad:g} rad), so there is no motion to analyse: {cure}"
    )


def _ranges(values: Array) -> Array:
    """Return the range of each column without the fraction `tail` at either end."""
    return np.ptp(np.quantile(values, [SETTINGS.tail, 1 - SETTINGS.tail], axis=0), axis=0)

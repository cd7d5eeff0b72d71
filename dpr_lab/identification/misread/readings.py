"""Other interpretations of a recording: angles, encoder counts, times, torques and arm."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import log

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.arm_motion import FEWEST, arm_motion
from dpr_lab.estimation.noise import ORDER, difference_std
from dpr_lab.identification.misread.balance import energy_zeros
from dpr_lab.identification.misread.local_motion import shows_a_period
from dpr_lab.identification.misread.moving_arm_balance import ARM_BALANCE, arm_balance
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Angles = Callable[[Array, Array], tuple[Array, Array]]
"""Function from the given angles to (theta1, theta2), rad."""


@dataclass(frozen=True, slots=True)
class Misreading:
    """Alternative interpretation of a recording that corrects one possible mistake in its description."""

    cause: str
    """Description of the mistake, and the option or key of the rig file that corrects it."""
    read: Callable[[Run], Run | None]
    """Function that converts a run to this interpretation; it returns None if the interpretation does not apply."""
    arm: bool = False
    """Whether the arm moves in this interpretation; a compliant arm is then another possible cause."""
    time_factor: float = 1.0
    """Factor on the times in this interpretation."""
    smaller: bool = False
    """Whether the true angles are smaller than the readings.

    The period then hardly depends on the amplitude.
    """


HELD_BY_SPRING = "a spring or cable holds the rod: compare the reading with an angle measured on the rig"
"""Cause of a period that hardly depends on the amplitude, if the scale of the readings is correct."""


def listed_causes(tried: Sequence[Misreading], runs: Sequence[Run]) -> str:
    """List the causes of the given interpretations in words.

    If smaller angles fit a swing without full turns, a spring is listed as another possible cause.
    """
    causes = [reading.cause for reading in tried]
    if any(reading.smaller for reading in tried) and all(_below_upright(run) for run in runs):
        causes.append(HELD_BY_SPRING)
    return ", or ".join(dict.fromkeys(causes))


def _below_upright(run: Run) -> bool:
    return bool(np.all(np.abs(run.theta[:, 1:] - np.pi) < np.pi))


@dataclass(frozen=True, slots=True)
class ZeroSettings:
    """Limits of the zeros and scales that are tested."""

    least_deg: float = 5.0
    """Smallest error of a zero that is tested, degrees. Smaller errors are fitted as an encoder offset."""
    arm_factor: float = 1.1
    """Smallest factor on the angle of a prescribed arm that is tested."""
    alike_deg: float = 2.0
    """Maximum difference between the zeros of two runs that count as equal, degrees."""
    arm_hz: float = 250.0
    """Maximum rate at which the motion of an arm is estimated, Hz; fits of other interpretations use no more."""


ZEROS = ZeroSettings()


def readings(rig: Rig) -> tuple[Misreading, ...]:
    """List all other interpretations to be tested for the runs of a rig."""
    of_encoders = (_AGAINST_ARM, _ONE_SIGN, *_ANGLES, *_scaled(rig))
    # the angles of a video have a known sign and unit
    not_of_films = (_only_if(reading, lambda run: run.film_noise is None) for reading in of_encoders)
    return (*_OF_POINTS_TOO, *not_of_films, *_TIMES, *_TORQUES, _arm(rig))


def arm_scales(runs: Sequence[Run], rig: Rig) -> Iterator[Misreading]:
    """Yield the interpretation with the scale of a prescribed arm that the torque balance indicates.

    The scale is the median of the runs, or the lower of the two middle ones. No interpretation is yielded for a scale
    near 1.
    """
    swings = [run.swing for run in runs if run.arm is not None]
    balances = [arm_balance(swing.t, swing.theta, rig) for swing in swings]
    scales = [
        balance.coupled for balance in balances if balance.residual < ARM_BALANCE.broken and balance.gravity > 0.0
    ]
    factor = float(f"{np.quantile(scales, 0.5, method='lower'):.3g}") if scales else 1.0
    if factor != 0.0 and abs(log(abs(factor))) > log(ZEROS.arm_factor):
        yield Misreading(
            f"the arm turns by {factor:g} times its reading (multiply --scale theta0 by this factor, or correct"
            " counts_per_rev and direction of the arm), or L0 in the rig file has this error",
            partial(_with_arm_times, factor),
        )


def _with_arm_times(factor: float, run: Run) -> Run | None:
    if run.arm is None:
        return None
    theta = run.theta * [factor, 1.0, 1.0]
    return replace(run, theta=theta, arm=arm_motion(run.t, theta[:, 0], run.name), counts=None)


def other_zeros(runs: Sequence[Run], rig: Rig) -> Iterator[Misreading]:
    """Yield interpretations with the zeros of the rods that the energy balance indicates.

    Each free swing gives at most one interpretation.
    """
    tried: list[Array] = []
    for run in (run.swing for run in runs):
        if run.arm is not None or run.torques is not None or run.setup.held or run.mounting != "both":
            continue
        zeros = energy_zeros(run.t, run.theta[:, 1:], rig)
        # adding 0.0 converts -0.0 to 0.0
        added = np.array([round(float(np.degrees(zero)), 1) + 0.0 for zero in zeros or (0.0, 0.0)])
        known = any(np.abs(added - other).max() < ZEROS.alike_deg for other in tried)
        if known or np.abs(added).max() < ZEROS.least_deg:
            continue
        tried.append(added)
        inner, outer = added.tolist()
        cause = (
            f"the angles have other zeros (import with --offset theta1={inner:g},theta2={outer:g}, in degrees; with"
            f" --angles relative, theta2={outer - inner:g}; for a device, correct zero_counts)"
        )
        yield _of_angles(cause, _added(np.radians(inner), np.radians(outer)))


def _added(inner: float, outer: float) -> Angles:
    return lambda first, second: (first + inner, second + outer)


def _of_angles(cause: str, angles: Angles) -> Misreading:
    def read(run: Run) -> Run | None:
        inner, outer = angles(run.theta[:, 1], run.theta[:, 2])
        return replace(run, theta=np.column_stack([run.theta[:, 0], inner, outer]), counts=None)

    return Misreading(cause, read)


def _of_two_rods(cause: str, angles: Angles) -> Misreading:
    """Return an interpretation that combines the angles of two rods.

    The interpretation does not apply to a rod that is mounted alone.
    """
    return _only_if(_of_angles(cause, angles), lambda run: not run.setup.alone)


def _only_if(reading: Misreading, applies: Callable[[Run], bool]) -> Misreading:
    """Restrict an interpretation to the runs to which it applies."""
    return replace(reading, read=lambda run: reading.read(run) if applies(run) else None)


_RELATIVE = (
    'the angles of the outer rod are relative to the inner rod (import with --angles relative, or joint2 = "relative")'
)
_ABSOLUTE = (
    'the angles of the outer rod are relative to the vertical (import with --angles absolute, or joint2 = "absolute")'
)
_DEGREES = "the angles are in degrees (import with --unit deg)"
_EXCHANGED = "inner and outer rod are swapped (exchange the encoders, or import with --columns theta1=NAME,theta2=NAME)"

_OF_POINTS_TOO = (
    _of_angles(
        "the zero of the angles is in the opposite direction (import with the other --zero, or correct zero_counts)",
        lambda inner, outer: (inner + np.pi, outer + np.pi),
    ),
    _of_two_rods(_EXCHANGED, lambda a, b: (b, a)),
    _of_two_rods(
        _EXCHANGED, lambda a, b: (b - a + np.pi, b)
    ),  # for a table whose second angle is relative to the inner rod
)
"""Interpretations of angles that also apply to points in a picture."""

_ONE_SIGN = _of_two_rods(
    "one rod's sign is reversed (import absolute angles with --scale theta2=-1, or correct direction in [encoders])",
    lambda inner, outer: (-inner, outer),
)

_AGAINST_ARM = Misreading(
    "the rods turn in the opposite direction to the arm (import with --scale theta0=-1, or the opposite sign of a"
    " stated scale, or correct direction in [encoders])",
    lambda run: None if run.arm is None else replace(run, theta=run.theta * [1.0, -1.0, -1.0], counts=None),
)

_ANGLES = (
    _of_two_rods(
        "the zero of joint 2 is in the opposite direction (add half a turn to theta2 with --offset, or correct"
        " zero_counts)",
        lambda inner, outer: (inner, outer + np.pi),
    ),
    _of_two_rods(
        "the sign of joint 2 is reversed (import relative angles with --scale theta2=-1, or correct direction in"
        " [encoders])",
        lambda inner, outer: (inner, 2 * inner - outer),
    ),
    _of_two_rods(_RELATIVE, lambda inner, outer: (inner, inner + outer - np.pi)),
    _of_two_rods(_RELATIVE, lambda inner, outer: (inner, inner + outer)),  # for a table in which 0 is upright
    _of_two_rods(_ABSOLUTE, lambda inner, outer: (inner, outer - inner + np.pi)),
    _of_two_rods(_ABSOLUTE, lambda inner, outer: (inner, outer - inner)),
    _of_two_rods(
        "the angles are zero where the rods hang, and the outer angle is relative to the inner rod"
        " (import with --zero hanging --angles relative)",
        lambda inner, outer: (inner + np.pi, inner + outer + np.pi),
    ),
    _of_two_rods(
        "the angles are zero upright, and the outer angle is relative to the vertical"
        " (import with --zero upright --angles absolute)",
        lambda inner, outer: (inner - np.pi, outer - inner),
    ),
    replace(_of_angles(_DEGREES, lambda a, b: (np.radians(a), np.radians(b))), smaller=True),
    # the readings are degrees from hanging
    replace(
        _of_angles(_DEGREES, lambda a, b: (np.pi + np.radians(a - np.pi), np.pi + np.radians(b - np.pi))), smaller=True
    ),
    _of_angles(
        "the angles are in radians (import with --unit rad)",
        lambda a, b: (np.pi + np.degrees(a - np.pi), np.pi + np.degrees(b - np.pi)),
    ),
)


def _scaled(rig: Rig) -> Iterator[Misreading]:
    """Generate interpretations in which the angles from hanging are multiples of the readings.

    The factors correspond to a half, twice and four times the stated counts. They apply to both joints, to one joint,
    or to one rod.
    """
    counts, relative = rig.encoders.counts_per_rev, rig.encoders.joint2 == "relative"
    for factor in (0.5, 2.0, 0.25, 4.0):
        stated = [f"{count / factor:.0f}" for count in counts]
        key = "set counts_per_rev in the rig file to {}, now {}"
        tables = f"import a table of angles with --scale {factor:g}, and with --offset unless they are zero for hanging"
        for_both = key.format(f"{stated[1]} for joint 1 and {stated[2]} for joint 2", f"{counts[1]} and {counts[2]}")
        cause = f"both joints turn by {factor:g} times the reading ({for_both}; {tables})"
        yield replace(_of_two_rods(cause, _times(factor, factor)), smaller=factor < 1)
        for joint in (1, 2):
            for_one = key.format(f"{stated[joint]} for joint {joint}", counts[joint])
            option = f"import a table of joint angles with --scale theta{joint}={factor:g}"
            s1, s2 = (factor, 1.0) if joint == 1 else (1.0, factor)
            cause = f"joint {joint} turns by {factor:g} times the reading ({for_one}; {option})"
            interpretation = _of_angles if joint == 1 else _of_two_rods
            yield replace(interpretation(cause, _times(s1, s2, relative)), smaller=factor < 1)
            if relative:
                rod = f"theta{joint} is {factor:g} times the reading (--scale theta{joint}={factor:g} and --offset)"
                of_rod = replace(_of_two_rods(rod, _times(s1, s2)), smaller=factor < 1)
                yield _only_if(of_rod, lambda run: run.counts is None)


def _times(s1: float, s2: float, relative: bool = False) -> Angles:
    """Return a function that scales the angles of both rods, measured from hanging.

    If `relative` is true, it scales the angles of the joints.
    """

    def angles(inner: Array, outer: Array) -> tuple[Array, Array]:
        first, second = inner - np.pi, outer - np.pi - relative * (inner - np.pi)
        return np.pi + s1 * first, np.pi + s2 * second + relative * s1 * first

    return angles


def _in_time(factor: float) -> Callable[[Run], Run | None]:
    def read(run: Run) -> Run | None:
        return replace(run, t=run.t * factor, rate_hz=run.rate_hz / factor) if run.arm is None else None

    return read


_MANY = {2: "twice", 4: "four times", 8: "eight times"}
_PARTS = {2: "half", 4: "a quarter", 8: "an eighth"}


def _paced(factor: float) -> Misreading:
    """Return an interpretation in which the times are multiplied by a factor.

    An example is a slow-motion video of unknown frame rate.
    """
    if factor > 1:
        fraction = _PARTS[round(factor)]
        cause = f"the swing is {fraction} as fast as its time stamps (import with {fraction} the --rate-hz, or check t)"
    else:
        words = _MANY[round(1 / factor)]
        film = ": is it a video in slow motion?" if factor < 0.5 else ""
        cause = f"the swing is {words} as fast as its time stamps (import with {words} the --rate-hz, or check t{film})"
    paced = Misreading(cause, _in_time(factor), time_factor=factor)
    return _only_if(paced, lambda run: shows_a_period(run.swing.theta[:, 1:]))


_TIMES = (
    Misreading("the times are in milliseconds (import with --time-unit ms)", _in_time(1e-3)),
    Misreading("the times are in microseconds (import with --time-unit us)", _in_time(1e-6)),
    Misreading("the times are in seconds (import with --time-unit s)", _in_time(1e3)),
    *(_paced(factor) for factor in (2, 4, 8)),
    *(_paced(1 / factor) for factor in (2, 4, 8)),
)


def _driven(change: Callable[[Array], Array]) -> Callable[[Run], Run | None]:
    def read(run: Run) -> Run | None:
        return None if run.torques is None else replace(run, torques=change(run.torques), commanded=None)

    return read


TORQUE_FACTORS = {
    "the sign of torque 2 is reversed": (1.0, -1.0),
    "the sign of torque 1 is reversed": (-1.0, 1.0),
    "the signs of both torques are reversed": (-1.0, -1.0),
    "the torques are in mN m": (1e-3, 1e-3),
    "the torques are in N cm": (1e-2, 1e-2),
    "the torques are in kN m": (1e3, 1e3),
}
"""Ratios of the true torques of joints 1 and 2 to the stated ones, by the mistake in their description."""


def _scaled_torques(cause: str, factors: tuple[float, float]) -> Misreading:
    option = ",".join(f"tau{joint}={factor:g}" for joint, factor in enumerate(factors, 1) if factor != 1.0)
    signs = ("", ", or reverse the sign of the drive", ", or reverse the signs of the angles")
    other = signs[sum(factor < 0.0 for factor in factors)]
    return Misreading(f"{cause} (import with --scale {option}{other})", _driven(lambda torques: torques * factors))


_TORQUES = (
    *(_scaled_torques(cause, factors) for cause, factors in TORQUE_FACTORS.items()),
    Misreading(
        "torque 1 and torque 2 are swapped (name their columns: --columns tau1=NAME,tau2=NAME)",
        _driven(lambda torques: torques[:, ::-1]),
    ),
)


def _arm(rig: Rig) -> Misreading:
    length = "" if "L0" in rig.rig.model_fields_set else "; the rig file then needs [rig] L0"
    return Misreading(
        f"the arm moves although it is described as clamped (import with --arm prescribed{length})",
        _with_moving_arm,
        arm=True,
    )


def _with_moving_arm(run: Run) -> Run | None:
    """Return the run with the motion of the arm as measured by its encoder.

    The result is None if the arm did not move or was not measured.
    """
    if run.arm is not None or not arm_turned(run):
        return None
    every = slice(None, None, max(1, round(run.rate_hz / ZEROS.arm_hz)))
    return replace(run, arm=arm_motion(run.t[every], run.theta[every, 0], run.name))


def arm_turned(run: Run, above_noise: float = 20.0) -> bool:
    """Check whether the encoder of the arm shows a motion.

    The result is False if the arm was not measured.

    Args:
        run: the run; its readings of theta0 are constant if the arm was not measured
        above_noise: minimum range of theta0 that counts as motion of the arm, in standard deviations of the readings
    """
    theta0 = run.swing.theta[:, 0]
    if len(theta0) <= max(ORDER, FEWEST) or not np.isfinite(theta0).all():
        return False
    noise = float(difference_std(run.swing.t, theta0[:, None])[0])
    moved = float(np.ptp(theta0))
    return moved > 0.0 and moved >= above_noise * noise

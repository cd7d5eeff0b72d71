"""The ratios to b with their intervals: all of them, and those that the recordings determine."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, Estimate, FreeParameter, alone_share
from dpr_lab.gap.conclusion.uncertainty import by_unseen_ratios
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.state import Advised
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.identification.moving_arm.unknowns import GAINS
from dpr_lab.rig import Rig

Array = NDArray[np.float64]


def ratios(state: Advised) -> dict[str, Interval]:
    """The ratios; those that depend on the bounds of the rig file are not negative."""
    values = state.selection.chosen.fit.estimate.ratios[: len(RATIOS)].tolist()
    reaches = np.array([state.intervals.get(("", name), 0.0) for name in RATIOS])
    unseen = by_unseen_ratios(state.problem, state.selection.chosen, state.recordings.rig)
    reaches = np.hypot(reaches, NORMAL_Q90 * np.sqrt(unseen)).tolist()
    floors = np.where(unseen > 0.0, 0.0, -np.inf).tolist()
    return {
        name: Interval(value=value, interval90=(max(value - reach, floor), value + reach))
        for name, value, reach, floor in zip(RATIOS, values, reaches, floors, strict=True)
    }


def determined(state: Advised) -> tuple[dict[str, Interval], Array]:
    """Ratios that the recordings determine with the mounted rods: to b, or to a if only the inner rod is mounted.

    A ratio of two fitted values moves with both; an unknown that is absolute here is divided by the assumed inertia.

    Returns:
        the ratios, and their (n, n) covariance
    """
    setups, at, rig = state.problem.segments.setups, state.selection.chosen.fit, state.recordings.rig
    alone = all(setup.mounting == "inner" for setup in setups)
    of, places, divisors = {}, list[int](), list[float]()
    for place, parameter in enumerate(at.free):
        if (ratio := ratio_of(parameter, at.estimate, rig, alone=alone)) is not None:
            name, value, per = ratio
            error = state.intervals[parameter.effect, parameter.name] / per
            of[name] = Interval(value=value, interval90=(value - error, value + error))
            places.append(place)
            divisors.append(per)
    return of, state.covariance[np.ix_(places, places)] / np.outer(divisors, divisors)


def ratio_of(parameter: FreeParameter, at: Estimate, rig: Rig, *, alone: bool) -> tuple[str, float, float] | None:
    """A fitted parameter of rods, arm or drive as a ratio to b, or to a if the inner rod is alone.

    Returns:
        its name, its value, and what the parameter was divided by; None for the size of an effect
    """
    unknown, value = at.ratios, parameter.read(at)
    on_elbow, inertia = (float(unknown[ON_ELBOW]), alone_share(unknown)) if alone else (0.0, 1.0)
    scale, letter = float(unknown[SCALE]) * inertia, "a" if alone else "b"
    if parameter.block == "ratios" and parameter.place < len(RATIOS):
        if parameter.name == "e1/b":  # of the rod alone, without what hangs on the elbow of the whole rig
            value -= on_elbow * rig.g / rig.L1
        return f"{parameter.name.partition('/')[0]}/{letter}", value / inertia, inertia
    if parameter.effect == FREE_ARM.name:
        return f"{'A' if parameter.name.startswith('inertia') else 'c0'}/{letter}", value / scale, scale
    if parameter.effect == DRIVE_GAIN.name and rig.motor is not None:
        per = scale / drive_gain(rig).value
        return GAINS[rig.motor.input].format(letter), (1.0 + value) / per, per
    return None


def ratio_covariance(state: Advised) -> NDArray[np.float64]:
    """(5, 5) covariance; zero for ratios that no run determines and that are taken from the rig file."""
    free = state.selection.chosen.fit.free
    mine = {parameter.place: i for i, parameter in enumerate(free) if parameter.block == "ratios"}
    whole = np.zeros((len(RATIOS), len(RATIOS)))
    seen = [i for i in range(len(RATIOS)) if i in mine]
    own = [mine[i] for i in seen]
    whole[np.ix_(seen, seen)] = state.covariance[np.ix_(own, own)]
    return whole

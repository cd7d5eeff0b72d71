"""Residual maps of torque and encoder error, which locate the gap before effects are named.

A map is a torque of a joint, or an error of an encoder, as a function of one coordinate, for example the speed of joint
1. It is a sum of hat functions, fitted to the residual by least squares. Ratios and initial states are projected out of
the responses of the readings, as for any effect. A map therefore contains no part that the ratios can absorb: a torque
over the speed contains no straight line, because this line would be viscous friction. No torque is computed from
differentiated angles. The share of the excess chi2 that a map explains is the largest share of the gap that this
location can cause.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.gap_size import Where
from dpr_lab.gap.screen.sensor_faults import ALL_AXES
from dpr_lab.gap.where.coordinates import Coordinate, FreeFunctions, Kind, free_functions
from dpr_lab.gap.where.discrepancy import DISCREPANCY
from dpr_lab.gap.where.residual_map import MAP, ResidualMap, residual_map
from dpr_lab.shown import percent

CONVINCING = 0.6
"""Minimum share of the excess chi-square that the named location of the gap can explain."""

Maps = Sequence[tuple[Kind, Coordinate]]

MAPS: Maps = (*DISCREPANCY.kinds, ("error", "speed"))
"""Kinds of maps, each with its coordinate."""

SIGNIFICANT = 3.0
"""Minimum significance of a residual that is located or divided, and of a trend of a map, in standard deviations."""


def locate(problem: Problem, bare: Hypothesis) -> tuple[Where, ...]:
    """Return the residual maps of all locations, largest share first.

    The result is empty if the residual is not significant.
    """
    if bare.residuals.z < SIGNIFICANT:
        return ()
    reference = trajectory(problem, bare.estimate, spacing=TRAJECTORY.coarse_s)
    places = [
        _place(problem, bare, reference, free_functions(problem, reference, joint, kind, coordinate))
        for joint, kind, coordinate in _maps(problem)
    ]
    return tuple(sorted(places, key=lambda place: -place.share))


def _maps(problem: Problem) -> Iterator[tuple[int, Kind, Coordinate]]:
    """Yield the axis (0, 1, 2 for joints 1, 2, 0), kind and coordinate of each possible map.

    Without an outer rod, joint 2 has no maps. A torque does not move a prescribed joint 1 or a held joint 2, so these
    joints have only maps of encoder errors.
    """
    setups = problem.segments.setups
    of_errors: Maps = [(kind, coordinate) for kind, coordinate in MAPS if kind == "error"]
    inner = of_errors if all(setup.inner is not None for setup in setups) else MAPS
    outer = of_errors if all(setup.held for setup in setups) else MAPS
    allowed: Sequence[Maps] = (inner, () if all(setup.alone for setup in setups) else outer, MAPS)
    for joint in range(problem.axes):
        for kind, coordinate in allowed[joint]:
            yield joint, kind, coordinate


def where_sentence(places: tuple[Where, ...]) -> str:
    """Return a sentence on the location of the gap, from maps in the order of `locate`."""
    if not places:
        return "No gap in the segments is large enough to be located."
    best = places[0]
    if best.share < CONVINCING:
        return (
            f"No single location explains the gap. The best location, {best.site} by {best.coordinate},"
            f" explains {percent(best.share)} of the excess."
        )
    return best.sentence


def _place(problem: Problem, bare: Hypothesis, reference: Trajectory, free: FreeFunctions) -> Where:
    """Fit a residual map together with ratios and initial states, and describe it."""
    columns = bare.fit.linear.projected(np.nan_to_num(free.readings(problem, reference), posinf=0.0, neginf=0.0))
    fitted = residual_map(bare.fit.linear, range(len(bare.fit.free)), columns, free.knots)
    share = float(np.clip((fitted.gain - len(fitted.e)) / bare.residuals.excess, 0.0, 1.0))
    site = ALL_AXES[free.joint].replace("joint", "encoder") if free.kind == "error" else ALL_AXES[free.joint]
    cause = {"torque": "A torque in", "friction": "Friction of", "error": "An error of"}[free.kind]
    shape = _shape(fitted, free, SIGNIFICANT * bare.inflation**0.5)
    return Where(
        site=site,
        coordinate=free.coordinate,
        share=share,
        sentence=f"{cause} {site} that depends on {free.coordinate}, {shape}, could explain {percent(share)} of the"
        " excess.",
        knots=fitted.knots.tolist(),
        values=fitted.values.tolist(),
        std=(bare.inflation**0.5 * fitted.std).tolist(),
        unit=free.unit,
    )


def _shape(fitted: ResidualMap, free: FreeFunctions, least: float) -> str:
    """Describe a residual map in words; trends smaller than `least` standard deviations are not named."""
    x = fitted.knots
    match free.coordinate:
        case "speed":
            equal = np.isclose(np.abs(x)[:, None], np.abs(x)).astype(np.float64)
            even, odd = fitted.gain_of(equal), fitted.gain_of(np.sign(x)[:, None] * equal)
            if max(even, odd) < MAP.mostly * fitted.gain:
                return "different in the two directions"
            if np.ptp(np.sign(x)) < 2.0:
                return "measured in one direction only"
            if even > odd:
                return "equal in both directions"
            trend = 0.0 if free.kind == "error" else fitted.trend(np.sign(x))
            if abs(trend) < least:
                return "opposite in both directions"
            braking = "more than viscous friction at high speed" if trend > 0 else "most at low speed"
            return f"opposite in both directions, braking {braking}"
        case "angle":
            slow = fitted.gain_of(np.stack([np.ones_like(x), np.cos(x), np.sin(x)], axis=1))
            return "once per turn or slower" if slow >= MAP.mostly * fitted.gain else "several times per turn"
        case "time":
            trend = fitted.trend(x - x.sum() / max(len(x), 1))
            if abs(trend) < least:
                return "without a trend"
            return f"{'increasing' if trend > 0 else 'decreasing'} with time"

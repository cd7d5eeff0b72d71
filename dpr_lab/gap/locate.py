"""Where the gap lies, before anything is named: maps of torque and of encoder error by generalised least squares.

Each map is a sum of hat functions of one coordinate, say the speed of joint 1, times a torque there or an error of that
encoder. What a map does to the readings is projected free of ratios and start states, as for any effect, so no torque
is ever taken from differentiated angles. A map's share of the excess chi2 says how much of the gap can lie there.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.response import Course, course

Array = NDArray[np.float64]

BINS = 10
CONVINCING = 0.6
"""Share of the excess from which a place is said to explain the gap."""
WORTH_SAYING = 3.0  # standard deviations of the remainder below which there is nothing to locate
_Z90 = 1.645


@dataclass(frozen=True, slots=True)
class Place:
    """One map."""

    site: str
    """joint1, joint2, encoder1 or encoder2."""
    coordinate: str
    """angle, speed, time or load."""
    share: float
    """Of the excess chi2 that the map explains, 0 to 1."""
    knots: Array
    """(k,) where the hats stand, SI."""
    values: Array
    """(k,) torque N m, friction N m s/rad over time, friction radius m over load, or encoder error rad."""
    std: Array
    """(k,)"""
    unit: str
    sentence: str


def locate(problem: Problem, base: Hypothesis) -> tuple[Place, ...]:
    """All maps, the one that explains most first; empty where there is no gap to locate."""
    if base.remainder.z < WORTH_SAYING:
        return ()
    along = course(problem, base.fit.point)
    known = base.fit.linear.A.reshape(-1, base.fit.linear.A.shape[2])
    known = np.linalg.qr(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300))[0]
    places = [
        _place(problem, base, known, along, joint, coordinate, make)
        for joint in (0, 1)
        for coordinate, make in MAPS.items()
    ]
    return tuple(sorted(places, key=lambda place: -place.share))


def where_sentence(places: tuple[Place, ...]) -> str:
    """One sentence on where the gap lies."""
    if not places:
        return "There is no gap to locate."
    best = places[0]
    if best.share < CONVINCING:
        return (
            f"No single place explains the gap: the best, {best.site} by {best.coordinate}, explains {best.share:.0%}."
        )
    return best.sentence


@dataclass(frozen=True, slots=True)
class _Columns:
    readings: Array
    """(samples, 2, k)"""
    knots: Array
    unit: str


def _hats(x: Array, knots: Array) -> Array:
    """(n, k) piecewise linear functions that sum to one."""
    place = np.clip(np.interp(x, knots, np.arange(len(knots))), 0, len(knots) - 1 - 1e-9)
    lower = place.astype(int)
    hats = np.zeros((len(x), len(knots)))
    hats[np.arange(len(x)), lower] = 1 - (place - lower)
    hats[np.arange(len(x)), lower + 1] = place - lower
    return hats


def _round_hats(angle: Array) -> tuple[Array, Array]:
    """(n, k) hats around the circle, and their knots."""
    knots = np.linspace(-math.pi, math.pi, BINS + 1)
    hats = _hats((angle + math.pi) % (2 * math.pi) - math.pi, knots)
    hats[:, 0] += hats[:, -1]
    return hats[:, :-1], knots[:-1]


def _speed_hats(speed: Array) -> tuple[Array, Array]:
    """(n, k) hats over signed roots of the speed, closer together where dry friction lives."""
    top = max(float(np.quantile(np.abs(speed), 0.99)), 1e-3)
    roots = np.linspace(-1, 1, BINS)
    knots = np.sign(roots) * roots**2 * top
    return _hats(speed, knots), knots


def _torque(along: Course, joint: int, torque: Array) -> Array:
    """(samples, 2, k) readings under joint torques (n, k)."""
    pair = np.stack([torque, np.zeros_like(torque)] if joint == 0 else [-torque, torque], axis=1)
    return along.readings(np.ascontiguousarray(pair))


def _torque_by_angle(problem: Problem, along: Course, joint: int) -> _Columns:
    hats, knots = _round_hats(along.joint_angle[:, joint])
    return _Columns(_torque(along, joint, hats), knots, "N m")


def _torque_by_speed(problem: Problem, along: Course, joint: int) -> _Columns:
    hats, knots = _speed_hats(along.joint_speed[:, joint])
    return _Columns(_torque(along, joint, hats), knots, "N m")


def _friction_by_time(problem: Problem, along: Course, joint: int) -> _Columns:
    knots = np.linspace(0, float(along.t.max()), BINS)
    return _Columns(
        _torque(along, joint, -_hats(along.t, knots) * along.joint_speed[:, joint, None]), knots, "N m s/rad"
    )


def _friction_by_load(problem: Problem, along: Course, joint: int) -> _Columns:
    force = _joint_force(problem, along, joint)
    knots = np.quantile(force, np.linspace(0.01, 0.99, 5))
    slides = np.tanh(along.joint_speed[:, joint] / 0.02)
    return _Columns(_torque(along, joint, -_hats(force, knots) * (force * slides)[:, None]), knots, "m")


def _error_by_angle(problem: Problem, along: Course, joint: int) -> _Columns:
    turned = problem.measured[:, joint] - (math.pi if joint == 0 or not problem.relative else 0.0)
    hats, knots = _round_hats(turned)
    return _Columns(_read(hats, joint), knots, "rad")


def _error_by_speed(problem: Problem, along: Course, joint: int) -> _Columns:
    speed = np.interp(along.at, np.arange(len(along.t)), along.joint_speed[:, joint])
    hats, knots = _speed_hats(speed)
    return _Columns(_read(hats, joint), knots, "rad")


def _read(hats: Array, joint: int) -> Array:
    readings = np.zeros((len(hats), 2, hats.shape[1]))
    readings[:, joint] = hats
    return readings


MAPS: Mapping[str, Callable[[Problem, Course, int], _Columns]] = {
    "torque by angle": _torque_by_angle,
    "torque by speed": _torque_by_speed,
    "friction by time": _friction_by_time,
    "friction by load": _friction_by_load,
    "error by angle": _error_by_angle,
    "error by speed": _error_by_speed,
}
"""Every map that is drawn of each joint."""


def _joint_force(problem: Problem, along: Course, joint: int) -> Array:
    """(n,) force that a joint carries, N, from masses times accelerations of equation (1)."""
    known, sin, cos = problem.known, np.sin(along.theta), np.cos(along.theta)
    across = cos * along.alpha - sin * along.omega**2
    up = -sin * along.alpha - cos * along.omega**2
    inner, outer = along.base[3] / known.g, along.base[2] / known.L1
    if joint == 0:
        weight = (known.m1 + known.m2 + known.mb) * known.g
        lengths = np.array([inner, outer])
    else:
        weight = known.m2 * known.g
        lengths = np.array([known.m2 * known.L1, outer])
    return np.hypot(across @ lengths, up @ lengths + weight)


def _place(
    problem: Problem,
    base: Hypothesis,
    known: Array,
    along: Course,
    joint: int,
    name: str,
    make: Callable[[Problem, Course, int], _Columns],
) -> Place:
    made = make(problem, along, joint)
    linear = base.fit.linear
    columns = problem.whitened(made.readings)
    columns -= linear.Q @ (linear.Q.transpose(0, 2, 1) @ columns)
    flat = columns.reshape(-1, columns.shape[2])
    flat = flat - known @ (known.T @ flat)
    scale = 1 / np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    G = (flat * scale).T @ (flat * scale) + 1e-6 * np.eye(len(scale))
    gradient = (flat * scale).T @ linear.e.ravel()
    inverse = np.linalg.inv(G)
    values = inverse @ gradient * scale
    std = np.sqrt(np.diag(inverse) * base.remainder.inflation) * scale
    share = float(np.clip((gradient @ inverse @ gradient - len(scale)) / base.remainder.excess, 0.0, 1.0))
    kind, coordinate = name.split(" by ")
    site = f"{'encoder' if kind == 'error' else 'joint'}{joint + 1}"
    sentence = _sentence(site, kind, coordinate, share, made.knots, values, std)
    return Place(site, coordinate, share, made.knots, values, std, made.unit, sentence)


def _sentence(site: str, kind: str, coordinate: str, share: float, knots: Array, values: Array, std: Array) -> str:
    """What a map looks like, in words."""
    where = {"torque": f"a torque in {site}", "friction": f"friction of {site}", "error": f"an error of {site}"}[kind]
    said = [f"{share:.0%} of the excess can lie in {where} that depends on {coordinate}"]
    if coordinate == "speed":
        said.append(_speed_shape(knots, values, std))
    elif coordinate == "angle":
        said.append("once per turn or slower" if _smooth(values) else "several times per turn")
    elif coordinate == "time":
        drift = values[-3:].mean() - values[:3].mean()
        said.append("growing with time" if drift > 0 else "falling with time")
    return ", ".join(said) + "."


def _speed_shape(knots: Array, values: Array, std: Array) -> str:
    # Viscous friction is projected out, so only what departs from a straight line is seen.
    odd, even = 0.5 * (values - values[::-1]), 0.5 * (values + values[::-1])
    weight = np.maximum(std, 1e-150) ** -2.0
    if np.sum(weight * even**2) > np.sum(weight * odd**2):
        return "alike in both directions"
    slowest = int(np.argmin(np.where(knots > 0, knots, np.inf)))
    if odd[slowest] < 0:
        return "opposite in both directions, braking most at low speed"
    return "opposite in both directions, braking more than viscous friction at high speed"


def _smooth(values: Array) -> bool:
    spectrum = np.abs(np.fft.rfft(values - values.mean()))
    return bool(spectrum[1:3].sum() >= spectrum[3:].sum())

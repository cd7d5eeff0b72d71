"""Situations of rigs whose cause is outside the library, simulated by `scipy.integrate.solve_ivp`."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

G, SMOOTH = 9.81, 0.02
"""Gravity, m/s^2, and the speed below which Coulomb friction is smoothed, rad/s."""
BACKGROUND = (
    *("coulomb", "stribeck", "friction_curve", "hysteresis"),
    *("encoder_offset", "base_tilt", "com_offset_link1"),
)
"""Effects of every rig of this benchmark: Coulomb friction and its richer forms, the zero error and its equals."""
OF_ANGLE = ("spring", "detent", "torque_offset")
"""Torques that depend on the angle."""
HARMONICS = ("encoder_eccentricity", "encoder_scale")
"""Errors of the reading that depend on the angle."""

Angles = NDArray[np.float64]
Torque = Callable[[float, float, float], float]
"""Torque of joint 1 over its inertia as a function of time, angle from hanging and speed, rad/s^2."""


@dataclass(frozen=True, slots=True)
class Plant:
    """One rod or bob, or two rods, and one release of it."""

    length: float
    """Length of the rod or string; of both rods of a double pendulum, m."""
    w2: float
    """Squared angular frequency of a small swing of the single rod, 1/s^2."""
    viscous: float
    """Viscous friction over inertia, 1/s."""
    coulomb: float
    """Coulomb friction over inertia, rad/s^2."""
    start: float
    """Angle of the release, rad."""
    t: Angles
    """Times of the readings, s."""


def solved(slope: Callable[[float, Angles], list[float]], begin: Sequence[float], t: Angles) -> Angles:
    """Integrate to the times of the readings: (states, n)."""
    return solve_ivp(slope, (0.0, float(t[-1])), begin, "LSODA", rtol=1e-8, atol=1e-9, max_step=0.05, t_eval=t).y


def swing(plant: Plant, torque: Torque = lambda t, q, u: 0.0) -> Angles:
    """Simulate the angle of a single rod from hanging, with a further torque."""

    def slope(t: float, x: Angles) -> list[float]:
        q, u = x.tolist()
        lost = plant.viscous * u + plant.coulomb * math.tanh(u / SMOOTH)
        return [u, -plant.w2 * math.sin(q) - lost + torque(t, q, u)]

    return solved(slope, [plant.start, 0.0], plant.t)[0]


def double_swing(plant: Plant, torque: Torque = lambda t, q, u: 0.0) -> Angles:
    """Simulate the angles (n, 2) of two equal uniform rods from hanging, with a further torque on the inner rod."""
    k = 1.5 * G / plant.length

    def slope(t: float, x: Angles) -> list[float]:
        q1, q2, u1, u2 = x.tolist()
        mass = np.array([[4.0, 1.5 * math.cos(q1 - q2)], [1.5 * math.cos(q1 - q2), 1.0]])  # in m L^2 / 3
        lost = [plant.viscous * u + plant.coulomb * math.tanh(u / SMOOTH) for u in (u1, u2 - u1)]
        s = 1.5 * math.sin(q1 - q2)
        first = -s * u2**2 - 3 * k * math.sin(q1) - lost[0] + lost[1] + torque(t, q1, u1)
        second = s * u1**2 - k * math.sin(q2) - lost[1]
        return [u1, u2, *np.linalg.solve(mass, [first, second]).tolist()]

    return solved(slope, [plant.start, 0.8 * plant.start, 0.0, 0.0], plant.t)[:2].T


def steps(rng: np.random.Generator, seconds: float, size: float) -> Callable[[float], float]:
    """Draw a function of time that changes to a random value every 0.3 to 1.5 s."""
    times = np.cumsum(rng.uniform(0.3, 1.5, 60))
    values = size * rng.uniform(-1, 1, 61)
    return lambda t: float(values[np.searchsorted(times, t)])


def hand(rng: np.random.Generator, plant: Plant) -> Torque:
    """Draw a hand that holds the rod softly for a short time."""
    begin = float(rng.uniform(0.2, 0.7)) * float(plant.t[-1])
    end, at, stiff = begin + float(rng.uniform(0.15, 0.8)), float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.5, 3))
    return lambda t, q, u: -plant.w2 * stiff * (q - at) - 3.0 * u if begin < t < end else 0.0


def peg(plant: Plant, rng: np.random.Generator) -> Angles:
    """Let the string meet a peg below the pivot; a film shows the bob."""
    rest = plant.length * float(rng.uniform(0.4, 0.8))
    return peg_swing(plant, rest, float(rng.uniform(-0.1, 0.25)))


def peg_swing(plant: Plant, rest: float, side: float) -> Angles:
    """Simulate a bob whose string has the length `rest` beyond the angle `side`, on the side of the release."""
    long, sign = plant.length, math.copysign(1.0, plant.start)
    edge = side * long

    def slope(t: float, x: Angles) -> list[float]:
        way, v = x.tolist()  # along the path of the bob
        q = way / long if way < edge else side + (way - edge) / rest
        lost = plant.viscous * v + plant.coulomb * long * math.tanh(v / long / SMOOTH)
        return [v, -G * math.sin(q) - lost]

    way = solved(slope, [edge + (abs(plant.start) - side) * rest, 0.0], plant.t)[0]
    q = np.where(way < edge, way / long, side + (way - edge) / rest)
    drop = np.where(way < edge, 0.0, long - rest)
    x, y = drop * math.sin(side) + (long - drop) * np.sin(q), drop * math.cos(side) + (long - drop) * np.cos(q)
    return sign * np.arctan2(x, y)


def motor(plant: Plant, rng: np.random.Generator) -> Angles:
    """Turn the rod by a motor whose torque changes in steps and is not in the table."""
    drive = steps(rng, float(plant.t[-1]), plant.w2 * float(rng.uniform(0.03, 0.2)))
    return swing(plant, lambda t, q, u: drive(t))


def controller(plant: Plant, rng: np.random.Generator) -> Angles:
    """Move the rod by a position controller whose target changes in steps."""
    target, gain = steps(rng, float(plant.t[-1]), 0.8), plant.w2 * float(rng.uniform(0.1, 1.0))
    return swing(plant, lambda t, q, u: gain * (target(t) - q) - 0.1 * math.sqrt(gain) * u)


def unequal_scales(plant: Plant, rng: np.random.Generator) -> Angles:
    """Compute the angle from coordinates with different scales of x and y."""
    q, ratio = swing(plant), float(rng.choice([1 / 1.5, 1 / 1.1, 1.05, 1.2, 1.7]))
    return np.arctan2(ratio * np.sin(q), np.cos(q))


def wrong_pivot(plant: Plant, rng: np.random.Generator) -> Angles:
    """Compute the angle about a point some centimetres from the pivot."""
    q, (x, y) = swing(plant), rng.normal(0, 0.03, 2) / plant.length
    return np.unwrap(np.arctan2(np.sin(q) - x, np.cos(q) - y))


def moving_camera(plant: Plant, rng: np.random.Generator) -> Angles:
    """Film with a camera that rolls slowly, and sways."""
    hz, size, drift = float(rng.uniform(0.15, 1.5)), float(rng.uniform(0.01, 0.06)), float(rng.normal(0, 0.01))
    return swing(plant) + size * np.sin(2 * np.pi * hz * plant.t + float(rng.uniform(0, 6))) + drift * plant.t


def perspective(plant: Plant, rng: np.random.Generator) -> Angles:
    """Film with a camera that looks at the plane of the swing obliquely, from a short distance."""
    q, (turn, nod), far = swing(plant), rng.uniform(-0.5, 0.5, 2), float(rng.uniform(2, 6))
    x, y = np.sin(q), np.cos(q)
    depth = 1 + (x * math.sin(turn) + y * math.sin(nod)) / far
    return np.arctan2(x * math.cos(turn) / depth, y * math.cos(nod) / depth)


def wrong_scale(plant: Plant, rng: np.random.Generator) -> Angles:
    """Convert the readings of a sensor with a wrong factor."""
    return swing(plant) * float(rng.choice([0.8, 0.9, 0.95, 1.06, 1.15, 1.25]))


def flexible(plant: Plant, rng: np.random.Generator) -> Angles:
    """Bend the rod: its outer half turns against a stiff spring, and the encoder is at the pivot."""
    stiff, damping, part = (2 * np.pi * float(rng.uniform(1.5, 6))) ** 2, float(rng.uniform(0.1, 1)), 0.7

    def slope(t: float, x: Angles) -> list[float]:
        q, r, u, v = x.tolist()
        bend = stiff * (r - q) + damping * (v - u)
        lost = plant.viscous * u + plant.coulomb * math.tanh(u / SMOOTH)
        return [u, v, -plant.w2 * math.sin(q) + part * bend - lost, -plant.w2 * math.sin(r) - bend * (1 - part)]

    return solved(slope, [plant.start, plant.start, 0.0, 0.0], plant.t)[0]


def loose_bolt(plant: Plant, rng: np.random.Generator) -> Angles:
    """Read the angle of a shaft that the rod turns with a play."""
    play, read = float(rng.uniform(0.01, 0.05)), [plant.start]
    for q in swing(plant):
        read.append(min(max(read[-1], q - play), q + play))
    return np.array(read[1:])


def slack(plant: Plant, rng: np.random.Generator) -> Angles:
    """Release a bob on a string above the pivot: it falls until the string is tight, and loses its radial speed."""
    L, start = plant.length, float(rng.uniform(1.7, 2.3))

    def slope(t: float, x: Angles) -> list[float]:
        r, v = x[:2], x[2:]
        over = float(np.hypot(*r)) - L
        pull = (2e4 * over + 60.0 * max(float(r @ v) / L, 0.0)) if over > 0 else 0.0
        return [*v, *(np.array([0.0, -G]) - pull * r / np.hypot(*r) - plant.viscous * v)]

    begin = [L * math.sin(start), -L * math.cos(start), 0.0, 0.0]
    x, y = solve_ivp(slope, (0, plant.t[-1]), begin, "LSODA", rtol=1e-6, max_step=0.01, t_eval=plant.t).y[:2]
    return np.unwrap(np.arctan2(x, -y))


def sensor_jump(plant: Plant, rng: np.random.Generator) -> Angles:
    """Read a sensor with a periodic error that jumps once per period."""
    q, order, size = swing(plant), int(rng.integers(1, 9)), float(rng.uniform(0.01, 0.05))
    return q + size * (((order * q + float(rng.uniform(0, 6))) / np.pi) % 2 - 1)


def two_swings(plant: Plant, rng: np.random.Generator) -> Angles:
    """Join two releases in one table, without the rows between them."""
    n = int(len(plant.t) * rng.uniform(0.3, 0.7))
    again = replace(plant, start=plant.start * float(rng.uniform(0.4, 0.9)))
    return np.concatenate([swing(plant)[:n], swing(again)[: len(plant.t) - n]])


def magnet(plant: Plant, rng: np.random.Generator) -> Angles:
    """Attract or repel the bob by a magnet near its path."""
    at, width, size = float(rng.uniform(-0.4, 0.4)), float(rng.uniform(0.1, 0.3)), float(rng.choice([-1, 1]))
    size *= plant.w2 * float(rng.uniform(0.05, 0.3))
    return swing(plant, lambda t, q, u: -size * (q - at) / width / (1 + ((q - at) / width) ** 2) ** 2.5)


def soft_stop(plant: Plant, rng: np.random.Generator) -> Angles:
    """Let a cushion stop the rod on the side opposite to the release."""
    sign, at, stiff = (
        -math.copysign(1.0, plant.start),
        float(rng.uniform(0.1, 0.5)),
        plant.w2 * float(rng.uniform(2, 20)),
    )
    return swing(plant, lambda t, q, u: -stiff * (q - sign * at) - 1.0 * u if sign * q > at else 0.0)


def ellipse(plant: Plant, rng: np.random.Generator) -> Angles:
    """Swing a bob on a string along an ellipse, of which a film shows one angle."""
    across = float(rng.uniform(0.1, 0.5)) * plant.start

    def slope(t: float, x: Angles) -> list[float]:
        r, v = x[:3], x[3:]
        force = np.array([0.0, 0.0, -G]) - plant.viscous * v
        along = (force @ r + v @ v) / (r @ r)
        return [*v, *(force - along * r)]

    L = plant.length
    begin = [L * math.sin(plant.start), 0.0, -L * math.cos(plant.start), 0.0, L * across * math.sqrt(plant.w2), 0.0]
    x, _, z = solved(slope, begin, plant.t)[:3]
    return np.arctan2(x, -z)


def double_hand(plant: Plant, rng: np.random.Generator) -> Angles:
    """Touch the inner rod of a double pendulum for a short time."""
    return double_swing(plant, hand(rng, plant))


@dataclass(frozen=True, slots=True)
class Situation:
    """Situation of a rig, with the effects that are correct besides those of `BACKGROUND`."""

    angles: Callable[[Plant, np.random.Generator], Angles]
    """Simulates the angles from hanging, without the errors of the sensor."""
    correct: tuple[str, ...] = ()
    """Beginnings of the names of correct effects."""
    kind: str = "rod"
    """`rod`, `bob` on a string, or `double` pendulum."""
    film: bool = False
    """Whether the angles are those of a film."""
    rounded: bool = False
    """Whether the rig file contains lengths rounded to 5 cm."""


SITUATIONS = {
    "plain": Situation(lambda plant, rng: swing(plant)),
    "peg": Situation(peg, kind="bob", film=True),
    "hand": Situation(lambda plant, rng: swing(plant, hand(rng, plant))),
    "motor": Situation(motor),
    "controller": Situation(controller, ("spring", "torque_offset")),
    "unequal scales": Situation(unequal_scales, HARMONICS, film=True),
    "wrong pivot": Situation(wrong_pivot, HARMONICS, film=True),
    "moving camera": Situation(moving_camera, ("encoder_drift",), kind="bob", film=True),
    "perspective": Situation(perspective, HARMONICS, kind="bob", film=True),
    "wrong scale": Situation(wrong_scale, ("encoder_scale",)),
    "flexible rod": Situation(flexible, ("arm_compliance",)),
    "loose bolt": Situation(loose_bolt, ("backlash",)),
    "slack string": Situation(slack, kind="bob", film=True),
    "sensor jump": Situation(sensor_jump, HARMONICS),
    "two swings": Situation(two_swings),
    "magnet": Situation(magnet, OF_ANGLE),
    "soft stop": Situation(soft_stop, OF_ANGLE),
    "ellipse": Situation(ellipse, kind="bob", film=True),
    "rounded length": Situation(lambda p, rng: double_swing(p), ("wrong_length_L1",), kind="double", rounded=True),
    "double hand": Situation(double_hand, kind="double"),
}

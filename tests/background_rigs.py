"""Rods with one dominant effect and several small ones, by scipy: shares no code with what it tests.

The laws are torques of the joints or errors of the readings, each with a size and some shape that chance draws. Some of
them are in no library: friction by a power of the speed, torque of the third harmonic of an angle, wandering torques.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.rig import MASSES, PARAMETERS, Rig, load_rig
from dpr_lab.run import Run
from tests.faulty_loggers import log

SMOOTH = 0.02
"""Speed below which the Coulomb friction of these rods is smoothed, rad/s."""
TORQUES_NM = (1e-3, 1e-4)
"""Torques of joints 1 and 2 that move a reading by about the noise within half a second, N m."""
READING_RAD = 4e-4
"""Reading error of about the noise, rad."""
DOMINANT, SMALL = (3.0, 10.0), (0.1, 0.6)
"""Sizes of the dominant effect and of the others, in those units."""

Torque = Callable[[float, float, float], float]
"""Torque of a joint as a function of time, its angle from hanging and its speed, N m."""


@dataclass(frozen=True)
class Law:
    """Simulated effect with its size."""

    name: str
    joint: int
    size: float
    """Size of the effect, N m or rad."""
    torque: Torque | None = None
    reading: Callable[[Any, Any], Any] | None = None
    """Error of an encoder as a function of its angles and speeds, rad."""


def _law(name: str, joint: int, size: float, rng: np.random.Generator) -> Law:
    phase, label = float(rng.uniform(0, 2 * np.pi)), f"{name}_joint{joint + 1}"
    n, top = size * TORQUES_NM[joint], 8.0
    rates, phases = rng.uniform(1, 12, 6), rng.uniform(0, 2 * np.pi, 6)
    torques: dict[str, Torque] = {
        "coulomb": lambda t, q, u: -n * math.tanh(u / SMOOTH),
        "spring": lambda t, q, u: -n * q,
        "detent": lambda t, q, u: 2 * n * math.cos(12 * q + phase),
        "power": lambda t, q, u: -2 * n * abs(u / top) ** 1.5 * math.copysign(1.0, u),
        "third": lambda t, q, u: n * math.sin(3 * q + phase),
        "one_sided": lambda t, q, u: -n * (math.tanh(u / SMOOTH) > 0) * (1 + math.cos(q)),
        "wander": lambda t, q, u: n * sum(math.sin(w * t + p) for w, p in zip(rates, phases, strict=True)),
    }
    if name in torques:
        return Law(label, joint, n, torques[name])
    n = size * READING_RAD
    readings = {
        "encoder_eccentricity": lambda q, u: n * np.cos(q + phase),
        "encoder_offset": lambda q, u: np.full_like(q, n),
        "encoder_scale": lambda q, u: 0.3 * n * q,
        "fifth": lambda q, u: n * np.cos(5 * q + phase),
    }
    return Law(label, joint, n, None, readings[name])


@dataclass(frozen=True)
class Mount:
    """Second vibration mode of the mount: horizontal, lightly damped."""

    stiffness: float
    """Stiffness, N/m."""
    frequency: float
    """Natural frequency, rad/s."""
    damping: float
    """Damping ratio."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Mount":
        """Draw a mount that moves the rods by less than the noise."""
        stiffness = float(np.exp(rng.uniform(math.log(1e5), math.log(5e5))))
        return cls(stiffness, 2 * math.pi * float(rng.uniform(15.0, 40.0)), float(rng.uniform(0.02, 0.05)))

    def acceleration(self, x: float, v: float, force: float) -> float:
        """Acceleration of the mount from its displacement, its speed and the force of the rods, SI units."""
        return self.frequency**2 * (force / self.stiffness - x) - 2 * self.damping * self.frequency * v


NAMED = ("coulomb", "spring", "detent", "encoder_eccentricity", "encoder_offset", "encoder_scale")
"""Simulated effects that the library contains."""
OTHERS = ("power", "third", "one_sided", "wander", "fifth")
"""Simulated effects that the library does not contain, or contains in another form."""


def laws(rng: np.random.Generator, *, rods: int = 2, dominant: bool = True) -> list[Law]:
    """Draw the dominant effect, then three to six small effects."""
    result = [_law(str(rng.choice(NAMED)), int(rng.integers(rods)), float(rng.uniform(*DOMINANT)), rng)] * dominant
    for _ in range(int(rng.integers(3, 7))):
        name = str(rng.choice(NAMED + OTHERS))
        result.append(_law(name, int(rng.integers(rods)), float(rng.uniform(*SMALL)), rng))
    return result


def law(name: str, joint: int, size: float, seed: int = 0) -> Law:
    """Draw an effect with a size in multiples of the noise."""
    return _law(name, joint, size, np.random.default_rng(seed))


def rig_and_base(rng: np.random.Generator, rods: int = 2) -> tuple[Rig, np.ndarray]:
    """Draw a rig file with measured masses and other values with errors of up to 10 %, and the true base parameters."""
    paper = load_rig("paper")
    true = paper.nominal * rng.uniform(0.9, 1.1, len(PARAMETERS))
    described = paper.model_dump(exclude_none=True)
    for name, value in zip(PARAMETERS, true.tolist(), strict=True):
        if name in MASSES:
            described["parameters"][name].update(measured=value, std=1e-3 * value)
    rig = Rig.model_validate(described)
    return rig.with_rods("inner") if rods == 1 else rig, base_parameters(true, rig.L1, rig.g)


def swing(
    base: Any, rig: Rig, acting: Sequence[Law], start: Any, t: Any, rods: int, mount: Mount | None = None
) -> np.ndarray:
    """Simulate angles from upright and speeds (n, 4)."""
    a, b, d, e1, c1, c2 = base
    moments = e1 / rig.g, (d / rig.L1 if rods == 2 else 0.0)
    torques = [(one.joint, one.torque) for one in acting if one.torque]

    def on_mount(now: float, x: Any) -> list[float]:
        """Simulate rods on a mount.

        The rods' motion on a rigid mount drives it, and its acceleration acts on the rods.
        """
        th1, th2, w1, w2, *moved = x.tolist()
        rigid = slope(now, x)
        turned = zip(moments, (th1, th2), (w1, w2), rigid[2:], strict=True)
        force = -sum(S * (math.cos(q) * alpha - math.sin(q) * w * w) for S, q, w, alpha in turned)
        pushed = mount.acceleration(moved[0], moved[1], force) if mount else 0.0
        return [*slope(now, x, pushed), moved[1], pushed]

    def slope(now: float, x: Any, pushed: float = 0.0) -> list[float]:
        th1, th2, w1, w2 = x[:4].tolist()
        q, u, tau = (th1 - math.pi, th2 - th1), (w1, w2 - w1), [-c1 * w1, -c2 * (w2 - w1)]
        for joint, torque in torques:
            tau[joint] += torque(now, q[joint], u[joint])
        if rods == 1:
            acceleration = (e1 * math.sin(th1) - moments[0] * pushed * math.cos(th1) + tau[0]) / a
            return [w1, w1, acceleration, acceleration]
        c, s = d * math.cos(th1 - th2), d * math.sin(th1 - th2)
        f1 = -s * w2**2 + e1 * math.sin(th1) - moments[0] * pushed * math.cos(th1) + tau[0] - tau[1]
        f2 = s * w1**2 + d * rig.g / rig.L1 * math.sin(th2) - moments[1] * pushed * math.cos(th2) + tau[1]
        det = a * b - c * c
        return [w1, w2, (b * f1 - c * f2) / det, (a * f2 - c * f1) / det]

    law, begin = (slope, np.asarray(start)) if mount is None else (on_mount, np.append(start, [0.0, 0.0]))
    solved = solve_ivp(law, (0.0, float(t[-1])), begin, "DOP853", rtol=1e-8, atol=1e-9, t_eval=t)
    return solved.y.T[:, :4]


def record(
    rig: Rig,
    base: Any,
    acting: Sequence[Law],
    rng: np.random.Generator,
    pose: str,
    seconds: float = 6.0,
    rods: int = 2,
    *,
    rate_hz: float = 200.0,
    logger: str = "",
    mount: Mount | None = None,
) -> Run:
    """Record a release by hand in counts, by a logger with or without a fault of `tests.faulty_loggers`."""
    even = np.arange(-round(rate_hz), round(rate_hz * seconds) + 1) / rate_hz
    logged = log(logger, even, 1 / rate_hz, rng)
    order = np.argsort(logged.taken, kind="stable")
    t = logged.taken[order]
    poses = rig.poses[pose].theta[1:]
    start = np.append(poses, [0.0, 0.0]) + rng.normal(0, [0.01, 0.01, 0.002, 0.002])
    if rods == 1:
        start[1], start[3] = start[0], start[2]
    x = np.tile(start, (len(t), 1))
    x[t < 0, 2:] = 0.0
    x[t >= 0] = swing(base, rig, acting, start, t[t >= 0], rods, mount)
    joints, speeds = np.stack([x[:, 0] - np.pi, x[:, 1] - x[:, 0]]), np.stack([x[:, 2], x[:, 3] - x[:, 2]])
    for one in acting:
        if one.reading:
            joints[one.joint] = joints[one.joint] + one.reading(joints[one.joint], speeds[one.joint])
    theta = np.zeros((len(t), 3))
    theta[:, 1] = joints[0] + np.pi
    theta[:, 2] = theta[:, 1] + (joints[1] if rods == 2 else 0.0)
    theta[order] = theta.copy()
    counts = np.rint(rig.positions(theta) + rng.normal(0, 0.5, theta.shape)).astype(np.int64)[logged.sent]
    run = Run(pose, logged.stamps, rig.theta(counts), counts, pose, rig.name, "", rate_hz)
    return replace(run, mounting="inner") if rods == 1 else run


POSES = {2: ("X1", "X2", "X3"), 1: ("X2", "X2", "X2")}


def recordings(
    seed: int,
    acting: Sequence[Law] | None = None,
    *,
    rods: int = 2,
    seconds: float = 6.0,
    rate_hz: float = 200.0,
    logger: str = "",
    rough: bool = False,
) -> tuple[Rig, list[Run], list[Law]]:
    """Draw a rig, three recordings of it, and its effects. A rough rig also has a zero offset and a vibrating mount."""
    rng = np.random.default_rng(seed)
    rig, base = rig_and_base(rng, rods)
    acting = laws(rng, rods=rods) if acting is None else list(acting)
    mount, own = None, np.random.default_rng([seed, 2])
    if rough:
        mount = Mount.drawn(own)
        acting.append(_law("encoder_offset", int(own.integers(rods)), float(own.uniform(*SMALL)), own))
    logged = {"rate_hz": rate_hz, "logger": logger, "mount": mount}
    runs = [record(rig, base, acting, rng, pose, seconds, rods, **logged) for pose in POSES[rods]]
    return rig, [replace(run, name=f"run{i}") for i, run in enumerate(runs)], acting

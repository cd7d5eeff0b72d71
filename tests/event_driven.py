"""Rods under set-valued dry friction by scipy's event location, for tests: shares no code with what it tests.

M(theta) alpha = f + J^T lambda with u = J omega the joints' speeds. Joints at rest are constraints J_j alpha = 0; which
of them are let go follows from the lambdas of the least energy of acceleration within their limits, a bounded problem
of least squares.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import lsq_linear

JOINTS = np.array([[1.0, 0.0], [-1.0, 1.0]])
Law = Callable[[float], float]
"""Friction as a function of the absolute speed, N m. Its value at zero speed is the limit at rest."""


@dataclass
class Rods:
    """Equation (1) of docs/theory.md in matrices, with Coulomb friction in both joints."""

    base: np.ndarray
    gravity: float
    """g / L1, 1/s^2."""
    laws: tuple[Law, Law] = (lambda u: 0.0, lambda u: 0.0)

    def mass(self, theta):
        a, b, d, *_ = self.base
        c = d * np.cos(theta[0] - theta[1])
        return np.array([[a, c], [c, b]])

    def torque(self, x, sides):
        _, _, d, e1, c1, c2 = self.base
        theta, omega = x[:2], x[2:]
        s, u = d * np.sin(theta[0] - theta[1]), JOINTS @ omega
        f = np.array(
            [-s * omega[1] ** 2 + e1 * np.sin(theta[0]), s * omega[0] ** 2 + d * self.gravity * np.sin(theta[1])]
        )
        friction = [c * v + side * law(abs(v)) for c, v, side, law in zip((c1, c2), u, sides, self.laws, strict=True)]
        return f - JOINTS.T @ friction

    def accelerations(self, x, sides):
        """Accelerations, and torques of the joints at rest, from the linear system with its constraints."""
        rest = [j for j in (0, 1) if sides[j] == 0]
        J, n = JOINTS[rest], len(rest)
        system = np.block([[self.mass(x[:2]), -J.T], [J, np.zeros((n, n))]])
        result = np.linalg.solve(system, np.concatenate([self.torque(x, sides), np.zeros(n)]))
        lambdas = np.zeros(2)
        lambdas[rest] = result[2:]
        return result[:2], lambdas

    def sides(self, x):
        """Direction in which each joint slides or starts to slide; 0 if it rests."""
        sides, limits = np.sign(JOINTS @ x[2:]), np.array([law(0.0) for law in self.laws])
        rest = np.flatnonzero((sides == 0) & (limits > 0))
        inverse = np.linalg.inv(self.mass(x[:2]))
        G, free = JOINTS @ inverse @ JOINTS.T, JOINTS @ inverse @ self.torque(x, sides)
        if len(rest):
            root = np.linalg.cholesky(G[np.ix_(rest, rest)])
            bounds = -limits[rest], limits[rest]
            lambdas = lsq_linear(root.T, -np.linalg.solve(root, free[rest]), bounds, method="bvls", tol=1e-14).x
            at_limit = np.abs(lambdas) >= limits[rest] * (1 - 1e-9)
            sides[rest] = np.where(at_limit, -np.sign(lambdas), 0.0)
        return np.where(limits == 0, 1.0, sides)


def _event(rods: Rods, sides, j: int) -> Any:
    """Function that decreases through zero when joint j stops, or exceeds its friction limit."""

    def left(t, x):
        return rods.laws[j](0.0) - abs(rods.accelerations(x, sides)[1][j]) if sides[j] == 0 else JOINTS[j] @ x[2:]

    event: Any = left
    event.direction, event.terminal = -sides[j] if sides[j] else -1, True
    return event


def _slope(rods: Rods, sides):
    return lambda t, x: np.concatenate([x[2:], rods.accelerations(x, sides)[0]])


BEGINS_S = 1e-6
"""Minimum duration of a slide, s. A joint starts to slide at zero speed, which would count as a stop."""


def swing(rods: Rods, start, t, error=1e-11):
    """Simulate states (n, 4) at t, with stops and starts; each interval between two events is integrated separately."""
    x, now, result = np.array(start, dtype=float), t[0], [np.array(start, dtype=float)]
    sides, dry = rods.sides(x), [j for j in (0, 1) if rods.laws[j](0.0) > 0]
    while len(result) < len(t):
        begins = any(sides[j] != 0 and JOINTS[j] @ x[2:] == 0 for j in dry)
        looked_at = [] if begins else dry
        events: list[Any] = [_event(rods, tuple(sides), j) for j in looked_at]
        solved = solve_ivp(
            _slope(rods, tuple(sides)),
            (now, min(now + BEGINS_S, t[-1]) if begins else t[-1]),
            x,
            "DOP853",
            rtol=error,
            atol=error,
            events=events or None,
            dense_output=True,
        )
        until = solved.t[-1]
        result += [solved.sol(at) for at in t[len(result) :] if at <= until]
        x, now = solved.y[:, -1].copy(), until
        happened = {j: len(times) > 0 for j, times in zip(looked_at, solved.t_events or (), strict=True)}
        stopped = [happened.get(j, False) and sides[j] != 0 for j in (0, 1)]
        for j in (0, 1):
            x[2 + j] = (x[2] if j else 0.0) if sides[j] == 0 or stopped[j] else x[2 + j]
        released = False
        for j in (0, 1):
            if happened.get(j, False) and not stopped[j]:
                sides[j], released = -np.sign(rods.accelerations(x, sides)[1][j]), True
        if not (released or begins):
            sides = rods.sides(x)
    return np.array(result)

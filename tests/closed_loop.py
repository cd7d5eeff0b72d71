"""Rods under PD control on encoder counts, simulated by SciPy without code of dpr-lab, for tests."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, sin, tanh

import numpy as np
from scipy.integrate import odeint

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.rig import Rig
from dpr_lab.run import Run

COUNT = 2 * np.pi / 16384
"""Step of the encoders, rad."""
RATE_HZ = 500.0
Slope = tuple[float, float, float, float]
"""Derivatives of two angles and of their speeds."""


@dataclass(frozen=True)
class ClosedLoop:
    """Rods that follow sines. The controller uses counts, so that its torques are rough."""

    friction: tuple[float, float] = (0.0, 0.0)
    """Coulomb friction of each joint, N m."""
    play: float = 0.0
    """Backlash between joint 2 and its encoder, rad."""
    gain: tuple[float, float] = (1.0, 1.0)
    """Ratio of the acting to the measured torque."""
    noise_Nm: float = 2e-3
    """Standard deviation of the measured torques."""
    stiffness: tuple[float, float] = (0.8, 0.4)
    """Proportional gains, N m/rad."""
    damping: tuple[float, float] = (0.05, 0.025)
    """Derivative gains, N m s/rad."""

    def runs(self, rig: Rig, seed: int, count: int = 3, duration: float = 4.0) -> list[Run]:
        """Record runs with other references, of rods that differ by a few per cent from the rig file."""
        rng = np.random.default_rng(seed)
        base = base_parameters(rig.nominal * rng.uniform(0.95, 1.05, 9), rig.L1, rig.g)
        return [self._run(rig, base, rng, f"loop{k}", duration) for k in range(count)]

    def _run(self, rig: Rig, base: np.ndarray, rng: np.random.Generator, name: str, duration: float) -> Run:
        t = np.arange(round(duration * RATE_HZ)) / RATE_HZ
        tones = rng.uniform(0.3, 0.7, (3, 2)), rng.uniform(0.4, 2.5, (3, 2)), rng.uniform(0, 2 * np.pi, (3, 2))
        wanted = [(s * np.sin(2 * np.pi * f * t[:, None] + p) - s * np.sin(p)) for s, f, p in zip(*tones, strict=True)]
        target, stiffness, damping = np.sum(wanted, axis=0), np.array(self.stiffness), np.array(self.damping)
        x, held, before = np.array([np.pi, np.pi, 0.0, 0.0]), 0.0, np.zeros(2)
        read, torques = np.empty((len(t), 2)), np.empty((len(t), 2))
        for k in range(len(t)):
            joints = np.array([x[0] - np.pi, x[1] - x[0]])
            held = min(max(held, joints[1] - self.play / 2), joints[1] + self.play / 2)
            joints[1] = held
            read[k] = COUNT * np.round(joints / COUNT)
            speed, before = (read[k] - before) * RATE_HZ * (k > 0), read[k]
            torques[k] = stiffness * (target[k] - read[k]) - damping * speed
            acting = torques[k] * self.gain
            arguments = tuple(base), rig, tuple(acting)
            x = odeint(self._slope, x, (0, 1 / RATE_HZ), arguments, rtol=1e-9, atol=1e-10, tfirst=True)[-1]
        theta = np.column_stack([np.zeros(len(t)), read[:, 0] + np.pi, read.sum(axis=1) + np.pi])
        measured = torques + rng.normal(0, self.noise_Nm, torques.shape)
        run = Run(name, t, theta, None, None, rig.name, "", RATE_HZ)
        return replace(run, torques=measured, torque_kind="measured")

    def _slope(self, _: float, x: Sequence[float], base: Sequence[float], rig: Rig, torque: Sequence[float]) -> Slope:
        a, b, d, e1, c1, c2 = base
        p, q, u, v = x
        on1 = torque[0] - c1 * u - self.friction[0] * tanh(u / 1e-3)
        on2 = torque[1] - c2 * (v - u) - self.friction[1] * tanh((v - u) / 1e-3)
        cross, turned = d * cos(p - q), d * sin(p - q)
        inner = -turned * v**2 + e1 * sin(p) + on1 - on2
        outer = turned * u**2 + d * rig.g / rig.L1 * sin(q) + on2
        determinant = a * b - cross**2
        return u, v, (b * inner - cross * outer) / determinant, (a * outer - cross * inner) / determinant

"""One rod on a potentiometer by scipy's event location, with a zero offset and dry friction, for tests and benchmarks.

It shares no code with what it tests: half swings between located stops, at which the rod may stay at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

Array = NDArray[np.float64]

G = 9.81
RATE_HZ = 100.0
RELEASES = (np.radians(60.0), np.radians(90.0))


@dataclass(frozen=True, slots=True)
class Rod:
    """Uniform rod on one bearing. Friction is relative to the gravity torque, times to the natural period."""

    length: float = 0.4
    mass: float = 0.1
    dry: float = 0.005
    """Coulomb friction relative to the gravity torque."""
    damping: float = 0.003
    """Damping ratio of a small swing."""
    drag: float = 0.0
    """Quadratic drag over gravity torque at the natural frequency squared."""
    offset: float = 8.5e-3
    """Zero error of the potentiometer, rad."""
    drift: float = 0.0
    """Rate of the zero error, rad/s."""
    scale: float = 0.0
    """Relative scale error of the potentiometer."""
    turns: tuple[int, int] = (0, 0)
    """Whole turns of the rod before each release."""
    eccentric: float = 0.0
    """Amplitude of an error with one cycle per turn, rad."""
    jitter: float = 0.0
    """Standard deviation of the sampling instants, s."""
    noise: float = 2e-3
    """Standard deviation of a reading, rad."""
    counts: int = 4096
    """Resolution per turn."""
    duration: float = 10.0

    @property
    def frequency(self) -> float:
        """Natural frequency of a small swing, rad/s."""
        return float(np.sqrt(1.5 * G / self.length))

    @property
    def gravity_torque(self) -> float:
        """Gravity torque of the horizontal rod, N m."""
        return 0.5 * self.mass * G * self.length


def drawn(seed: int) -> Rod:
    """Draw a rod; seed 0 is the rod of the defaults."""
    if seed == 0:
        return Rod()
    rng = np.random.default_rng([seed, 26])
    noise = float(rng.uniform(1e-3, 5e-3))
    small = {
        "drag": rng.uniform(0.0, 2e-3),
        "scale": rng.uniform(-1e-3, 1e-3),
        "eccentric": rng.uniform(0.0, 0.3) * noise,
        "jitter": rng.uniform(0.0, 3e-4),
    }
    present = rng.permutation(list(small))[: rng.integers(0, len(small) + 1)]
    return Rod(
        length=float(rng.uniform(0.15, 0.5)),
        mass=float(rng.uniform(0.05, 0.3)),
        dry=float(np.exp(rng.uniform(*np.log([2e-3, 1.5e-2])))),
        damping=float(np.exp(rng.uniform(*np.log([1e-3, 8e-3])))),
        offset=float(rng.choice([-1.0, 1.0]) * rng.uniform(6e-3, 1.5e-2)),
        noise=noise,
        counts=int(rng.choice([1024, 4096, 16384])),
        duration=float(rng.uniform(5.0, 20.0)),
        **{name: float(small[name]) for name in present},
    )


def swing(rod: Rod, start: float, t: Array) -> Array:
    """Simulate the angle (n,) from hanging, rad: half swings between stops, at which the rod may stay at rest."""
    w, angles = rod.frequency, np.full(len(t), start)
    at, now = start, 0.0
    while now < t[-1] and abs(np.sin(at)) > rod.dry:
        side = -np.sign(np.sin(at))

        def acceleration(_: float, x: Array, side: float = side) -> list[float]:
            drag = rod.drag * x[1] * abs(x[1]) / w**2
            return [x[1], -(w**2) * (np.sin(x[0]) + side * rod.dry + drag) - 2 * rod.damping * w * x[1]]

        def stops(_: float, x: Array, side: float = side) -> float:
            return side * x[1] + (x[1] == 0.0)

        setattr(stops, "terminal", True)  # noqa: B010
        setattr(stops, "direction", -1.0)  # noqa: B010
        half = solve_ivp(acceleration, (now, t[-1]), [at, 0.0], "DOP853", events=stops, dense_output=True, rtol=1e-10,
                         atol=1e-12, first_step=1e-4)  # fmt: skip
        mine = (t >= now) & (t <= half.t[-1])
        angles[mine] = half.sol(t[mine])[0]
        at, now = float(half.y[0, -1]), float(half.t[-1])
        angles[t > now] = at
    return angles


def recorded(rod: Rod, seed: int, folder: Path, starts: Sequence[float] | None = None) -> tuple[Rig, list[Run]]:
    """Rig file as drafted by a user, and recordings as imported tables; they start at `RELEASES` by default."""
    rng = np.random.default_rng([seed, 27])
    measured = Measure(rod.mass)
    named = RigMeasures("one rod", rod.length, rod.length, measured, measured, counts_per_rev=rod.counts)
    rig = parse_rig(draft_rig(named)).with_rods("inner")
    runs = []
    for number, start in enumerate(RELEASES if starts is None else starts):
        t = np.arange(0.0, rod.duration, 1 / RATE_HZ)
        true = swing(rod, start, np.maximum(t + rng.normal(0.0, rod.jitter, len(t)), 0.0))
        zero = rod.offset + rod.drift * t + rod.eccentric * np.sin(true + 1.0)
        read = (1 + rod.scale) * (true + 2 * np.pi * rod.turns[number]) + zero
        count = 2 * np.pi / rod.counts
        read = count * np.rint((read + rng.normal(0.0, rod.noise, len(t))) / count)
        file = folder / f"release_{number}.csv"
        np.savetxt(file, np.column_stack([t, read]), delimiter=",", header="t_s,theta1_rad", comments="", fmt="%.6f")
        runs.append(import_csv(file, rig, ImportOptions(zero="hanging")))
    return rig, runs

"""One rod on a potentiometer, with a zero offset and dry friction: neither may get another name.

    python benchmarks/one_rod.py --cases 20
    python benchmarks/one_rod.py --cases 20 --seed 1000

Two releases, from 60 and 90 degrees, at 100 Hz. The rod is integrated by scipy with located stops, which shares no code
with the lab. Length, mass, friction, noise, resolution and duration are drawn, and small background effects with them:
air drag, eccentricity, a scale error, jitter of the instants. Thresholds were set on seeds below 1000; those above are
for judging.
"""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import Measure, RigMeasures, draft_rig

Array = NDArray[np.float64]

G = 9.81
RATE_HZ = 100.0
RELEASES = (np.radians(60.0), np.radians(90.0))
OFFSET = ("encoder_offset_joint1", "base_tilt", "com_offset_link1")
"""Names of one class for one rod."""
DRY = ("coulomb_joint1", "hysteresis_joint1", "stribeck_joint1", "friction_curve_joint1", "load_friction_joint1")
"""Dry friction and its other forms."""
BACKGROUND = ("air_drag_both", "air_drag_outer", "encoder_eccentricity_joint1", "encoder_scale_joint1")


@dataclass(frozen=True, slots=True)
class Rod:
    """A uniform rod on one bearing. Friction counts in units of the gravity torque, times in those of the rod."""

    length: float = 0.4
    mass: float = 0.1
    dry: float = 0.005
    """Coulomb friction over gravity torque."""
    damping: float = 0.003
    """Damping ratio of a small swing."""
    drag: float = 0.0
    """Quadratic drag over gravity torque at the natural frequency squared."""
    offset: float = 8.5e-3
    """Zero error of the potentiometer, rad."""
    scale: float = 0.0
    """Relative error of its scale."""
    eccentric: float = 0.0
    """Peak of an error with one cycle per turn, rad."""
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
    """(n,) angle from hanging, rad: half swings between located stops, at which the rod may stay at rest."""
    w, angles = rod.frequency, np.full(len(t), start)
    at, now = start, 0.0
    while now < t[-1] and abs(np.sin(at)) > rod.dry:
        side = -np.sign(np.sin(at))

        def acceleration(_: float, x: Array, side: float = side) -> list[float]:
            drag = rod.drag * x[1] * abs(x[1]) / w**2
            return [x[1], -(w**2) * (np.sin(x[0]) + side * rod.dry + drag) - 2 * rod.damping * w * x[1]]

        def stops(_: float, x: Array, side: float = side) -> float:
            return side * x[1] + (x[1] == 0.0)

        stops.terminal, stops.direction = True, -1.0
        half = solve_ivp(acceleration, (now, t[-1]), [at, 0.0], "DOP853", events=stops, dense_output=True, rtol=1e-10,
                         atol=1e-12, first_step=1e-4)  # fmt: skip
        mine = (t >= now) & (t <= half.t[-1])
        angles[mine] = half.sol(t[mine])[0]
        at, now = float(half.y[0, -1]), float(half.t[-1])
        angles[t > now] = at
    return angles


def recorded(rod: Rod, seed: int, folder: Path) -> tuple[Rig, list[Run]]:
    """The rig file that a user would draft, and the recordings as imported tables."""
    rng = np.random.default_rng([seed, 27])
    measured = Measure(rod.mass)
    named = RigMeasures("one rod", rod.length, rod.length, measured, measured, counts_per_rev=rod.counts)
    rig = parse_rig(draft_rig(named)).with_rods("inner")
    runs = []
    for number, start in enumerate(RELEASES):
        t = np.arange(0.0, rod.duration, 1 / RATE_HZ)
        true = swing(rod, start, np.maximum(t + rng.normal(0.0, rod.jitter, len(t)), 0.0))
        read = (1 + rod.scale) * true + rod.offset + rod.eccentric * np.sin(true + 1.0)
        count = 2 * np.pi / rod.counts
        read = count * np.rint((read + rng.normal(0.0, rod.noise, len(t))) / count)
        file = folder / f"release_{number}.csv"
        np.savetxt(file, np.column_stack([t, read]), delimiter=",", header="t_s,theta1_rad", comments="", fmt="%.6f")
        runs.append(import_csv(file, rig, replace(ImportOptions(), zero="hanging")))
    return rig, runs


@dataclass(frozen=True, slots=True)
class Answer:
    """One rod diagnosed."""

    seed: int
    rod: Rod
    verdict: str
    named: Mapping[str, float]
    """Names above one half, with their probabilities."""
    detectable: float
    """Minimum detectable dry friction by the diagnosis itself, over gravity torque."""
    seconds: float

    @property
    def right(self) -> bool:
        """The offset, the dry friction where it is large enough to be seen, and nothing that is not on the rod."""
        dry = any(name in DRY for name in self.named) or self.rod.dry < self.detectable
        return dry and any(name in OFFSET for name in self.named) and not self.wrong

    @property
    def wrong(self) -> tuple[str, ...]:
        """Names that are neither."""
        return tuple(name for name in self.named if name not in (*OFFSET, *DRY, *BACKGROUND))


def answer(seed: int) -> Answer:
    """Draw, record, diagnose."""
    rod = drawn(seed)
    with tempfile.TemporaryDirectory() as folder:
        rig, runs = recorded(rod, seed, Path(folder))
        began = time.process_time()
        diagnosis = diagnose(runs, rig)
    named = {effect.name: effect.probability for effect in diagnosis.effects if effect.probability > 0.5}
    gravity = 0.5 * rod.mass * rod.length * G
    least = diagnosis.detectable["coulomb_joint1"]["torque_Nm"] or np.inf
    return Answer(seed, rod, diagnosis.verdict, named, least / gravity, time.process_time() - began)


def bars(answers: list[Answer]) -> list[Bar]:
    """What was named."""
    count = len(answers)
    return [
        at_least(f"offset and dry friction named (of {count})", sum(one.right for one in answers) / count, 0.9),
        at_most("cases with another name above 0.5", sum(bool(one.wrong) for one in answers), 0),
        Bar("seconds a case, longest", "-", max(one.seconds for one in answers), None),
    ]


def main() -> None:
    """Draw, diagnose, print."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=20, help="number of rods (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    args = parser.parse_args()
    answers = []
    for seed in range(args.seed, args.seed + (3 if args.quick else args.cases)):
        one = answer(seed)
        answers.append(one)
        names = ", ".join(f"{name} {probability:.2f}" for name, probability in one.named.items()) or "nothing"
        result = "right" if one.right else "WRONG" if one.wrong else "open"
        dry = f"dry {one.rod.dry:.4f} (visible from {one.detectable:.4f})"
        drawn_as = f"{dry}, noise {1e3 * one.rod.noise:.1f} mrad, {one.rod.duration:.0f} s"
        print(f"{seed:5} {result:5} {one.verdict:16} {names}; {drawn_as}; {one.seconds:.1f} s", flush=True)
    show("one rod with a zero offset and dry friction", bars(answers), args.json)


if __name__ == "__main__":
    main()

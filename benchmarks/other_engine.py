"""Dry joints and preloaded springs on rigs that scipy simulates, with its own events: none may get another name.

    python benchmarks/other_engine.py --cases 50

The swings are those of `tests/event_driven.py`, which shares no code with the lab: joints that stop, rest and are let
go between events. A joint has plain dry friction (`dry`), or a spring that rests away from hanging (`spring`); the rig
file is off by up to 15 %.
"""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show
from _random_rigs import RATE_HZ, WITHIN, recorded

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import MASSES, PARAMETERS, Rig, load_rig
from dpr_lab.run import Run

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.event_driven import JOINTS, Rods, swing

ERROR = 1e-8
"""Of the integration, relative and absolute, in each step: ten thousandths of a count."""
DRY_NM = (3e-4, 3e-3)
"""Least and largest dry friction, N m."""
STIFFNESS = (1e-3, 1e-2)
"""Least and largest, N m/rad."""
REST_RAD = (0.2, 0.6)
"""How far from hanging a spring rests, on either side."""


@dataclass
class Sprung(Rods):
    """Rods with a spring on one joint."""

    joint: int = 0
    stiffness: float = 0.0
    rest: float = 0.0

    def torque(self, x, sides):
        """Equation (1)'s right side and the spring's own torque."""
        angles = np.array([x[0] - np.pi, x[1] - x[0]])
        return super().torque(x, sides) - self.stiffness * (angles[self.joint] - self.rest) * JOINTS[self.joint]


@dataclass(frozen=True, slots=True)
class Told:
    """One rig diagnosed."""

    kind: str
    joint: int
    size: float
    names: tuple[str, ...]
    """Named above one half, the likeliest first."""
    closed: float
    seconds: float


def _between(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))


def drawn(kind: str, seed: int) -> tuple[Rig, list[Run], int, float]:
    """A rig file with weighed masses, three recordings of the true rig, and what ails it: joint (0, 1) and size."""
    rng, paper = np.random.default_rng([seed, len(kind)]), load_rig("paper")
    described = paper.model_dump(exclude_none=True)
    true = paper.nominal * rng.uniform(1 - WITHIN, 1 + WITHIN, len(PARAMETERS))
    for name, value in zip(PARAMETERS, true.tolist(), strict=True):
        if name in MASSES:
            described["parameters"][name].update(measured=value, std=1e-3 * value)
    rig = Rig.model_validate(described)
    base, joint = base_parameters(true, rig.L1, rig.g), seed % 2
    if kind == "dry":
        size = _between(rng, DRY_NM)
        laws = [lambda u: 0.0, lambda u: 0.0]
        laws[joint] = lambda u: size
        rods = Rods(base, rig.g / rig.L1, (laws[0], laws[1]))
    else:
        size, rest = _between(rng, STIFFNESS), float(rng.choice([-1.0, 1.0]) * rng.uniform(*REST_RAD))
        rods = Sprung(base, rig.g / rig.L1, joint=joint, stiffness=size, rest=rest)
    swings = [recorded(rig, pose, lambda start, t: swing(rods, start, t, ERROR), RATE_HZ, rng) for pose in rig.poses]
    return rig, [run for run, _ in swings], joint, size


def told(kind: str, seed: int) -> Told:
    """Draw, record, diagnose."""
    rig, runs, joint, size = drawn(kind, seed)
    began = time.process_time()
    found = diagnose(runs, rig)
    likely = sorted((e for e in found.effects if e.probability > 0.5), key=lambda e: -e.probability)
    return Told(
        kind, joint + 1, size, tuple(e.name for e in likely), found.gap.explained_share, time.process_time() - began
    )


def bars(done: list[Told]) -> list[Bar]:
    """What was found."""
    dry, sprung = ([one for one in done if one.kind == kind] for kind in ("dry", "spring"))
    return [
        at_most(f"plain dry joints called Stribeck (of {len(dry)})", sum(_says(one, "stribeck") for one in dry), 0),
        at_least("the same: dry friction of that joint, named alone", _share(dry, "coulomb"), 0.98),
        at_least(f"preloaded springs named (of {len(sprung)})", _share(sprung, "spring", alone=False), 0.96),
        at_least("the same: named alone", _share(sprung, "spring"), 0.92),
        Bar("seconds a case, longest", "-", max(one.seconds for one in done), None),
    ]


def _says(one: Told, effect: str) -> bool:
    return f"{effect}_joint{one.joint}" in one.names


def _share(some: list[Told], effect: str, *, alone: bool = True) -> float:
    right = sum(_says(one, effect) and (len(one.names) == 1 or not alone) for one in some)
    return right / max(len(some), 1)


def main() -> None:
    """Draw, diagnose, print."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=50, help="of each kind (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: all cores)")
    args = parser.parse_args()
    count = 3 if args.quick else args.cases
    asked = [(kind, args.seed + i) for i in range(count) for kind in ("dry", "spring")]
    done: list[Told] = []
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for one in pool.map(told, *zip(*asked, strict=True)):
            done.append(one)
            right = one.names == (f"{'coulomb' if one.kind == 'dry' else 'spring'}_joint{one.joint}",)
            said = "" if right else f"  {', '.join(one.names) or 'nothing'}"
            print(
                f"{one.kind:7} joint {one.joint} {one.size:.2e} explained {one.closed:.3f} {one.seconds:5.1f} s{said}",
                file=sys.stderr,
                flush=True,
            )
    show("other engine", bars(done), args.json)


if __name__ == "__main__":
    main()

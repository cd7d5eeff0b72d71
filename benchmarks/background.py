"""One dominant effect among three to six small ones, on rigs that scipy simulates: which name comes first, how sure.

    python benchmarks/background.py --cases 40              even seeds: to tune on
    python benchmarks/background.py --cases 40 --judge      odd seeds: to judge by

The laws are those of `tests/background_rigs.py`, which shares no code with the lab; a third of the small ones is in no
library. One case in four is of one rod.
"""

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.gap.diagnose import diagnose

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.background_rigs import recordings, rig_and_base

SURE = 0.9
SIZED = ("coulomb", "spring", "encoder_offset")
"""Effects whose first parameter is the size of a law."""
ALSO = {
    "coulomb": ("stribeck", "friction_curve", "hysteresis"),
    "encoder_offset": ("base_tilt", "com_offset", "encoder_eccentricity"),
    "encoder_eccentricity": ("encoder_offset", "base_tilt", "com_offset"),
    "third": ("detent", "spring"),
    "fifth": ("encoder_eccentricity",),
    "power": ("air_drag", "viscous_ground", "friction_curve", "stribeck"),
    "one_sided": ("coulomb", "friction_curve", "stribeck", "hysteresis"),
    "wander": ("base_vibration",),
    "spring": ("torque_offset", "detent"),
    "encoder_scale": ("spring",),
}
"""Other names of the same thing: richer forms, and what is indistinguishable from it."""


@dataclass(frozen=True, slots=True)
class Case:
    """One rig diagnosed."""

    seed: int
    true: tuple[str, ...]
    """The dominant effect, then the small ones."""
    verdict: str
    named: tuple[tuple[str, float], ...]
    """With their probabilities, the most probable first."""
    size_off: float | None
    """Of the dominant effect if named: error over the half width of its 90 % interval."""
    explained: float
    of_reproducible: float | None
    seconds: float

    @property
    def first_right(self) -> bool:
        """Whether the effect of the largest share is the dominant one."""
        return bool(self.named) and alike(self.named[0][0], self.true[0])

    @property
    def sure_wrong(self) -> int:
        """Names above `SURE` that are no law of this rig."""
        return sum(p > SURE and not any(alike(name, law) for law in self.true) for name, p in self.named)


def alike(name: str, law: str) -> bool:
    """Whether a name stands for a law."""
    kind, _, joint = law.rpartition("_joint")
    said, _, of = name.rpartition("_joint")
    said, of = (said, of) if said else (name, "")
    return said.startswith((kind, *ALSO.get(kind, ()))) and of in (joint, "")


def told(seed: int) -> Case:
    """Draw, record, diagnose."""
    rods = 1 if seed % 8 in (6, 7) else 2
    rig, runs, laws = recordings(seed, rods=rods)
    began = time.process_time()
    found = diagnose(runs, rig)
    ranked = sorted(found.effects, key=lambda effect: -effect.share)
    size_off = None
    for effect in ranked:
        if alike(effect.name, laws[0].name) and effect.name.startswith(SIZED):
            size, unit = next(iter(effect.parameters.values())), 1.0
            if laws[0].torque:  # torques are relative to the b of the rig file
                unit = found.scale_b / rig_and_base(np.random.default_rng(seed), rods)[1][1]
            reach = max(size.interval90[1] - size.value, 1e-300)
            true = sum(law.size for law in laws if law.name == laws[0].name)
            size_off = (abs(size.value) - unit * true) / reach
    budget = found.gap.budget
    return Case(
        seed,
        tuple(law.name for law in laws),
        found.verdict,
        tuple((effect.name, effect.probability) for effect in ranked),
        size_off,
        found.gap.explained_share,
        budget.of_reproducible if budget else None,
        time.process_time() - began,
    )


def bars(done: list[Case]) -> list[Bar]:
    """What was found."""
    offs = [case.size_off for case in done if case.size_off is not None]
    return [
        at_least(f"dominant effect first (of {len(done)})", float(np.mean([case.first_right for case in done])), 0.93),
        at_most("sure wrong names, per case", float(np.mean([case.sure_wrong for case in done])), 0.02),
        Bar("verdict unexplained, share", "-", float(np.mean([case.verdict == "unexplained" for case in done])), None),
        Bar("size within 90 % interval, share", "-", float(np.mean(np.abs(offs) < 1)) if offs else None, None),
        Bar("seconds a case, median", "-", float(np.median([case.seconds for case in done])), None),
    ]


def main() -> None:
    """Draw, diagnose, print."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=40, help="(default: %(default)s)")
    parser.add_argument("--judge", action="store_true", help="odd seeds, kept aside")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: all cores)")
    args = parser.parse_args()
    seeds = [2 * i + args.judge for i in range(4 if args.quick else args.cases)]
    done: list[Case] = []
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for case in pool.map(told, seeds):
            done.append(case)
            if not args.json:
                print(
                    f"{case.seed:4} {case.true[0]:28} {case.verdict:17} {case.explained:.3f}"
                    f" {'' if case.first_right else 'WRONG'} {'SURE WRONG' * case.sure_wrong}"
                    f" {[(name, round(p, 2)) for name, p in case.named]} | {case.true[1:]}"
                    f" off {case.size_off} {case.seconds:.1f} s",
                    flush=True,
                )
    show("One dominant effect among small ones", bars(done), args.json)


if __name__ == "__main__":
    main()

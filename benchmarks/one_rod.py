"""One rod on a potentiometer, with a zero offset and dry friction: neither may get another name.

    python benchmarks/one_rod.py --cases 20
    python benchmarks/one_rod.py --cases 20 --seed 1000

Two releases, from 60 and 90 degrees, at 100 Hz, of the rod of `tests/one_rod.py`, which shares no code with the lab.
Length, mass, friction, noise, resolution and duration are drawn, and small background effects with them: air drag,
eccentricity, a scale error, jitter of the instants. Seeds from 1000 on are kept
aside for judging.
"""

import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.gap.diagnose import diagnose

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.one_rod import Rod, drawn, recorded

OFFSET = ("encoder_offset_joint1", "base_tilt", "com_offset_link1")
"""Names of one class for one rod."""
DRY = ("coulomb_joint1", "hysteresis_joint1", "stribeck_joint1", "friction_curve_joint1", "load_friction_joint1")
"""Dry friction and its other forms."""
BACKGROUND = ("air_drag_both", "air_drag_outer", "encoder_eccentricity_joint1", "encoder_scale_joint1")


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
    gravity = rod.gravity_torque
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

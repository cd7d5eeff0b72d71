"""Rigs as on real benches: is the dominant cause named, or the fault of the logger, and nothing that is not there?

    python benchmarks/textbook.py --cases 4                    of each kind, seeds to develop with
    python benchmarks/textbook.py --cases 4 --seed 1000        seeds from 1000 on: to judge by
    python benchmarks/textbook.py --cases 4 --only video

The rigs are those of `tests/bench_rigs.py`, which shares no code with the lab. An answer is right where the effect of
the largest share belongs to a dominant family of the rig, or where the fault of the logger is named. It is wrong where
an effect that the rig does not have is more probable than one half.
"""

import sys
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.shown import percent

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.bench_rigs import KINDS, bench

DRY = ("coulomb", "stribeck", "hysteresis", "friction_curve", "load_friction")
FAMILIES: Mapping[str, tuple[str, ...]] = {
    **{f"dry{joint}": tuple(f"{name}_joint{joint}" for name in DRY) for joint in (1, 2)},
    "zero1": ("encoder_offset_joint1", "base_tilt", "com_offset_link1"),
    "zero2": ("encoder_offset_joint2", "base_tilt", "com_offset_link2"),
    "drag": ("air_drag_both", "air_drag_outer", "viscous_ground", "friction_curve_joint1"),
    "bend1": ("encoder_eccentricity_joint1", "encoder_scale_joint1"),
    "length": ("wrong_length", "clock_rate"),
    "arm": ("arm_compliance", "base_vibration"),
    "rotor2": ("rotor_inertia_joint2",),
    "torque": ("torque_scale", "torque_offset", "torque_ripple", "input_delay"),
}
"""Family of effects -> beginnings of their names."""
NAMED = 0.5


@dataclass(frozen=True, slots=True)
class Answer:
    """One rig diagnosed."""

    kind: str
    seed: int
    verdict: str
    named: tuple[tuple[str, float], ...]
    """With their probabilities, the largest share first."""
    first: bool
    """Whether the first belongs to a dominant family."""
    wrong: tuple[str, ...]
    """Names above one half that are not on the rig."""
    fault: bool | None
    """Whether the fault of the logger is named; None where it has none."""
    closed: float
    """Share of the gap that closes on the held-out recording."""
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the dominant cause or the fault is named, and nothing wrong."""
        return not self.wrong and (self.first or bool(self.fault)) and self.verdict != "traceback"


def of_family(name: str, families: frozenset[str]) -> bool:
    """Whether an effect belongs to one of some families."""
    return any(name.startswith(FAMILIES[family]) for family in families)


def answer(kind: str, seed: int) -> Answer:
    """Draw, record, diagnose."""
    case, began = bench(kind, seed), time.process_time()
    try:
        diagnosis = diagnose(case.runs, case.rig, held_out=case.held_out)
    except Exception:  # a traceback is an answer, and a wrong one
        traceback.print_exc()
        return Answer(kind, seed, "traceback", (), False, (), None, 0.0, time.process_time() - began)
    ranked = sorted(diagnosis.effects, key=lambda effect: -effect.share)
    named = tuple((effect.name, effect.probability) for effect in ranked)
    findings = {finding.name for finding in diagnosis.sensor_findings}
    return Answer(
        kind,
        seed,
        diagnosis.verdict,
        named,
        bool(named) and of_family(named[0][0], case.dominant),
        tuple(name for name, p in named if p > NAMED and not of_family(name, case.present)),
        bool(findings & case.faults) if case.faults else None,
        diagnosis.gap.closed_held_out.estimate,
        time.process_time() - began,
    )


def bars(answers: list[Answer]) -> list[Bar]:
    """What was named, of all rigs and of each kind."""
    faulty = [one.fault for one in answers if one.fault is not None]
    return [
        at_least(
            f"dominant cause or fault named, nothing wrong (of {len(answers)})",
            _share(one.right for one in answers),
            0.9,
        ),
        at_most("rigs with a wrong name above 0.5", sum(bool(one.wrong) for one in answers), 0),
        at_most("tracebacks and refusals", sum(one.verdict == "traceback" for one in answers), 0),
        Bar("fault of the logger named, share", "-", _share(faulty) if faulty else None, None),
        Bar("gap closed on the held-out recording, median", "-", float(np.median([a.closed for a in answers])), None),
        *(
            Bar(f"right: {kind}", "-", _share(one.right for one in answers if one.kind == kind), None)
            for kind in dict.fromkeys(one.kind for one in answers)
        ),
        Bar("seconds a case, longest", "-", max(one.seconds for one in answers), None),
    ]


def _share(truths) -> float:
    return float(np.mean(list(truths)))


def main() -> None:
    """Draw, diagnose, print."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=4, help="number of rigs of each kind (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first")
    parser.add_argument("--only", default="", help="kinds of such a name alone")
    args = parser.parse_args()
    answers = []
    for kind in KINDS:
        for seed in range(args.seed, args.seed + (1 if args.quick else args.cases)):
            if args.only in kind:
                one = answer(kind, seed)
                answers.append(one)
                names = ", ".join(f"{name} {p:.2f}" for name, p in one.named) or "nothing"
                result = "right" if one.right else "WRONG" if one.wrong else "open"
                fault = {None: "", True: ", fault named", False: ", fault missed"}[one.fault]
                closed = f"{percent(one.closed)} closed, {one.seconds:.1f} s"
                print(f"{kind:13} {seed:5} {result:5} {one.verdict:16} {names}{fault}; {closed}", flush=True)
    show("rigs as they stand on real benches", bars(answers), args.json)


if __name__ == "__main__":
    main()

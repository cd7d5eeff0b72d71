"""Diagnosis of rigs with one dominant effect, several small effects and wrong nominal values, simulated by SciPy.

    python benchmarks/background.py --cases 40              even seeds, for tuning
    python benchmarks/background.py --cases 40 --judge      odd seeds, for evaluation (--first 1000: further seeds)

The effects are those of `tests/background_rigs.py`, which shares no code with dpr-lab. The library does not contain a
third of the small effects. Each rig has an encoder with a zero offset, and a mount with a lightly damped second mode.
One case in four has a single rod. In one case of three, the logger samples at wrong instants. The rig file has standard
errors of 0.5 % in L1 and 1 % in the masses. With --clean, only the dominant and the small effects remain.

The size of a drawn effect does not determine the gap that it causes: for example, several turns wind up a small spring
at the elbow. Each effect is therefore also simulated alone, and the first named effect is also compared with the
effects that cause the largest gap.
"""

import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import MASSES, Rig
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import calibration_error, error_if_exact

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.background_rigs import NAMED, Law, recordings, rig_and_base
from tests.faulty_loggers import FAULTS

SURE = 0.9
SIZED = ("coulomb", "spring", "encoder_offset")
"""Effects whose first parameter is the size of the corresponding law."""
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
    "wrong_length": ("clock_rate",),
    "mount": ("arm_compliance",),
}
"""Effects that also count as the name of a law: more general forms, and indistinguishable effects."""
LARGEST = 0.8
"""Share of the largest gap above which an effect may be named first, because the order of nearly equal effects is
random."""
WRONG_VALUES = ("wrong_length",)
"""Effects that represent a wrong value of the rig file."""


@dataclass(frozen=True, slots=True)
class Draw:
    """Random choices of one case."""

    seed: int
    clean: bool
    """Whether the logger has no fault and the rig file no wrong value."""


@dataclass(frozen=True, slots=True)
class Case:
    """Diagnosis of one rig, with its true effects."""

    seed: int
    fault: str
    """Fault of the logger; empty for none."""
    true: tuple[str, ...]
    """The dominant effect, then the small effects, and the mount if it moves."""
    gaps: dict[str, float]
    """Residual of the bare model in units of the noise for each effect, if only this effect acts.

    Mount and zero offset do not act.
    """
    verdict: str
    named: tuple[tuple[tuple[str, ...], float], ...]
    """Named classes in the order of the verdict, each with its named effect first, and their probabilities."""
    size_off: float | None
    """Error of the dominant effect's size over the half width of its 90 % interval; None without such a size."""
    explained: float
    of_reproducible: float | None
    seconds: float

    @property
    def first_right(self) -> bool:
        """Whether the first named effect is the dominant effect; wrong values of the rig file are ignored."""
        return self.first_is(self.true[:1])

    def first_is(self, laws: Sequence[str]) -> bool:
        """Whether the first named effect is one of the given effects; wrong values of the rig file are ignored."""
        classes = [names for names, _ in self.named if not names[0].startswith(WRONG_VALUES)]
        return bool(classes) and one_of(classes[0], laws)

    @property
    def largest(self) -> list[str]:
        """Effects that alone cause the largest gap, or nearly the largest gap."""
        return [name for name, gap in self.gaps.items() if gap >= LARGEST * max(self.gaps.values())]

    def small(self, *, seen: bool) -> list[bool]:
        """Whether each small effect of the library is named.

        Args:
            seen: True selects effects that alone cause a residual above the noise, False the other effects
        """
        names = {law for law in self.gaps if law != self.true[0] and law.startswith(NAMED)}
        named = [name for members, _ in self.named for name in members]
        return [one_of(named, [law]) for law in names if (self.gaps[law] >= 1) == seen]

    @property
    def claims(self) -> list[Claim]:
        """Every named class with its probability.

        A claim is true if a member of the class is an effect of this rig, or a wrong value of its file. The probability
        applies to the class, because no algorithm can distinguish its members.
        """
        return [Claim(p, one_of(names, (*self.true, *WRONG_VALUES))) for names, p in self.named]

    @property
    def sure_wrong(self) -> int:
        """Number of classes with a probability above `SURE` that contain no effect of this rig."""
        return sum(claim.probability > SURE and not claim.true for claim in self.claims)


def one_of(names: Sequence[str], laws: Sequence[str]) -> bool:
    """Whether one of the named effects represents one of the given effects."""
    return any(alike(name, law) for name in names for law in laws)


def alike(name: str, law: str) -> bool:
    """Whether a named effect represents a simulated effect."""
    (kind, joint), (result, of) = _at_joint(law), _at_joint(name)
    return result.startswith((kind, *ALSO.get(kind, ()))) and of in (joint, "")


def _at_joint(name: str) -> tuple[str, str]:
    """Kind of an effect and the number of its joint; the number is empty for an effect without a joint."""
    acts, _, joint = name.rpartition("_joint")
    return (acts, joint) if acts else (name, "")


def described(rig: Rig, rng: np.random.Generator) -> Rig:
    """Rig file as measured by a user, with errors in L1 and the masses."""
    values = rig.model_dump(exclude_none=True)
    values["rig"]["L1"] *= 1 + 0.005 * rng.standard_normal()
    for name in MASSES:
        mass = values["parameters"][name]
        mass.update(measured=mass["measured"] * (1 + 0.01 * rng.standard_normal()), std=0.01 * mass["measured"])
    return Rig.model_validate(values)


def gaps_alone(seed: int, acting: Sequence[Law], rods: int, rate_hz: float) -> dict[str, float]:
    """Residual of the bare model in units of the noise, for each effect alone."""
    gaps = {}
    for name in dict.fromkeys(law.name for law in acting):
        rig, runs, _ = recordings(seed, [law for law in acting if law.name == name], rods=rods, rate_hz=rate_hz)
        alone = Recordings(tuple(record(run, rig) for run in runs), rig)
        gaps[name] = fit_bare_model(alone, nominal_ratios(rig))[2].residuals.noise_ratio
    return gaps


def diagnosed(draw: Draw) -> Case:
    """Draw, record and diagnose one rig."""
    rods, rng = 1 if draw.seed % 8 in (6, 7) else 2, np.random.default_rng([draw.seed, 1])
    fault = "" if draw.clean or rng.random() > 1 / 3 else str(rng.choice(list(FAULTS)))
    rate_hz = 200.0 if draw.clean else float(rng.choice([100.0, 200.0, 500.0]))
    rig, runs, laws = recordings(draw.seed, rods=rods, rate_hz=rate_hz, logger=fault, rough=not draw.clean)
    true_b = rig_and_base(np.random.default_rng(draw.seed), rods)[1][1]
    rig = rig if draw.clean else described(rig, rng)
    began = time.process_time()
    diagnosis = diagnose(runs, rig)
    size_off = None
    for effect in diagnosis.effects:
        if alike(effect.name, laws[0].name) and effect.name.startswith(SIZED):
            size, unit = next(iter(effect.parameters.values())), 1.0
            if laws[0].torque:  # torques are relative to the b of the rig file
                unit = diagnosis.scale_b / true_b
            reach = max(size.interval90[1] - size.value, 1e-300)
            true = sum(law.size for law in laws if law.name == laws[0].name)
            size_off = (abs(size.value) - unit * true) / reach
    budget = diagnosis.gap.budget
    return Case(
        draw.seed,
        fault,
        (*(law.name for law in laws), *(() if draw.clean else ("mount",))),
        gaps_alone(draw.seed, laws, rods, rate_hz),
        diagnosis.verdict,
        tuple(
            ((effect.name, *(n for n in effect.members if n != effect.name)), effect.probability)
            for effect in diagnosis.effects
        ),
        size_off,
        diagnosis.gap.explained_share,
        budget.of_reproducible if budget else None,
        time.process_time() - began,
    )


def bars(done: list[Case]) -> list[Bar]:
    """Results of all cases."""
    offs = [case.size_off for case in done if case.size_off is not None]
    claims = [claim for case in done for claim in case.claims]
    sure = [claim.true for claim in claims if claim.probability > SURE]
    seen, unseen = ([named for case in done for named in case.small(seen=seen)] for seen in (True, False))
    return [
        at_least(f"dominant effect first (of {len(done)})", float(np.mean([case.first_right for case in done])), 0.93),
        at_least("effect of the largest gap first", float(np.mean([c.first_is(c.largest) for c in done])), 0.93),
        at_most(
            "incorrect causes with a probability above 0.9, per case",
            float(np.mean([case.sure_wrong for case in done])),
            0.02,
        ),
        at_least(f"of {len(sure)} causes above 0.9: correct", float(np.mean(sure)) if sure else 1.0, 0.95),
        at_most(f"calibration error, of {len(claims)} causes", calibration_error(claims), 0.05),
        Bar("calibration error of an exact forecast", "-", error_if_exact(claims), None),
        Bar(f"small effects above the noise (of {len(seen)}): named", "-", _mean(seen), None),
        Bar(f"small effects below the noise (of {len(unseen)}): named", "-", _mean(unseen), None),
        Bar("verdict unexplained, share", "-", float(np.mean([case.verdict == "unexplained" for case in done])), None),
        Bar("size within 90 % interval, share", "-", float(np.mean(np.abs(offs) < 1)) if offs else None, None),
        Bar("CPU seconds per case, median", "-", float(np.median([case.seconds for case in done])), None),
    ]


def _mean(truths: list[bool]) -> float | None:
    return float(np.mean(truths)) if truths else None


def main() -> None:
    """Draw and diagnose the rigs, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=40, help="(default: %(default)s)")
    parser.add_argument("--judge", action="store_true", help="odd seeds, which are reserved for evaluation")
    parser.add_argument("--first", type=int, default=0, help="first seed, even; with --judge the next odd one")
    parser.add_argument("--clean", action="store_true", help="no sampling faults, no wrong values in the rig file")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: all cores)")
    args = parser.parse_args()
    seeds = [args.first + 2 * i + args.judge for i in range(4 if args.quick else args.cases)]
    done: list[Case] = []
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for case in pool.map(diagnosed, [Draw(seed, args.clean) for seed in seeds]):
            done.append(case)
            if not args.json:
                print(
                    f"{case.seed:4} {case.fault:15} {case.true[0]:28} {case.verdict:17} {case.explained:.3f}"
                    f" {'' if case.first_right else 'WRONG'} {'SURE WRONG' * case.sure_wrong}"
                    f" {[(names[0], round(p, 2)) for names, p in case.named]} | {case.true[1:]}"
                    f" off {case.size_off} {case.seconds:.1f} s",
                    flush=True,
                )
    show("One dominant effect among small ones", bars(done), args.json)


if __name__ == "__main__":
    main()

"""Diagnosis of single releases of 0.8 to 2.2 s of rigs with several small effects, simulated by SciPy.

    python benchmarks/short_releases.py --first 2060000 --cases 40

The rigs and effects are those of `background.py`. Half of the rigs have one rod, half have effects of three times the
size, and a fifth have a dominant effect that is not in the library. The sample rate is 50 to 500 Hz.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

import numpy as np
from _bars import Bar, at_most, options, show
from background import SURE, WRONG_VALUES, described, one_of

from dpr_lab.errors import RunError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import calibration_error, error_if_exact
from tests.background_rigs import OTHERS, SMALL, Law, Mount, _law, laws, record, rig_and_base

DURATION_S, RATES_HZ, LARGE = (0.8, 2.2), (50.0, 100.0, 200.0, 500.0), 3.0


@dataclass(frozen=True, slots=True)
class Case:
    """Diagnosis of one release, with its true effects."""

    seed: int
    seconds: float
    true: tuple[str, ...]
    verdict: str
    named: tuple[tuple[tuple[str, ...], float], ...]
    """Named classes, each with its named effect first, and their probabilities."""

    @property
    def claims(self) -> list[Claim]:
        """Every named class with its probability; it is true if a member is an effect of the rig or of its file."""
        return [Claim(p, one_of(names, (*self.true, *WRONG_VALUES))) for names, p in self.named]


def larger(law: Law, factor: float) -> Law:
    """Return an effect whose size is multiplied by a factor."""
    torque, reading = law.torque, law.reading
    return Law(
        law.name,
        law.joint,
        law.size * factor,
        torque and (lambda *state: factor * torque(*state)),
        reading and (lambda *state: factor * reading(*state)),
    )


def diagnosed(seed: int) -> Case | None:
    """Draw, record and diagnose one release; None if the rods hardly move."""
    rng, of_rig, of_mount = (np.random.default_rng(key) for key in ([seed, 77], seed, [seed, 2]))
    rods = 1 if rng.random() < 0.5 else 2
    seconds, rate_hz = float(rng.uniform(*DURATION_S)), float(rng.choice(RATES_HZ))
    factor, foreign = LARGE if rng.random() < 0.5 else 1.0, rng.random() < 0.2
    rig, base = rig_and_base(of_rig, rods)
    acting = laws(of_rig, rods=rods)
    if foreign:
        name, joint = str(of_rig.choice(OTHERS)), int(of_rig.integers(rods))
        acting[0] = _law(name, joint, float(of_rig.uniform(3, 10)), of_rig)
    mount = Mount.drawn(of_mount)
    acting.append(_law("encoder_offset", int(of_mount.integers(rods)), float(of_mount.uniform(*SMALL)), of_mount))
    acting = [larger(law, factor) for law in acting]
    noise, pose = np.random.default_rng([seed, 5]), str(of_rig.choice(["X1", "X2", "X3"]))
    run = replace(record(rig, base, acting, noise, pose, seconds, rods, rate_hz=rate_hz, mount=mount), name="run0")
    try:
        diagnosis = diagnose([run], described(rig, rng))
    except RunError:
        return None
    named = [((e.name, *(n for n in e.members if n != e.name)), e.probability) for e in diagnosis.effects]
    return Case(seed, seconds, (*(law.name for law in acting), "mount"), diagnosis.verdict, tuple(named))


def bars(done: Sequence[Case]) -> list[Bar]:
    """Results of all cases."""
    claims = [claim for case in done for claim in case.claims]
    wrong = sum(claim.probability > SURE and not claim.true for claim in claims)
    sure = sum(claim.probability > SURE for claim in claims)
    unlikely = [case for case in done if case.named and max(p for _, p in case.named) < 0.5]
    return [
        at_most(f"incorrect of {sure} causes above 0.9, per release (of {len(done)})", wrong / len(done), 0.02),
        at_most(f"calibration error, of {len(claims)} causes", calibration_error(claims), 0.05),
        Bar("calibration error of an exact forecast", "-", error_if_exact(claims), None),
        Bar("releases with causes, all below 0.5", "-", len(unlikely), None),
        Bar("of these: inconclusive", "-", sum(case.verdict == "inconclusive" for case in unlikely), None),
    ]


def main() -> None:
    """Draw and diagnose the releases, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=40, help="(default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="first seed (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: all cores)")
    args = parser.parse_args()
    seeds, done = range(args.first, args.first + (4 if args.quick else args.cases)), list[Case]()
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for case in filter(None, pool.map(diagnosed, seeds)):
            done.append(case)
            if not args.json:
                named = [(names[0], round(p, 2)) for names, p in case.named]
                print(f"{case.seed} {case.seconds:.1f} s {case.verdict:17} {named} | {case.true}", flush=True)
    if not done:
        raise SystemExit("every release was refused")
    show("Single short releases", bars(done), args.json)


if __name__ == "__main__":
    main()

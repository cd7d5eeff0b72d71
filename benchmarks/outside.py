"""Diagnosis of rigs whose cause is outside the library: pegs, hands, unlogged motors, wrong pivots, moving cameras.

    python benchmarks/outside.py --first 1180000 --cases 60

`scipy.integrate.solve_ivp` simulates one rod or bob, or a double pendulum, with viscous and Coulomb friction and a zero
error of some milliradians. A row of `SITUATIONS` adds one cause that the library does not contain, or contains only in
another form, and states the effects that are then correct. Every other effect is incorrect; a refused table and a
diagnosis without a cause are honest. The recordings are short and coarse: films, encoders of few counts, whole degrees.
They take the way of a user, through a table of angles and a rig file of a few measured values.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from _bars import Bar, at_most, options, show
from _situations import BACKGROUND, SITUATIONS, Angles, G, Plant, Situation

from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.misread.refuse import refuse_misread
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import calibration_error
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure

CLAIMED, SURE = 0.5, 0.9


def drawn(situation: Situation, rng: np.random.Generator) -> tuple[Plant, ...]:
    """Draw a rig with one release, or two releases from different angles."""
    length = float(rng.uniform(0.15, 0.6) if situation.kind != "bob" else rng.uniform(0.25, 1.2))
    w2 = G / length * (float(rng.uniform(1.2, 1.6)) if situation.kind == "rod" else 1.0)
    viscous, coulomb = float(rng.uniform(0.005, 0.1)), w2 * float(np.exp(rng.uniform(math.log(5e-4), math.log(1e-2))))
    rate = float(rng.choice([25, 30, 60, 120] if situation.film else [50, 100, 200]))
    releases = 2 if rng.random() < 0.3 else 1
    seconds = rng.uniform(2, 15 if situation.kind != "double" else 6, releases)
    starts = rng.choice([-1, 1]) * rng.uniform(0.3, 1.5, releases)
    made = zip(seconds.tolist(), starts.tolist(), strict=True)
    return tuple(Plant(length, w2, viscous, coulomb, start, np.arange(0, s, 1 / rate)) for s, start in made)


def sensed(film: bool, angles: Angles, sensor: float, rng: np.random.Generator) -> Angles:
    """Add the noise of a film, or round to the counts of an encoder or to whole degrees; `sensor` is from 0 to 1."""
    if film:
        return angles + rng.normal(0, 1e-3 + 3e-3 * sensor, angles.shape)
    count = 2 * np.pi / (360, 400, 1000, 2000, 4096, 4096)[int(6 * sensor)]
    return np.round(angles / count) * count


def described(situation: Situation, length: float) -> Rig:
    """Rig file of a user, from ruler and balance."""
    length, mass = round(20 * length) / 20 if situation.rounded else round(length, 3), Measure(0.1)
    rods = {"L2": length, "m2": mass} if situation.kind == "double" else {"L2": None, "m2": None, "mounted": "inner"}
    return parse_rig(draft_rig(RigMeasures("outside", length, m1=mass, **rods)))  # pyright: ignore[reportArgumentType]


def tables(seed: int, folder: Path) -> tuple[str, Rig, list[Path]]:
    """Draw a situation and write its recordings: name of the situation, rig file, and tables in radians."""
    name, rng = list(SITUATIONS)[seed % len(SITUATIONS)], np.random.default_rng(seed)
    situation = SITUATIONS[name]
    plants, files = drawn(situation, rng), list[Path]()
    zero, sensor, cause = rng.normal(0, 4e-3, 2), float(rng.random()), int(rng.integers(1 << 31))
    for number, plant in enumerate(plants):
        angles = situation.angles(plant, np.random.default_rng([cause, number if "hand" in name else 0]))
        columns = angles.reshape(len(plant.t), -1)
        columns = sensed(situation.film, columns + zero[: columns.shape[1]], sensor, rng)
        header = ",".join(["t_s", "theta1_rad", "theta2_rad"][: columns.shape[1] + 1])
        files.append(folder / f"release{number}.csv")
        np.savetxt(files[-1], np.column_stack([plant.t, columns]), "%.5f", ",", header=header, comments="")
    return name, described(situation, plants[0].length), files


@dataclass(frozen=True, slots=True)
class Case:
    """Diagnosis of one rig."""

    seed: int
    situation: str
    verdict: str
    """Verdict, or "refused"."""
    named: tuple[tuple[tuple[str, ...], float], ...]
    """Named classes, each with its named effect first, and their probabilities."""
    notes: str = ""
    """Sentence of the verdict, or of the refusal."""

    @property
    def claims(self) -> list[Claim]:
        """Every named class; it is true if a member is an effect of the background or of the situation."""
        correct = (*BACKGROUND, *SITUATIONS[self.situation].correct)
        return [Claim(p, any(name.startswith(correct) for name in names)) for names, p in self.named]

    def wrong(self, above: float) -> int:
        """Count the incorrect causes above a probability."""
        return sum(claim.probability > above and not claim.true for claim in self.claims)


def diagnosed(seed: int) -> Case:
    """Draw, import and diagnose the recordings of one rig."""
    with TemporaryDirectory() as folder:
        situation, rig, files = tables(seed, Path(folder))
        try:
            runs = [import_csv(file, rig, ImportOptions(zero="hanging")) for file in files]
            refuse_misread(runs, rig)
            diagnosis = diagnose(runs, rig)
        except DprError as error:
            return Case(seed, situation, "refused", (), str(error).replace(folder, ""))
    named = [((e.name, *(n for n in e.members if n != e.name)), e.probability) for e in diagnosis.effects]
    return Case(seed, situation, diagnosis.verdict, tuple(named), diagnosis.sentence)


def bars(done: Sequence[Case]) -> list[Bar]:
    """Results of all cases."""
    claims = [claim for case in done for claim in case.claims]
    n = len(done)
    return [
        at_most(f"incorrect causes above {SURE:g}, per rig (of {n})", sum(case.wrong(SURE) for case in done) / n, 0.02),
        Bar(
            f"rigs with an incorrect cause above {CLAIMED:g}", "-", sum(case.wrong(CLAIMED) > 0 for case in done), None
        ),
        Bar(f"correct causes above {CLAIMED:g}", "-", sum(c.true and c.probability > CLAIMED for c in claims), None),
        Bar(f"correct causes above {SURE:g}", "-", sum(c.true and c.probability > SURE for c in claims), None),
        Bar("refused", "-", sum(case.verdict == "refused" for case in done), None),
        at_most(f"calibration error, of {len(claims)} causes", calibration_error(claims), 0.05),
    ]


def main() -> None:
    """Draw and diagnose the rigs, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=60, help="(default: %(default)s)")
    parser.add_argument("--first", type=int, default=1180000, help="first seed (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=None, help="processes (default: all cores)")
    args = parser.parse_args()
    seeds, done = range(args.first, args.first + (4 if args.quick else args.cases)), list[Case]()
    with ProcessPoolExecutor(args.workers, mp_context=get_context("spawn")) as pool:
        for case in pool.map(diagnosed, seeds):
            done.append(case)
            if not args.json:
                marks = zip(case.named, case.claims, strict=True)
                named = [f"{names[0]} {p:.2f}{'' if claim.true else ' WRONG'}" for (names, p), claim in marks]
                print(
                    f"{case.seed} {case.situation:15} {case.verdict:16} {'; '.join(named) or case.notes[:90]}",
                    flush=True,
                )
    show("Causes outside the library", bars(done), args.json)


if __name__ == "__main__":
    main()

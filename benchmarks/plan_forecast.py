"""Calibration of the forecast of a plan, on plants in MuJoCo whose effects are near the limit of detection.

    python benchmarks/plan_forecast.py --plants 30 --seed 1011000

A plant has no effect, one effect or two effects of 0.5 to 2 times the minimum detectable size in the first release, and
two further effects of 0.05 to 0.2 times this size. The poses of a first plan for the rig `paper` are recorded, 10 s
each. After each release that leaves the causes undecided, a forecast is made for the next one, two and three of these
releases, as far as they are recorded. It is compared with the diagnoses of these releases. The sampling error of the
calibration error is found by drawing plants with replacement. With `--adaptive`, each release is the first one of a new
plan. With `--own`, the plants are those of the simulated device.

Each plant is appended to the CSV file of `--file` (`_stored_forecasts.py`). The table is that of all plants in the file
with the same options and version. A later run skips these plants; `--plants 0` prints the table only.

The net calibration error is defined in `benchmarks/_net_calibration.py`. With `--adaptive`, it was 0.040 on 76 plants
(seeds 3106050 to 3106125; 249 forecasts; calibration error 0.069, of an exact forecast 0.051). On 24 own plants
(`single:faint`, from 2017000 on; 21 forecasts) it was 0 with an earlier forecast.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from _bars import Bar, at_most, options, show
from _net_calibration import net_calibration_error
from _stored_forecasts import Forecast, claims_by_plant, store, stored
from _trial_cases import Case, hidden
from plan_other_engine import AMPLITUDES, Plant, near_paper

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import Knowledge, known_after, known_before
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.planning.sequence import Planner, SequenceStep
from dpr_lab.planning.stopping import decided
from dpr_lab.planning.summary import summed_up
from dpr_lab.planning.worth.criteria import detectable
from dpr_lab.planning.worth.objective import Objective
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.trials.next_release import EQUAL_TIMES
from dpr_lab.trials.score import Claim
from dpr_lab.trials.summary import brier, calibration_error, error_if_exact, reliability
from sim_device.trials.offline_recorder import record

EFFECTS_OF_PLANT = (1, 1, 2, 1, 0, 1)
"""Number of effects near the limit of detection, by the seed modulo 6."""
FURTHER = 3
"""Number of releases after the first one."""
LIMITS = PlanLimits(recording=EQUAL_TIMES)
"""Limits of the plans; all releases last 10 s."""
SIZES, SMALL = (0.5, 2.0), (0.05, 0.2)
"""Ranges of sizes, in units of the minimum detectable size in the first release."""


@dataclass(frozen=True, slots=True)
class Menu:
    """Releases that are recorded, and the minimum detectable sizes in the first one."""

    releases: list[CandidateRelease]
    least: dict[str, float]


def menu() -> Menu:
    """Releases of a first plan for the rig `paper`."""
    rig = load_rig("paper")
    made = plan(rig, limits=LIMITS, count=1 + FURTHER)
    releases = [CandidateRelease(one.theta1_rad, one.theta2_rad, one.duration_s) for one in made.releases]
    known = known_before(rig)
    (first,) = informed(releases[:1], known.model)
    sizes = detectable(known, known.prior + first.information, SIGMAS, AMPLITUDES)
    return Menu(releases, {name: sizes[name][amplitude] or np.nan for name, amplitude in AMPLITUDES.items()})


def faint(seed: int, least: dict[str, float]) -> Plant:
    """Random plant with effects near the limit of detection, and two smaller effects."""
    rng = np.random.default_rng([seed, 68])
    Z, rig = near_paper(rng)
    names, count = rng.permutation(list(AMPLITUDES)).tolist(), EFFECTS_OF_PLANT[seed % len(EFFECTS_OF_PLANT)]
    ranges = [SIZES] * count + [SMALL] * 2
    sizes = {
        name: least[name] * float(np.exp(rng.uniform(*np.log(limits))))
        for name, limits in zip(names, ranges, strict=False)
    }
    return Plant(Z, names[0] if count else "", sizes[names[0]] if count else 0.0, rig, sizes)


@dataclass(frozen=True, slots=True)
class Subject:
    """Rig whose releases are recorded."""

    rig: Rig
    record: Callable[[CandidateRelease, int], Run]
    """Function that records a release, given the number of earlier releases."""


def in_mujoco(seed: int, least: dict[str, float]) -> Subject:
    """Plant of MuJoCo near the limit of detection."""
    plant, rng = faint(seed, least), np.random.default_rng([seed, 69])
    return Subject(plant.rig, lambda release, _: plant.record(release, rng))


def own(seed: int, draw: str) -> Subject:
    """Plant of the simulated device, such as `single:faint` or `background:subtle`."""
    config, rig = hidden(Case("", draw, seed))

    def recorded(release: CandidateRelease, before: int) -> Run:
        pose = Pose(theta1=release.theta1, theta2=release.theta2)
        (run,) = record(config, rig.model_copy(update={"poses": {"P": pose}}), release.duration_s, before=before)
        return replace(run, rig_sha256=rig.sha256)

    return Subject(rig, recorded)


@dataclass(frozen=True, slots=True)
class Look:
    """Diagnosis of the runs recorded so far, and the next releases."""

    runs: list[Run]
    diagnosis: Diagnosis
    steps: list[SequenceStep]
    """Next releases; empty if the causes are decided."""

    def plan(self, rig: Rig) -> Plan:
        """Compose the plan of the next releases, with its forecast."""
        limits = PlanLimits()
        return summed_up(Objective.of(known_after(self.runs, rig, self.diagnosis), limits), self.steps, limits, 0.0)


def given_steps(known: Knowledge, releases: Sequence[CandidateRelease]) -> list[SequenceStep]:
    """Sequence that consists of given releases."""
    return [SequenceStep(one.release, one.information, 1.0, 0.0) for one in informed(releases, known.model)]


def looks_at(subject: Subject, releases: Sequence[CandidateRelease]) -> list[Look]:
    """Record and diagnose the releases of one plant, until the causes are decided.

    Args:
        subject: the plant
        releases: the releases to record; empty: each release is the first one of a new plan
    """
    rig, runs, looks = subject.rig, list[Run](), list[Look]()
    release = releases[0] if releases else first_of(plan(rig, limits=LIMITS, count=1))
    for left in reversed(range(1 + FURTHER)):
        runs.append(replace(subject.record(release, len(runs)), name=f"P{len(runs)}"))
        diagnosis = diagnose(runs, rig)
        if decided(diagnosis):
            return [*looks, Look([*runs], diagnosis, [])]
        known = known_after(runs, rig, diagnosis)
        if releases:
            steps = given_steps(known, releases[len(runs) :] or [release])
        else:
            planner = Planner(Objective.of(known, LIMITS), LIMITS, np.random.default_rng(0))
            steps = planner.sequence(max(left, 1), None)
        looks.append(Look([*runs], diagnosis, steps))
        if not steps or looks[-1].plan(rig).state == "bench check":
            break
        release = steps[0].release
    return looks


def forecasts_of(looks: Sequence[Look], rig: Rig, plants: str, seed: int) -> list[Forecast]:
    """Forecasts along the releases of one plant, and whether they were right.

    The releases end with the first plan that requires no further release.
    """
    plans = list[Plan]()
    for look in looks:
        plans.append(look.plan(rig))
        if plans[-1].state != "record":
            break
    ended, today = plans[-1].state != "record", datetime.now(UTC).date().isoformat()
    rows = list[Forecast]()
    for k, made in enumerate(plans):
        row = Forecast(plants, today, seed, k + 1, looks[k].diagnosis.verdict, made.state, 0, None, None)
        rows += [
            replace(row, further=number, probability=probability, true=ended and len(plans) - 1 - k <= number)
            for number, probability in enumerate(made.forecast[: FURTHER - k], 1)
        ] or [row]
    return rows


def first_of(made: Plan) -> CandidateRelease:
    """First release of a plan."""
    first = made.releases[0]
    return CandidateRelease(first.theta1_rad, first.theta2_rad, first.duration_s)


def interval90(plants: Sequence[Sequence[Claim]], draws: int = 500) -> tuple[float, float]:
    """90 % interval of the calibration error, by drawing plants with replacement."""
    rng = np.random.default_rng(0)
    drawn = [
        calibration_error([claim for k in rng.integers(len(plants), size=len(plants)) for claim in plants[k]])
        for _ in range(draws)
    ]
    low, high = np.nanquantile(drawn, [0.05, 0.95]).tolist()
    return low, high


def standard_error(plants: Sequence[Sequence[Claim]]) -> float:
    """Estimate the standard error of the net calibration error by the jackknife over the plants."""
    errors = np.array([net_calibration_error([*plants[:k], *plants[k + 1 :]]) for k in range(len(plants))])
    return float(np.std(errors) * np.sqrt(len(errors) - 1))


def bars(forecasts: Sequence[Forecast]) -> list[Bar]:
    """Lines of the table: errors of all forecasts, reliability by bin, and errors by verdict."""
    plants = claims_by_plant(forecasts)
    claims = [claim for each in plants for claim in each]
    if not claims:
        return [Bar("plants; none has a forecast", "-", len(plants), None)]
    low, high = interval90(plants)
    rows = [
        Bar(f"{row['claims']} forecasts of {row['stated']:.2f} on average: share that occurred", "-", row["true"], None)
        for row in reliability(claims)
    ]
    for verdict in sorted({one.verdict for one in forecasts if one.probability is not None}):
        some = claims_by_plant([one for one in forecasts if one.verdict == verdict and one.probability is not None])
        label = f"{verdict}: {len(some)} plants, {sum(map(len, some))} forecasts: net calibration error"
        rows.append(Bar(label, "-", net_calibration_error(some), None))
    counts = f"{len(claims)} forecasts of {sum(map(bool, plants))} of {len(plants)} plants"
    return [
        at_most(f"net calibration error, {counts}", net_calibration_error(plants), 0.05),
        Bar("its standard error", "-", standard_error(plants), None),
        Bar("calibration error", "-", calibration_error(claims), None),
        Bar("90 % interval: from", "-", low, None),
        Bar("90 % interval: to", "-", high, None),
        Bar("of an exact forecast", "-", error_if_exact(claims), None),
        Bar("Brier score", "-", brier(claims), None),
        Bar("mean forecast", "-", float(np.mean([claim.probability for claim in claims])), None),
        Bar("share that occurred", "-", float(np.mean([claim.true for claim in claims])), None),
        *rows,
    ]


def main() -> None:
    """Draw, record, diagnose and store the plants that the file lacks; print the table of the file."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0, help="of the first plant")
    parser.add_argument("--own", default="", help="draw of own plants, such as single:faint or background:subtle")
    parser.add_argument("--adaptive", action="store_true", help="follow a new plan after each release")
    parser.add_argument("--file", type=Path, default=Path("out/plan_forecast.csv"), help="single forecasts of all runs")
    args = parser.parse_args()
    kind = f"{args.own or 'mujoco'}, {'adaptive' if args.adaptive else 'first plan'}"
    finished = {one.seed for one in stored(args.file, kind)}
    seeds = range(args.seed, args.seed + (2 if args.quick else args.plants))
    missing = [seed for seed in seeds if seed not in finished]
    chosen = menu() if missing else Menu([], {})
    for seed in missing:
        subject = own(seed, args.own) if args.own else in_mujoco(seed, chosen.least)
        looks = looks_at(subject, [] if args.adaptive else chosen.releases)
        rows = forecasts_of(looks, subject.rig, kind, seed)
        store(args.file, rows)
        judged = [f"{one.probability:.2f} {'yes' if one.true else 'no'}" for one in rows if one.further]
        print(f"plant {seed}: {judged}", file=sys.stderr, flush=True)
    show("forecast of a decision", bars(stored(args.file, kind)), args.json)


if __name__ == "__main__":
    main()

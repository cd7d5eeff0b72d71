"""Reliability of the diagnosis on plants with hidden effects, compared with targets.

    python benchmarks/diagnosis.py --cases 40            all groups, 40 trials in each
    python benchmarks/diagnosis.py --quick               6 trials in each group
    python benchmarks/diagnosis.py --real FOLDER         also recordings of real rigs

Out-of-library effects that were reserved for evaluation are listed separately from those with which thresholds were
chosen.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from _bars import Bar, at_least, at_most, options, show
from _real import real_bars
from _trial_cases import Case, Scored, hidden, run_all, warm_up

from dpr_lab.trials.score import TrialOutcome
from dpr_lab.trials.summary import share, summary
from sim_device.plant.foreign import FOREIGN, FORMS, OUTSIDE
from sim_device.trials.draw import visible_effects
from sim_device.trials.offline_recorder import record


def _foreign(names: Sequence[str], held_back: bool) -> list[str]:
    return [name for name in names if FOREIGN[name].held_back == held_back]


GROUPS: dict[str, str] = {
    "single": "single:clear",
    "subtle": "single:subtle",
    "pair": "pair:clear",
    "triple": "triple:clear",
    "clean": "clean",
    "dirty": "dirty:clear",
    "form": "form:clear:tuning",
    "form, held back": "form:clear:held_back",
    "outside": "outside:clear:tuning",
    "outside, held back": "outside:clear:held_back",
    "background": "background:clear",
}
"""Draw specification of each group of trials."""

EACH: dict[str, Sequence[str]] = {
    "single": visible_effects(),
    "subtle": visible_effects(),
    "form": _foreign(FORMS, False),
    "form, held back": _foreign(FORMS, True),
    "outside": _foreign(OUTSIDE, False),
    "outside, held back": _foreign(OUTSIDE, True),
}
"""Effects through which the trials of a group cycle; the effects of other groups are random."""

FIRST_SEED = 100_000
"""First seed of the benchmark. The calibration uses lower seeds."""

APART = 5000
"""Difference between the first seeds of successive groups."""


def trials_of(names: Sequence[str], count: int, seed: int) -> list[Case]:
    """`count` trials of each named group, with the groups in turn."""
    return [_case(name, seed + APART * list(GROUPS).index(name), i) for i in range(count) for name in names]


def _case(group: str, first: int, number: int) -> Case:
    draw = GROUPS[group]
    if group in EACH:
        kind, level, *_ = draw.split(":")
        draw = f"{kind}:{level}:{EACH[group][number % len(EACH[group])]}"
    return Case(group, draw, first + number)


Rate = Callable[[TrialOutcome], bool]


def often(name: str, outcomes: Sequence[TrialOutcome], holds: Rate, target: float) -> list[Bar]:
    """Return the result for a share that should be high; empty without trials."""
    return [at_least(f"{name} (of {len(outcomes)})", share(outcomes, holds), target)] if outcomes else []


def seldom(name: str, outcomes: Sequence[TrialOutcome], holds: Rate, target: float) -> list[Bar]:
    """Return the result for a share that should be low; empty without trials."""
    return [at_most(f"{name} (of {len(outcomes)})", share(outcomes, holds), target)] if outcomes else []


def bars(done: Sequence[Scored]) -> list[Bar]:
    """All results for which there are trials."""
    groups = {name: [s.outcome for s in done if s.case.group == name] for name in GROUPS}
    dirty_clean, dirty_single = (_there(groups["dirty"], effect) for effect in (False, True))
    right, all_of_them, alarm = (lambda o: o.first), (lambda o: o.exact), (lambda o: not o.silent)
    return [
        *often("single, gap >= 2 x noise: first cause correct", groups["single"], right, 0.99),
        *often("single: among the first three", groups["single"], lambda o: o.top3, 0.995),
        *often("single, gap 0.5-1.5 x noise: first cause correct", groups["subtle"], right, 0.95),
        *often("pair 1 : 0.2: exactly both named", groups["pair"], all_of_them, 0.90),
        *often("pair: first cause correct", groups["pair"], right, 0.98),
        *often("triple: first cause correct", groups["triple"], right, 0.98),
        *often("triple: exactly all three named", groups["triple"], all_of_them, 0.80),
        *seldom("clean: false alarms", groups["clean"], alarm, 0.02),
        *seldom("dirty encoders, clean rig: false alarms", dirty_clean, alarm, 0.02),
        *seldom("dirty encoders: a fault not reported", groups["dirty"], lambda o: bool(o.faults_missed), 0.02),
        *often("dirty encoders, single: first cause correct", dirty_single, right, 0.96),
        *often("one dominant and several small effects: first cause correct", groups["background"], right, 0.93),
        *seldom(
            "one dominant and several small effects: incorrect cause with a probability above 0.5",
            groups["background"],
            lambda o: o.wrong_name,
            0.02,
        ),
        *(bar for name in ("form", "form, held back") for bar in form_bars(name, groups[name])),
        *(bar for name in ("outside", "outside, held back") for bar in outside_bars(name, groups[name])),
        *measure_bars([s.outcome for s in done]),
    ]


def form_bars(name: str, outcomes: Sequence[TrialOutcome]) -> list[Bar]:
    """Results for effects of the library in another functional form."""
    return [
        *often(f"{name}: correct family first", outcomes, lambda o: o.first, 0.95),
        *often(f"{name}: no absent cause named", outcomes, lambda o: not o.invented, 0.85),
    ]


def outside_bars(name: str, outcomes: Sequence[TrialOutcome]) -> list[Bar]:
    """Results for effects that the library does not contain."""
    return [
        *seldom(f"{name}: incorrect cause with a probability above 0.5", outcomes, lambda o: o.wrong_name, 0.03),
        *often(f"{name}: unknown cause reported", outcomes, lambda o: o.admitted, 0.95),
    ]


def measure_bars(outcomes: Sequence[TrialOutcome]) -> list[Bar]:
    """Results for the probabilities of all trials.

    Sizes, gap and time are evaluated for the trials that the library can explain.
    """
    known = summary([o for o in outcomes if o.kind in ("single", "pair", "triple", "clean")])
    coverage = known["interval_coverage"]
    return [
        at_most("expected calibration error", summary(outcomes)["calibration_error"], 0.05),
        at_most("effect size, median error", known["size_error"], 0.01),
        Bar("90 % intervals that contain the true value", "0.84 .. 0.95", coverage, 0.84 <= coverage <= 0.95),
        at_least("gap reduction on held-out data, median of named", known["gap_closed"], 0.9),
        at_most("CPU seconds per case, median", known["seconds"], 10),
        at_most("CPU seconds per case, longest", known["seconds_max"], 30),
    ]


def _there(outcomes: Sequence[TrialOutcome], effect: bool) -> list[TrialOutcome]:
    return [o for o in outcomes if bool(o.truth) == effect]


def parsed() -> argparse.Namespace:
    """Parse the command line."""
    parser = options(__doc__)
    parser.add_argument("--cases", type=int, default=40, help="trials of each group (default: %(default)s)")
    parser.add_argument("--only", action="append", choices=list(GROUPS), help="only this group, repeatable")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="seed of the first trial (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: all cores)")
    parser.add_argument("--real", type=Path, metavar="FOLDER", help="recordings of real rigs to diagnose as well")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write every trial as a line of JSON")
    return parser.parse_args()


def campaign(cases: Sequence[Case], workers: int, keep: Path | None) -> list[Scored]:
    """Run all trials, and print each result when its trial ends."""
    begin, done = time.perf_counter(), []
    plant, rig = hidden(cases[0])
    warm_up(rig, record(plant, rig))
    for number, result in enumerate(run_all(cases, workers), 1):
        if not isinstance(result, Scored):
            print(f"{result[0].draw}, seed {result[0].seed}: {result[1]}", file=sys.stderr, flush=True)
            continue
        done.append(result)
        if keep is not None:
            with keep.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**asdict(result.case), **result.outcome.to_json()}) + "\n")
        print(f"\r{number}/{len(cases)}, {time.perf_counter() - begin:.0f} s", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return done


def main() -> None:
    """Run and score the trials, and print the results."""
    chosen = parsed()
    names = chosen.only or list(GROUPS)
    cases = trials_of(names, 6 if chosen.quick else chosen.cases, chosen.seed)
    done = campaign(cases, chosen.workers, chosen.keep)
    made = [at_most(f"trials that ended in an error (of {len(cases)})", len(cases) - len(done), 0), *bars(done)]
    if chosen.real is not None:
        made += real_bars(chosen.real)
    wrong = [astray(scored) for scored in done if is_astray(scored.outcome)]
    show("Diagnosis on blind trials", made, chosen.json, astray=wrong)
    if not chosen.json:
        print("\n".join(wrong))


def is_astray(outcome: TrialOutcome) -> bool:
    """Whether a true effect is not named, or an incorrect effect is named."""
    if not outcome.truth:
        return not outcome.silent
    return outcome.invented or (outcome.kind not in ("form", "outside") and not outcome.exact)


def astray(scored: Scored) -> str:
    """Named and true effects of a trial, with the seed that reproduces its plant."""
    outcome = scored.outcome
    result, there = (" + ".join(names) or "nothing" for names in (outcome.named, outcome.truth))
    return f"{scored.case.draw}, seed {scored.case.seed}: {there} -> {result} ({outcome.verdict})"


if __name__ == "__main__":
    main()

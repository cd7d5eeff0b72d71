"""How well the diagnosis does on plants whose effects it does not know, beside its targets.

    python benchmarks/diagnosis.py --cases 40            all groups, 40 trials each
    python benchmarks/diagnosis.py --quick               6 each
    python benchmarks/diagnosis.py --prototype FOLDER    beside the prototype of that folder (diag.py)

Held-back foreign effects are shown apart from those that the thresholds may have been tuned on.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from _trial_cases import Case, Scored, hidden, run_all, warm_up

from dpr_lab.trials.score import Outcome
from dpr_lab.trials.summary import calibration_error, confusion, share, summary
from sim_device.direct import record

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
}
"""Group of trials -> what is drawn."""

FIRST_SEED = 100_000
"""Calibration draws below, the benchmark above."""


@dataclass(frozen=True, slots=True)
class Bar:
    """One measured figure beside its target."""

    bar: str
    target: str
    measured: float
    trials: int
    ok: bool


Rate = Callable[[Outcome], bool]


def at_least(name: str, outcomes: Sequence[Outcome], holds: Rate, target: float) -> Bar:
    """A share that should be high."""
    measured = share(outcomes, holds)
    return Bar(name, f">= {target:g}", measured, len(outcomes), measured >= target)


def at_most(name: str, outcomes: Sequence[Outcome], holds: Rate, target: float) -> Bar:
    """A share that should be low."""
    measured = share(outcomes, holds)
    return Bar(name, f"<= {target:g}", measured, len(outcomes), measured <= target)


def within(name: str, measured: float, lowest: float, highest: float, trials: int) -> Bar:
    """A figure that should lie between two values."""
    target = f"{lowest:g} .. {highest:g}" if math.isfinite(highest) and lowest > 0 else ""
    target = target or (f"<= {highest:g}" if math.isfinite(highest) else f">= {lowest:g}")
    return Bar(name, target, measured, trials, lowest <= measured <= highest)


def bars(done: Sequence[Scored]) -> list[Bar]:
    """All bars of which there are trials."""
    groups = {name: [s.outcome for s in done if s.case.group == name] for name in GROUPS}
    dirty = groups.pop("dirty")
    known = [o for name in ("single", "subtle", "pair", "triple") for o in groups[name]]
    library = [*known, *groups["clean"]]
    every = [s.outcome for s in done]
    right, all_of_them = (lambda o: o.first), (lambda o: o.exact)
    counted = summary(library)
    made = [
        at_least("single, gap >= 2 x noise: first right", groups["single"], right, 0.99),
        at_least("single: among the first three", groups["single"], lambda o: o.top3, 0.995),
        at_least("single, gap 0.5-1.5 x noise: first right", groups["subtle"], right, 0.95),
        at_least("pair 1 : 0.2: exactly both", groups["pair"], all_of_them, 0.90),
        at_least("pair: first right", groups["pair"], right, 0.98),
        at_least("triple: first right", groups["triple"], right, 0.98),
        at_least("triple: exactly all three", groups["triple"], all_of_them, 0.80),
        at_most("clean: false alarms", groups["clean"], lambda o: not o.silent, 0.02),
        at_most("dirty encoders, clean rig: false alarms", _there(dirty, False), lambda o: not o.silent, 0.02),
        at_most("dirty encoders: a fault not named", dirty, lambda o: bool(o.faults_missed), 0.02),
        at_least("dirty encoders, single: first right", _there(dirty, True), right, 0.96),
    ]
    for name in ("form", "form, held back"):
        made += [
            at_least(f"{name}: right family first", groups[name], right, 0.95),
            at_least(f"{name}: nothing invented", groups[name], lambda o: not o.invented, 0.85),
        ]
    for name in ("outside", "outside, held back"):
        made += [
            at_most(f"{name}: wrong name above 0.5", groups[name], lambda o: o.wrong_name, 0.03),
            at_least(f"{name}: admitted", groups[name], lambda o: o.admitted, 0.95),
        ]
    made += [
        within(
            "expected calibration error", calibration_error([c for o in every for c in o.claims]), 0, 0.05, len(every)
        ),
        within("effect size, median error", counted["size_error"], 0, 0.01, len(library)),
        within("90 % intervals that hold the truth", counted["interval_coverage"], 0.84, 0.95, len(library)),
        within("held-out gap closed, median of named", counted["gap_closed"], 0.9, math.inf, len(library)),
        within("seconds a case on one core, median", counted["seconds"], 0, 10, len(library)),
        within("seconds a case on one core, longest", counted["seconds_max"], 0, 30, len(library)),
    ]
    return [bar for bar in made if bar.trials]


def _there(outcomes: Sequence[Outcome], effect: bool) -> list[Outcome]:
    return [o for o in outcomes if bool(o.truth) == effect]


def parsed() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=40, help="trials of each group (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="6 trials of each group")
    parser.add_argument("--only", action="append", choices=list(GROUPS), help="only this group, repeatable")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first trial (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: all cores)")
    parser.add_argument("--prototype", type=Path, metavar="FOLDER", help="prototype to run on the single effects")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="write every trial as a line of JSON")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    return parser.parse_args()


def campaign(cases: Sequence[Case], workers: int, keep: Path | None) -> list[Scored]:
    """All trials, told as they come."""
    begin, done = time.perf_counter(), []
    warm_up(*reversed(_recorded(cases[0])))
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


def _recorded(case: Case):
    plant, rig = hidden(case)
    return record(plant, rig), rig


def main() -> None:
    """Run, score, print."""
    options = parsed()
    count = 6 if options.quick else options.cases
    names = options.only or list(GROUPS)
    cases = [Case(name, GROUPS[name], options.seed + i) for i in range(count) for name in names]
    done = campaign(cases, options.workers, options.keep)
    failed = len(cases) - len(done)
    made = bars(done)
    if options.prototype is not None:
        from _prototype import prototype_bars

        made += prototype_bars(options.prototype, [case for case in cases if case.group in ("single", "clean")])
    by_group = {name: confusion([s.outcome for s in done if s.case.group == name]) for name in names}
    if options.json:
        print(json.dumps({"bars": [asdict(bar) for bar in made], "failed": failed, "confusion": by_group}, indent=2))
        return
    print(f"{'bar':<46} {'target':>12} {'measured':>10} {'trials':>7}  ok")
    for bar in made:
        print(f"{bar.bar:<46} {bar.target:>12} {bar.measured:>10.4g} {bar.trials:>7}  {'yes' if bar.ok else 'NO'}")
    print(f"{failed} of {len(cases)} trials failed with an error")
    for name, table in by_group.items():
        for there, said in table.items():
            wrong = {answer: times for answer, times in said.items() if answer != there}
            if wrong:
                print(f"{name}: {there} -> {', '.join(f'{answer} {times}' for answer, times in wrong.items())}")


if __name__ == "__main__":
    main()

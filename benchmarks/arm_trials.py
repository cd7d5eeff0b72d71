"""Blind trials of rigs with a free or driven arm and with one rod or two.

The results are the shares of correct first causes, of incorrect causes with a high probability, and of false alarms,
and the time.

    python benchmarks/arm_trials.py [--each 10] [--seed 91000] [--quick] [--json] [--folder out/arm_trials]

There are four campaigns, each as in `dpr-lab trials campaign --arm`. Four of five trials hide one effect at joint 0 or
of the motor; the fifth hides none. An interrupted campaign in the folder is continued.
`benchmarks/moving_arm_diagnosis.py` makes the same test on plants in MuJoCo.
"""

import os
import statistics
import tempfile
from pathlib import Path

from _bars import Bar, at_least, at_most, options, show

from dpr_lab.trials.campaign import Campaign, run_campaign
from dpr_lab.trials.score import TrialOutcome
from dpr_lab.trials.sealing import Kind, TrialArm

RIGS = ("furuta", "driven_double")
KINDS = (*[Kind.SINGLE] * 4, Kind.CLEAN)


def bars(outcomes: list[TrialOutcome], failures: int) -> list[Bar]:
    """Scores of all trials."""
    hidden, clean = ([one for one in outcomes if bool(one.truth) is wanted] for wanted in (True, False))
    sizes = [size for one in hidden for size in one.sizes if size.leads]
    return [
        at_least(f"first cause correct, of {len(hidden)}", sum(one.first for one in hidden), round(0.95 * len(hidden))),
        at_most(
            "trials with an incorrect cause with a probability above 0.5", sum(one.wrong_name for one in hidden), 1
        ),
        at_most(f"false alarms, of {len(clean)}", sum(not one.silent for one in clean), 0),
        Bar("error of the leading size, median", "-", statistics.median(size.relative for size in sizes), None),
        Bar("90 % intervals that contain it", "0.86 .. 0.94", sum(s.covered for s in sizes) / len(sizes), None),
        Bar("CPU seconds of a diagnosis, median", "-", statistics.median(one.seconds for one in outcomes), None),
        at_most("trials that ended with an error", failures, 0),
    ]


def main() -> None:
    """Run the missing trials, and print the scores of all trials."""
    parser = options(__doc__)
    parser.add_argument("--each", type=int, default=10, help="trials of each campaign (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=91000, help="seed of the first trial (default: %(default)s)")
    parser.add_argument("--folder", type=Path, help="where finished trials are kept")
    args = parser.parse_args()
    outcomes, failures = [], 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.folder or Path(scratch)
        for arm in TrialArm:
            for rig in RIGS:
                campaign = Campaign(KINDS, seed=args.seed, rig=rig, plant=rig, arm=arm)
                each = 2 if args.quick else args.each
                tried = run_campaign(campaign, each, folder / f"{arm}-{rig}", jobs=os.cpu_count() or 1)
                for one in tried.outcomes:
                    print(f"{arm} {rig} {one.seed}: {', '.join(one.truth) or 'clean'}: {one.verdict}"
                          f" {', '.join(one.named)}", flush=True)  # fmt: skip
                outcomes += tried.outcomes
                failures += len(tried.failures)
    show("blind trials with a free or driven arm", bars(outcomes, failures), args.json)


if __name__ == "__main__":
    main()

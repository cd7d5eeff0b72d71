"""Standard deviations of the ratios after a plan's releases, relative to those after the menu's, in equal time.

    python benchmarks/plan_ratios.py --plants 10 --seed 1

Plants like `paper` without an effect are recorded by the menu (X1, X2, X3 of 10 s) and by plans, then identified. One
plan has as many minutes at the rig as the menu, placing included; another has three releases of 10 s. The ratios are
geometric means over the five ratios and over the plants.
"""

import sys

import numpy as np
from _bars import Bar, at_most, options, show
from _trial_cases import Case, hidden
from numpy.typing import NDArray

from dpr_lab.identification.identify import identify
from dpr_lab.planning.candidates import minutes, mounted_now
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.trials.next_release import EQUAL_TIMES, SEQUENTIAL
from sim_device.plant.config import PlantConfig
from sim_device.trials.offline_recorder import record

Array = NDArray[np.float64]

IN_EQUAL_TIME = "plan of the menu's minutes"


def menu_of(rig: Rig) -> list[CandidateRelease]:
    """A release from each pose of the rig file."""
    return [CandidateRelease(pose.theta1, pose.theta2, SEQUENTIAL.duration_s) for pose in rig.poses.values()]


def releases_of(made: Plan) -> list[CandidateRelease]:
    """The releases of a plan."""
    return [CandidateRelease(one.theta1_rad, one.theta2_rad, one.duration_s) for one in made.releases]


def planned(rig: Rig, budget_min: float) -> dict[str, list[CandidateRelease]]:
    """Plans before any recording, by their name."""
    equal = plan(rig, limits=PlanLimits(recording=EQUAL_TIMES), count=len(rig.poses))
    return {
        IN_EQUAL_TIME: releases_of(plan(rig, budget_min=budget_min)),
        f"plan of {len(rig.poses)} x {SEQUENTIAL.duration_s:g} s": releases_of(equal),
    }


def ratio_std(plant: PlantConfig, rig: Rig, releases: list[CandidateRelease]) -> Array:
    """(5,) standard deviations of the ratios after some releases."""
    runs = list[Run]()
    poses = {f"P{k}": Pose(theta1=one.theta1, theta2=one.theta2) for k, one in enumerate(releases)}
    for k, ((name, pose), release) in enumerate(zip(poses.items(), releases, strict=True)):
        runs += record(plant, rig.model_copy(update={"poses": {name: pose}}), release.duration_s, before=k)
    model = identify(runs, rig.model_copy(update={"poses": poses}))
    return np.array([ratio.std for ratio in model.ratios.values()])


def shares(seed: int) -> dict[str, float]:
    """Plan -> standard deviations over those of the menu, geometric mean of the ratios of one plant."""
    plant, rig = hidden(Case("clean", "clean", seed))
    menu, now = menu_of(rig), mounted_now(rig)
    of_menu = ratio_std(plant, rig, menu)
    made = planned(rig, sum(minutes(release, now, PlanLimits()) for release in menu))
    return {name: float(np.exp(np.log(ratio_std(plant, rig, each) / of_menu).mean())) for name, each in made.items()}


def main() -> None:
    """Draw, plan, record, identify, print."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0, help="of the first plant")
    args = parser.parse_args()
    every = list[dict[str, float]]()
    for seed in range(args.seed, args.seed + (1 if args.quick else args.plants)):
        every.append(shares(seed))
        print(f"plant {seed}: {every[-1]}", file=sys.stderr, flush=True)
    bars = list[Bar]()
    for name in every[0]:
        logs = np.log([each[name] for each in every])
        bars.append(at_most(f"{name}: standard deviations over the menu's", float(np.exp(logs.mean())), 0.6))
        if len(logs) > 1:
            error = float(np.exp(logs.std(ddof=1) / len(logs) ** 0.5))
            bars.append(Bar(f"{name}: standard error of this, factor", "-", error, None))
    show("ratios after planned releases", bars, args.json)


if __name__ == "__main__":
    main()

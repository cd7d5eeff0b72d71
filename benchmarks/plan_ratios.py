"""Accuracy of the ratios after the releases of a plan, relative to the menu, on plants in MuJoCo.

    python benchmarks/plan_ratios.py --plants 4 --repeats 5 --seed 1

Plants without an effect are recorded by the fixed menu (X1, X2, X3 of 10 s) and by plans made before any recording, and
then identified. There are three plans: without options, with the same minutes at the rig as the menu (including
placing), and with three releases of 10 s. Each plan is recorded several times, with other placement errors and other
noise. Two quantities are compared with those of the menu: the standard deviations that `identify` states, and the rms
error of the ratios over the repeats. Both are geometric means over the five ratios and over the plants.
"""

import sys
from dataclasses import dataclass, replace

import numpy as np
from _bars import Bar, at_most, options, show
from numpy.typing import NDArray
from plan_other_engine import Plant, drawn

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.identification.identify import identify
from dpr_lab.planning.candidates import minutes, mounted_now
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.rig import Rig
from dpr_lab.trials.next_release import EQUAL_TIMES, SEQUENTIAL

Array = NDArray[np.float64]

MENU = "menu"


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Accuracy of the ratios of one plant after the releases of one plan."""

    stated: Array
    """(5,) standard deviations that `identify` states, rms over the repeats."""
    error: Array
    """(5,) rms error over the repeats."""


def menu_of(rig: Rig) -> list[CandidateRelease]:
    """Releases of the menu, one from each pose of the rig file."""
    return [CandidateRelease(pose.theta1, pose.theta2, SEQUENTIAL.duration_s) for pose in rig.poses.values()]


def releases_of(made: Plan) -> list[CandidateRelease]:
    """Releases of a plan."""
    return [CandidateRelease(one.theta1_rad, one.theta2_rad, one.duration_s) for one in made.releases]


def planned(rig: Rig) -> dict[str, list[CandidateRelease]]:
    """Releases of the menu and of the plans before any recording, by name."""
    menu, now = menu_of(rig), mounted_now(rig)
    budget_min = sum(minutes(release, now, PlanLimits()) for release in menu)
    return {
        MENU: menu,
        "plan": releases_of(plan(rig)),
        "plan of the menu's minutes": releases_of(plan(rig, budget_min=budget_min)),
        f"plan of {len(menu)} x {SEQUENTIAL.duration_s:g} s": releases_of(
            plan(rig, limits=PlanLimits(recording=EQUAL_TIMES), count=len(menu))
        ),
    }


def accuracy(plant: Plant, releases: list[CandidateRelease], repeats: int, rng: np.random.Generator) -> Accuracy:
    """Identify several recordings of the same releases, and return the accuracy of the ratios."""
    stated, errors = [], []
    true = ratios(base_parameters(plant.Z, plant.rig.L1, plant.rig.g))
    for _ in range(repeats):
        runs = [replace(plant.record(release, rng), name=f"P{k}") for k, release in enumerate(releases)]
        result = list(identify(runs, plant.rig).ratios.values())
        stated.append([ratio.std for ratio in result])
        errors.append(np.array([ratio.value for ratio in result]) - true)
    return Accuracy(*(np.sqrt(np.mean(np.square(each), axis=0)) for each in (stated, errors)))


def shares(seed: int, repeats: int) -> dict[str, tuple[float, float]]:
    """Stated standard deviations and errors of each plan on one plant, relative to the menu.

    Both are geometric means over the ratios.
    """
    plant, rng = drawn(5 * seed + 4), np.random.default_rng(seed)
    assert not plant.effect, "each fifth plant has no effect"
    result = {name: accuracy(plant, each, repeats, rng) for name, each in planned(plant.rig).items()}
    of_menu = result.pop(MENU)
    return {
        name: (_mean(each.stated / of_menu.stated), _mean(each.error / of_menu.error)) for name, each in result.items()
    }


def _mean(values: Array) -> float:
    return float(np.exp(np.log(values).mean()))


def main() -> None:
    """Draw the plants, plan, record and identify, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--plants", type=int, default=4)
    parser.add_argument("--repeats", type=int, default=5, help="recordings of each plan")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first plant")
    args = parser.parse_args()
    every = list[dict[str, tuple[float, float]]]()
    for seed in range(args.seed, args.seed + (1 if args.quick else args.plants)):
        every.append(shares(seed, args.repeats))
        print(f"plant {seed}: {every[-1]}", file=sys.stderr, flush=True)
    bars = list[Bar]()
    for name in every[0]:
        for k, figure in enumerate(("stated standard deviations", "rms errors")):
            of_plants = np.array([each[name][k] for each in every])
            bars.append(at_most(f"{name}: {figure} over the menu's", _mean(of_plants), 0.6))
            if len(of_plants) > 1:
                error = float(np.exp(np.log(of_plants).std(ddof=1) / len(of_plants) ** 0.5))
                bars.append(Bar(f"{name}: standard error of this, factor", "-", error, None))
    show("ratios after planned releases", bars, args.json)


if __name__ == "__main__":
    main()

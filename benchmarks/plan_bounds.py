"""What a plan can gain at most over the fixed menu, in linear theory, by brute force over start poses.

    python benchmarks/plan_bounds.py

Ratios: the best three of a grid of poses by exchange, for the geometric mean of the standard deviations of the ratios
over those after X1, X2, X3. Causes: releases until one amplitude of the library is decided, for sizes of one to ten
times the smallest that the average release of the menu shows. An oracle knows the cause and takes the best pose for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from _bars import at_most, options, show
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.gap.classes.posterior import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.planning.candidates import spread_poses
from dpr_lab.planning.forecast import STOPPING
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import RATIO_COLUMNS, Knowledge, known_before
from dpr_lab.planning.limits import PlanLimits, RecordingTimes
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.worth.criteria import given, ratio_std
from dpr_lab.rig import Rig, load_rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Settings of the search."""

    duration_s: float = 10.0
    releases: int = 3
    grid: int = 36
    """Number of angles of each rod in the grid for the ratios."""
    poses: int = 120
    """Number of poses of the oracle."""
    restarts: int = 12
    times: tuple[float, ...] = tuple(np.geomspace(1.0, 10.0, 8).tolist())
    """Sizes, in units of the smallest that the average release of the menu shows."""


BOUNDS = Bounds()


def releases_from(theta: Sequence[tuple[float, float]]) -> list[CandidateRelease]:
    """Free swings from start poses."""
    return [CandidateRelease(a, b, BOUNDS.duration_s) for a, b in theta]


def information(known: Knowledge, theta: Sequence[tuple[float, float]]) -> Array:
    """(n, k, k) information of releases from start poses."""
    return np.array([one.information for one in informed(releases_from(theta), known.model)])


def best_ratios(known: Knowledge, menu_std: Array, count: int) -> float:
    """Least geometric mean of the ratios' standard deviations over those of the menu, by exchange of poses."""
    k = len(UNKNOWN_RATIOS)
    only = replace(known, model=replace(known.model, columns=known.model.columns[:k]))
    angles = np.linspace(0.0, 2 * np.pi, count, endpoint=False) + 0.05
    H, prior = information(only, [(a, b) for a in angles for b in angles]), known.prior[:k, :k]
    rng, least = np.random.default_rng(0), np.inf
    for _ in range(BOUNDS.restarts):
        chosen, before = rng.integers(len(H), size=BOUNDS.releases), np.inf
        means = np.full(1, np.inf)
        while True:
            for place in range(len(chosen)):
                others = prior + H[np.delete(chosen, place)].sum(axis=0)
                variances = np.diagonal(np.linalg.inv(others + H), axis1=1, axis2=2)[:, : len(RATIOS)]
                means = np.exp(np.log(np.sqrt(variances) / menu_std).mean(axis=1))
                chosen[place] = int(np.argmin(means))
            if means.min() > before - 1e-6:
                break
            before = float(means.min())
        least = min(least, before)
    return float(least)


def powers(known: Knowledge, H: Array) -> dict[str, Array]:
    """Amplitude -> its information, and that which the nearest other effect cannot imitate, per unit squared."""
    columns = list(range(RATIO_COLUMNS, len(known.prior)))
    G = given(known.prior + H, known.fitted, columns) - known.prior[np.ix_(columns, columns)]
    found: dict[str, Array] = {}
    for name, places in known.places.items():
        for k in (place - RATIO_COLUMNS for place in places):
            remaining = [G[k, k]]
            for other, of_other in known.places.items():
                related = {other} & {name, *EFFECTS[name].nested, *EFFECTS[name].twins} or name in EFFECTS[other].nested
                if not related:
                    rows = [i - RATIO_COLUMNS for i in of_other]
                    cross = G[rows, k]
                    left = G[k, k] - cross @ np.linalg.pinv(G[np.ix_(rows, rows)], 1e-12, True) @ cross
                    if left > (1 - THRESHOLDS.indistinguishable**2) * G[k, k]:  # below it, one class
                        remaining.append(left)
            found[f"{name} {known.model.columns[k + RATIO_COLUMNS].name}"] = np.array([G[k, k], min(remaining)])
    return found


def needed(powers_after: Sequence[Array], size: float) -> int:
    """Releases until an amplitude of this size is decided; one more than those given if it is not."""
    for number, (power, distinct) in enumerate(powers_after, 1):
        margin = STOPPING.margin if number == 1 else SIGMAS
        if size**2 * power >= margin**2 and size**2 * distinct / CALIBRATION.temperature >= STOPPING.separable:
            return number
    return len(powers_after) + 1


def releases_needed(known: Knowledge, menu: Array, planned: Array, pool: Array) -> dict[str, float]:
    """Mean releases until decided: by the menu, by plan, and by the oracle, whose second release always decides."""
    single = [powers(known, H) for H in menu]
    after = {
        name: [powers(known, H[: n + 1].sum(axis=0)) for n in range(len(H))]
        for name, H in {"menu": menu, "plan": planned}.items()
    }
    of_pool = [powers(known, H) for H in pool]
    counts: dict[str, list[int]] = {"menu": [], "plan": [], "oracle": []}
    for amplitude in single[0]:
        power = float(np.mean([one[amplitude][0] for one in single]))
        if power <= 0.0:
            continue
        for size in np.array(BOUNDS.times) * SIGMAS / np.sqrt(power):
            for name, steps in after.items():
                counts[name].append(needed([step[amplitude] for step in steps], float(size)))
            counts["oracle"].append(min(needed([one[amplitude]], float(size)) for one in of_pool))
    return {name: float(np.mean(values)) for name, values in counts.items()}


def planned_poses(rig: Rig) -> tuple[list[tuple[float, float]], Array]:
    """Start poses of a plan before any recording, and the standard deviations of the ratios after them."""
    times = RecordingTimes(shortest_s=BOUNDS.duration_s, longest_s=BOUNDS.duration_s)
    made = plan(rig, limits=PlanLimits(recording=times), count=BOUNDS.releases)
    stds = np.array(list(made.releases[-1].ratio_std.values()))
    return [(one.theta1_rad, one.theta2_rad) for one in made.releases], stds


def main() -> None:
    """Compare plan and bounds with the menu."""
    args = options(__doc__).parse_args()
    rig = load_rig("paper")
    known = known_before(rig)
    menu = information(known, [(pose.theta1, pose.theta2) for pose in rig.poses.values()])
    menu_std = ratio_std(known, known.prior + menu.sum(axis=0))
    poses, stds = planned_poses(rig)
    best = best_ratios(known, menu_std, 8 if args.quick else BOUNDS.grid)
    pool = spread_poses(PlanLimits(), 8 if args.quick else BOUNDS.poses, np.random.default_rng(0)).tolist()
    mean = releases_needed(known, menu, information(known, poses), information(known, pool))
    ratios = float(np.exp(np.log(stds / menu_std).mean()))
    bars = [
        at_most("ratios: standard deviation after the plan over that after X1-X3", ratios, 0.6),
        at_most("ratios: the same, best three poses", best, 0.6),
        at_most("releases until decided, plan over menu", mean["plan"] / mean["menu"], 0.6),
        at_most("releases until decided, oracle over menu", mean["oracle"] / mean["menu"], 0.6),
    ]
    show("bounds of a plan", bars, args.json)


if __name__ == "__main__":
    main()

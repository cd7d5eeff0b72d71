"""Upper bound of the gain of a plan over the fixed menu, in linear theory, by exhaustive search over start poses.

    python benchmarks/plan_bounds.py

For ratios, an exchange algorithm chooses the best three poses of a grid. The criterion is the geometric mean of the
standard deviations of the ratios, relative to those after X1, X2, X3 (the fixed menu). The search is then repeated with
one rod, a clamped elbow and added masses; all these releases last 10 s. For causes, the criterion is the number of
releases until one amplitude of the library is decided. The sizes are one to ten times the minimum detectable size of an
average release of the menu. An oracle knows the cause and uses the best pose for it. Both criteria are computed for the
duration of the menu's releases and for 30 s. Minutes for placing and recording are those of `dpr-lab plan`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from _bars import Bar, at_most, options, show
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.planning.candidates import minutes, mounted_now, mountings, spread_poses
from dpr_lab.planning.forecast import FORECAST
from dpr_lab.planning.information import informed
from dpr_lab.planning.knowledge import RATIO_COLUMNS, Acting, Knowledge, known_before, schur_complement
from dpr_lab.planning.limits import AllowedRods, PlanLimits, RecordingTimes
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease, MountedParts
from dpr_lab.planning.stopping import STOPPING
from dpr_lab.planning.worth.criteria import ratio_std
from dpr_lab.rig import Rig, load_rig
from dpr_lab.rig_tables import AddedMass

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bounds:
    """Settings of the search."""

    duration_s: float = 10.0
    """Duration of the menu's releases, s."""
    longest_s: float = 30.0
    """Default of the maximum duration of a planned release, s."""
    releases: int = 3
    grid: int = 36
    """Number of angles of each rod in the grid for the ratios."""
    mounted_grid: int = 12
    """Number of angles of each rod in the grid of releases with one rod, a clamped elbow or an added mass."""
    mass_kg: float = 0.1
    poses: int = 120
    """Number of poses from which the oracle chooses."""
    restarts: int = 12
    times: tuple[float, ...] = tuple(np.geomspace(1.0, 10.0, 8).tolist())
    """Sizes of effects, in units of the smallest size that the average release of the menu shows."""


BOUNDS = Bounds()


BOTH_RODS = MountedParts()


def information(
    known: Knowledge, theta: Sequence[tuple[float, float]], duration_s: float, parts: MountedParts = BOTH_RODS
) -> Array:
    """(n, k, k) information matrices of free swings from start poses."""
    one = parts.mounting in ("inner", "outer")
    swings = [CandidateRelease(a, a if one else b, duration_s, *parts[:2]) for a, b in theta]
    return np.array([one.information for one in informed(swings, known.model)])


def grid(count: int) -> list[tuple[float, float]]:
    """Start poses with `count` angles of each rod."""
    angles = np.linspace(0.0, 2 * np.pi, count, endpoint=False) + 0.05
    return [(a, b) for a in angles.tolist() for b in angles.tolist()]


def only_ratios(rig: Rig) -> Knowledge:
    """Knowledge about a rig without effects."""
    known, k = known_before(rig, Acting(frozenset({"both", "inner", "outer", "clamped"}))), len(UNKNOWN_RATIOS)
    prior = known.prior[:k, :k]
    return replace(
        known, model=replace(known.model, columns=known.model.columns[:k]), prior=prior, information=prior, places={}
    )


def mounted_differently(rig: Rig) -> list[MountedParts]:
    """Mountings: one rod, a clamped elbow, and a mass in the middle or at the end of either rod."""
    masses = tuple(
        AddedMass.model_validate({"rod": rod, "mass": BOUNDS.mass_kg, "position": share * length})
        for rod, length in (("inner", rig.L1), ("outer", rig.L2 or rig.L1))
        for share in (0.5, 1.0)
    )
    rods = AllowedRods(mounted=("both", "inner", "outer"), elbow=("free", "clamped"))
    every = mountings(rig, PlanLimits(rods=rods, masses=masses))
    return [parts for parts in every if parts.added is None or parts.mounting == "both"]


def best_ratios(known: Knowledge, menu_std: Array, H: Array) -> tuple[float, NDArray[np.int64]]:
    """Best releases for the ratios.

    An exchange algorithm minimises the geometric mean of the ratios' standard deviations, relative to those of the
    menu. Returns this minimum and the indices of the releases.
    """
    prior, rng = known.prior, np.random.default_rng(0)
    least: tuple[float, NDArray[np.int64]] = np.inf, np.zeros(0, dtype=np.int64)
    for _ in range(BOUNDS.restarts):
        chosen, before = np.array(rng.integers(len(H), size=BOUNDS.releases)), np.inf
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
        if before < least[0]:
            least = before, chosen.copy()
    return least


def powers(known: Knowledge, H: Array) -> dict[str, Array]:
    """Information about each amplitude, per unit squared.

    The first number is the whole information. The second is the part orthogonal to the most similar other effect.
    """
    columns = list(range(RATIO_COLUMNS, len(known.prior)))
    G = schur_complement(known.prior + H, known.fitted, columns) - known.prior[np.ix_(columns, columns)]
    result: dict[str, Array] = {}
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
            result[f"{name} {known.model.columns[k + RATIO_COLUMNS].name}"] = np.array([G[k, k], min(remaining)])
    return result


def needed(powers_after: Sequence[Array], size: float) -> int:
    """Return the number of releases until an amplitude of this size is decided.

    If it stays undecided, one more than the number of given releases.
    """
    for number, (power, distinct) in enumerate(powers_after, 1):
        margin = STOPPING.margin if number == 1 else SIGMAS
        if size**2 * power >= margin**2 and size**2 * distinct / CALIBRATION.temperature >= FORECAST.separable:
            return number
    return len(powers_after) + 1


def releases_needed(known: Knowledge, sequences: Mapping[str, Array], pools: Mapping[str, Array]) -> dict[str, float]:
    """Mean number of releases until an amplitude is decided, for fixed sequences and for oracles.

    The second release of an oracle always decides.

    Args:
        known: knowledge before any recording
        sequences: (releases, k, k) information of the menu and other sequences, by name
        pools: (poses, k, k) information of the poses of each oracle, by name
    """
    single = [powers(known, H) for H in sequences["menu"]]
    after = {name: [powers(known, H[: n + 1].sum(axis=0)) for n in range(len(H))] for name, H in sequences.items()}
    each = {name: [powers(known, H) for H in pool] for name, pool in pools.items()}
    counts: dict[str, list[int]] = {name: [] for name in (*sequences, *pools)}
    for amplitude in single[0]:
        power = float(np.mean([one[amplitude][0] for one in single]))
        if power <= 0.0:
            continue
        for size in np.array(BOUNDS.times) * SIGMAS / np.sqrt(power):
            for name, steps in after.items():
                counts[name].append(needed([step[amplitude] for step in steps], float(size)))
            for name, poses in each.items():
                counts[name].append(min(needed([one[amplitude]], float(size)) for one in poses))
    return {name: float(np.mean(values)) for name, values in counts.items()}


def planned_poses(rig: Rig, duration_s: float) -> tuple[list[tuple[float, float]], Array]:
    """Start poses of a plan before any recording, and the standard deviations of the ratios after them."""
    times = RecordingTimes(shortest_s=duration_s, longest_s=duration_s)
    made = plan(rig, limits=PlanLimits(recording=times), count=BOUNDS.releases)
    stds = np.array(list(made.releases[-1].ratio_std.values()))
    return [(one.theta1_rad, one.theta2_rad) for one in made.releases], stds


def ratio_bars(rig: Rig, planned_std: Mapping[float, Array], quick: bool) -> list[Bar]:
    """Return the standard deviations of the ratios after three releases, relative to those after the menu."""
    known, times = only_ratios(rig), BOUNDS.duration_s
    menu = information(known, [(pose.theta1, pose.theta2) for pose in rig.poses.values()], times)
    menu_std = ratio_std(known, known.prior + menu.sum(axis=0))
    free = information(known, grid(6 if quick else BOUNDS.grid), times)
    bars = [
        at_most(f"ratios: plan of {duration:g} s", float(np.exp(np.log(stds / menu_std).mean())), 0.6)
        for duration, stds in planned_std.items()
    ]
    bars.append(at_most("ratios: best three poses", best_ratios(known, menu_std, free)[0], 0.6))
    for parts in mounted_differently(rig)[1:]:
        poses = grid(4 if quick else BOUNDS.mounted_grid)
        if parts.mounting in ("inner", "outer"):
            poses = poses[:: round(len(poses) ** 0.5)]
        pool = np.concatenate([free, information(known, poses, times, parts)])
        least, chosen = best_ratios(known, menu_std, pool)
        used, added = int(np.count_nonzero(chosen >= len(free))), parts.added
        mass = "" if added is None else f", {added.mass:g} kg on the {added.rod} rod at {added.position:g} m"
        bars.append(at_most(f"ratios: {used} of the three with {parts.mounting}{mass}", least, 0.6))
    return bars


def main() -> None:
    """Compare the plan and the bounds with the fixed menu, and print the results."""
    args = options(__doc__).parse_args()
    rig, durations = load_rig("paper"), (BOUNDS.duration_s, BOUNDS.longest_s)
    known = known_before(rig)
    poses = {duration: planned_poses(rig, duration) for duration in durations}
    pool = spread_poses(PlanLimits(), 8 if args.quick else BOUNDS.poses, np.random.default_rng(0)).tolist()
    menu = [(pose.theta1, pose.theta2) for pose in rig.poses.values()]
    sequences = {"menu": information(known, menu, durations[0])}
    sequences |= {f"plan of {s:g} s": information(known, theta, s) for s, (theta, _) in poses.items()}
    sequences |= {f"menu of {durations[1]:g} s": information(known, menu, durations[1])}
    pools = {f"oracle of {s:g} s": information(known, pool, s) for s in durations}
    mean = releases_needed(known, sequences, pools)
    bars = ratio_bars(rig, {s: stds for s, (_, stds) in poses.items()}, args.quick)
    bars.append(at_most("releases until decided over the menu's: one for every cause", 1 / mean["menu"], 0.6))
    of_release = {s: minutes(CandidateRelease(0.0, 0.0, s), mounted_now(rig), PlanLimits()) for s in durations}
    for name, count in mean.items():
        if name != "menu":
            longer = of_release[durations[name.endswith(f"{durations[1]:g} s")]] / of_release[durations[0]]
            bars.append(at_most(f"releases until decided over the menu's: {name}", count / mean["menu"], 0.6))
            bars.append(at_most(f"minutes until decided over the menu's: {name}", longer * count / mean["menu"], 0.6))
    show("bounds of a plan", bars, args.json)


if __name__ == "__main__":
    main()

"""Reliability of `dpr-lab drift` on rigs that changed and on rigs that did not.

False-alarm rate and power of the statistical test are measured with tens of thousands of random estimates, for several
designs of groups and runs. Recordings of simulated plants verify that estimates fitted to runs have the same
properties. In these plants, the friction of joint 1 changes by three standard deviations of a run's estimate, with and
without random scatter from run to run.

    python benchmarks/drift.py [--quick] [--json]
"""

from collections.abc import Iterator

import numpy as np
from _bars import Bar, at_least, at_most, options, show

from dpr_lab.drift.changes import Drift, DriftSettings, changes
from dpr_lab.drift.estimates import Estimates, estimate_each
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.shown import percent
from sim_device.plant.config import PlantConfig, load_plant
from sim_device.trials.offline_recorder import record

POSES = ("X1", "X2", "X3")
BETWEEN_POSES = {"X1": 0.0, "X2": 5.0, "X3": -3.0}
"""Error of the model at each pose, in standard deviations of a run's estimate."""
PLANS = ((2, 7, POSES[:1]), (2, 3, POSES), (4, 5, POSES[:1]), (4, 2, POSES), (3, 3, POSES))
"""Designs: number of groups, number of runs from each pose in a group, and poses."""
QUICK = DriftSettings(draws=2000)
"""Settings for the many tests of this benchmark. Critical values accurate to a tenth are sufficient."""
CHANGE = 3.0
"""Change of a parameter, in standard deviations of a run's estimate."""
SCATTER = 0.01
"""Relative scatter of the friction from run to run."""


def main() -> None:
    """Print the results."""
    asked = options(__doc__).parse_args()
    drawn, whole = (400, 4) if asked.quick else (4000, 40)
    bars = [bar for plan in PLANS for bar in drawn_bars(*plan, drawn)]
    for scatter in (0.0, SCATTER):
        bars += whole_bars(scatter, whole)
    show("drift", bars, asked.json)


def drawn_bars(groups: int, repeats: int, poses: tuple[str, ...], trials: int) -> Iterator[Bar]:
    """Rates of false alarms and of detected changes for random estimates."""
    rng = np.random.default_rng(groups * 100 + repeats)
    plan = f"{groups} groups of {repeats} runs from {len(poses)} pose{'s' * (len(poses) > 1)}"
    calm = [drawn(rng, groups, repeats, poses, 0.0) for _ in range(trials)]
    moved = [drawn(rng, groups, repeats, poses, CHANGE) for _ in range(trials)]
    yield at_most(f"drawn, {plan}: false alarms", float(np.mean([bool(d.moved) for d in calm])), 0.02)
    yield at_least(f"drawn, {plan}: 3 std found", float(np.mean([bool(d.moved) for d in moved])), 0.9)


def drawn(rng: np.random.Generator, groups: int, repeats: int, poses: tuple[str, ...], change: float) -> Drift:
    """Drift analysis of random estimates of five parameters.

    One parameter changes by `change` from a random group on.
    """
    group = np.repeat(np.arange(groups), repeats * len(poses))
    of_run = poses * (groups * repeats)
    values = rng.standard_normal((len(group), 5)) + np.array([[BETWEEN_POSES[pose]] for pose in of_run])
    values[group >= rng.integers(1, groups), rng.integers(5)] += change
    result = Estimates(("run",) * len(group), of_run, tuple("abcde"), values, np.zeros_like(values))
    return changes(result, group.tolist(), [f"group {g}" for g in range(groups)], QUICK, int(rng.integers(1 << 31)))


def whole_bars(scatter: float, trials: int) -> Iterator[Bar]:
    """Rates of false alarms and of detected changes for recordings: from each pose three before and three after it."""
    rig, plant = load_rig("paper"), load_plant("paper", 1)
    calm = estimate_each([run_of(plant, rig, pose, 0, 1.0) for pose in POSES], rig)
    at = calm.names.index("c1/b")
    std = np.hypot(np.sqrt(np.mean(calm.std[:, at] ** 2)) / calm.values[:, at].mean(), scatter)
    group, result = [0] * 9 + [1] * 9, []
    for change in (0.0, CHANGE * std):
        alarms = []
        for trial in range(trials):
            rng = np.random.default_rng(trial)
            factors = 1 + scatter * rng.standard_normal(18) + change * np.array(group)
            runs = [run_of(plant, rig, POSES[k % 3], 100 * trial + k, f) for k, f in enumerate(factors)]
            drift = changes(estimate_each(runs, rig), group, ["before", "after"], QUICK, trial)
            alarms.append(bool(drift.moved))
        result.append(float(np.mean(alarms)))
    outcome = f"recorded, friction scatters by {percent(scatter)}"
    yield at_most(f"{outcome}: false alarms", result[0], 0.02)
    yield at_least(f"{outcome}: 3 std found", result[1], 0.9)


def run_of(plant: PlantConfig, rig: Rig, pose: str, seed: int, factor: float) -> Run:
    """Return a release from one pose, with the friction of joint 1 changed by a factor."""
    parameters = plant.parameters | {"c1": plant.parameters["c1"] * float(factor)}
    alone = rig.model_copy(update={"poses": {pose: rig.poses[pose]}})
    (run,) = record(plant.model_copy(update={"seed": seed, "parameters": parameters}), alone, 3.0, 500)
    return run


if __name__ == "__main__":
    main()

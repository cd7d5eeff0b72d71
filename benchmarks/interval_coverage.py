"""Coverage of stated 90 % intervals: how often they contain the true values of simulated rigs.

    python benchmarks/interval_coverage.py [--kinds KIND ...] [--rigs 40] [--first 0] [--quick]

The parameters of each rig are drawn uniformly between the bounds of its rig file, which are those of `paper`. Values
that the rig file states as measured have a standard uncertainty of 1 %. Each rig is recorded for 3 s (with an effect:
5 s) at 200 Hz from each pose, with 14-bit encoders and a noise of half a count. The table lists for each quantity the
number of intervals, their coverage with the binomial standard error of an exact interval, and the number of true values
above and below the interval. Sizes of effects are listed twice: `NAME at b` is the interval for the assumed scale, and
`NAME` the printed interval, which contains the uncertainty of the scale.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from _bars import options

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import DprError
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.identify import identify
from dpr_lab.rig import MASSES, PARAMETERS, Rig, load_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.run import Run
from dpr_lab.search import load_search
from sim_device.plant.arm_drive import ArmDrive
from sim_device.plant.config import ArmConfig, ArmDriveConfig, DriveConfig, PlantConfig
from sim_device.plant.drives import JointDrives
from sim_device.trials.offline_recorder import record

SECONDS, RATE_HZ, STD = 3.0, 200, 0.01
INNER, OUTER = ("m1", "l1", "mb"), ("m2", "l2")
AT_REST = {"inner": "X1", "outer": "X3"}
"""Pose in which a single rod hangs."""
ARM_POSES = {"X1": {"theta1": 2.2, "theta2": 2.6}, "X2": {"theta1": 3.9, "theta2": 3.4}}
CONSTANTS = {"torque": (), "current": ("kt",), "voltage": ("kt", "ke", "R")}
AMPLITUDE = {"torque": 0.25, "current": 0.5, "voltage": 2.5}

Random = np.random.Generator
Intervals = dict[str, tuple[float, float, float]]
"""Low end, high end and true value of each quantity."""
Kind = Callable[[Random], Intervals]


def drawn(rng: Random, measured: Sequence[str], **tables: Any) -> tuple[Rig, PlantConfig]:
    """Draw a plant between the bounds of `paper`, and measured values for its rig file."""
    rig = load_rig("paper")
    table, Z = rig.model_dump(exclude_none=True) | tables, rng.uniform(*rig.bounds)
    for name in measured:
        true = float(Z[PARAMETERS.index(name)])
        table["parameters"][name] |= {"measured": float(rng.normal(true, STD * true)), "std": STD * true}
    still = AT_REST.get(tables.get("rods", {}).get("mounted", ""))
    table["poses"] = {name: pose for name, pose in table["poses"].items() if name != still}
    parameters = dict(zip(PARAMETERS, Z.tolist(), strict=True))
    return Rig.model_validate(table), PlantConfig(name="paper", seed=int(rng.integers(1 << 31)), parameters=parameters)


def truth(rig: Rig, plant: PlantConfig) -> dict[str, float]:
    """Return the true values of all quantities that a result may state, and their ratios to its inertia."""
    Z, alone, drive = plant.Z, rig.rods.mounted == "inner", plant.arm_drive
    if alone:
        Z[PARAMETERS.index("m2")] = 0.0
    values = dict(zip(BASE, base_parameters(Z, rig.L1, rig.g).tolist(), strict=True))
    values["A"] = plant.arm.J0 + rig.L0**2 * float(Z[[PARAMETERS.index(name) for name in MASSES]].sum())
    values["c0"] = plant.arm.c0 + (drive.back_emf if drive else 0.0)
    values |= dict.fromkeys(("kt gear/R", "kt gear", "kt/R", "kt", "gain"), drive.torque_per_input if drive else 0.0)
    scale = "a" if alone else "b"
    ratios = {f"{name}/{scale}": value / values[scale] for name, value in values.items()}
    return values | plant.parameters | ratios | {f"1/{scale}": 1.0 / values[scale]}


def identified(runs: Sequence[Run], rig: Rig, plant: PlantConfig) -> Intervals:
    """Identify a rig, and return the intervals of all stated values."""
    model = identify(runs, rig, settings=load_search("segments").model_copy(update={"generations": 2}))
    stated = {name: one.interval90 for name, one in model.quantities.items() if one.interval90}
    true = truth(rig, plant)
    return {name: (*ends, true[name]) for name, ends in stated.items() if name in true and ends[0] < ends[1]}


def rods(rng: Random, measured: Sequence[str] = (), mass: str = "", **mounting: str) -> Intervals:
    """Return the intervals from free swings with a clamped arm, without and with an added mass on a rod."""
    rig, plant = drawn(rng, measured, rods=mounting)
    runs = record(plant, rig, SECONDS, RATE_HZ)
    if mass:
        heavy = rig.model_copy(update={"added_mass": AddedMass(rod=mass, mass=0.05, position=0.3)})
        loaded = record(plant.model_copy(update={"seed": plant.seed + 1}), heavy, SECONDS, RATE_HZ)
        runs += [replace(run, name=f"{run.name} with mass") for run in loaded]
    return identified(runs, rig, plant)


def torques(rng: Random, gain_std: float = 0.0) -> Intervals:
    """Return the intervals from known torques at both joints, whose gain has a relative error."""
    rig, plant = drawn(rng, ())
    t = np.arange(0.0, SECONDS, 0.02)
    torque = 0.15 * np.column_stack([np.sin(2 * np.pi * 0.7 * t), 0.4 * np.sin(2 * np.pi * 1.1 * t + 1)])
    config = DriveConfig(reports=("commanded",), gain=(1 + gain_std * rng.normal(),) * 2)
    runs = record(plant, rig, SECONDS, RATE_HZ, JointDrives(t, torque, config, plant.seed))
    return identified(runs, rig, plant)


def arm(
    rng: Random, kind: str, mounted: str = "both", measured: Sequence[str] = (), constants: Sequence[str] = ()
) -> Intervals:
    """Return the intervals from a free arm, or from an arm driven by a torque, current or voltage."""
    mode, nominal = "free" if kind == "free" else "driven", {"kt": 0.5, "ke": 0.5, "R": 5.0}
    true = {name: value * float(rng.uniform(0.8, 1.2)) for name, value in nominal.items()}
    motor: dict[str, Any] = {"input": kind}
    for name in CONSTANTS.get(kind, ()):
        motor[name] = {"nominal": nominal[name], "lower": 0.8 * nominal[name], "upper": 1.2 * nominal[name]}
        if name in constants:
            motor[name] |= {"measured": float(rng.normal(true[name], STD * true[name])), "std": STD * true[name]}
    tables = {
        "arm": {"mode": mode, "A": {"nominal": 0.06, "lower": 0.01, "upper": 0.3}},
        "rods": {"mounted": mounted},
    }
    rig, plant = drawn(rng, measured, **tables, **({"motor": motor} if mode == "driven" else {}))
    rig = Rig.model_validate(rig.model_dump(exclude_none=True) | {"poses": ARM_POSES})
    config: Any = {"input": kind, "limit": 100.0, "reports": ("commanded",), "rates_hz": (0.6, 1.1)} | true
    drive = ArmDriveConfig(amplitude=AMPLITUDE[kind], **config) if mode == "driven" else None
    moving = ArmConfig(mode=mode, J0=float(rng.uniform(0.01, 0.03)), c0=float(rng.uniform(0.01, 0.05)))
    plant = plant.model_copy(update={"arm": moving, "arm_drive": drive})
    runs = record(plant, rig, SECONDS, RATE_HZ, ArmDrive(drive, plant.seed) if drive else None)
    return identified(runs, rig, plant)


def diagnosed(rng: Random, name: str) -> Intervals:
    """Return the intervals of a diagnosis of weighed rods with one effect, near its typical size."""
    rig, plant = drawn(rng, MASSES)
    effect, sizes = EFFECTS[name], dict[str, float]()
    for p in effect.parameters:
        sign = 1.0 if p.role == "shape" or p.sign == "positive" or p.one_way else float(rng.choice([-1.0, 1.0]))
        sizes[p.name] = sign * (p.default if p.role == "shape" else p.typical) * float(rng.uniform(0.75, 1.4))
    plant = plant.model_copy(update={"effects": {name: sizes}})
    diagnosis, true = diagnose(record(plant, rig, 5.0, RATE_HZ), rig), truth(rig, plant)
    named = next((cause for cause in diagnosis.effects if cause.name == name), None)
    if named is None or diagnosis.scale is None:
        return {}
    stated = {"b": (*diagnosis.scale.interval90, true["b"])}
    for key, size in named.parameters.items():
        if key in sizes and size.interval90[0] < size.interval90[1]:
            power = next(p.scale_power for p in effect.parameters if p.name == key)
            stated[f"{key} at b"] = (*size.interval90, sizes[key] * (diagnosis.scale.b / true["b"]) ** power)
            stated[key] = (*(size.interval90_with_scale or size.interval90), sizes[key])
    if closed := diagnosis.gap.closed_held_out:
        stated["gap reduction of 99 %"] = (0.0, closed.interval90[1], 0.99)
    return stated | {key: (*ratio.interval90, true[key]) for key, ratio in diagnosis.ratios.items()}


KINDS: dict[str, Kind] = {
    "two rods": rods,
    "two rods, weighed": partial(rods, measured=MASSES),
    "two rods, m2 and l2 measured": partial(rods, measured=OUTER),
    "inner rod": partial(rods, mounted="inner"),
    "inner rod, measured": partial(rods, measured=INNER, mounted="inner"),
    "outer rod": partial(rods, mounted="outer"),
    "elbow clamped": partial(rods, elbow="clamped"),
    "mass on outer rod": partial(rods, mass="outer"),
    "mass on inner rod": partial(rods, mass="inner"),
    "mass, m2 and l2 measured": partial(rods, measured=OUTER, mass="outer"),
    "mass on inner rod alone": partial(rods, mass="inner", mounted="inner"),
    "mass, elbow clamped": partial(rods, mass="outer", elbow="clamped"),
    "joint torques": torques,
    "joint torques, gain error": partial(torques, gain_std=0.03),
    "free arm": partial(arm, kind="free"),
    "free arm, weighed": partial(arm, kind="free", measured=MASSES),
    "free arm, m2 and l2 measured": partial(arm, kind="free", measured=OUTER),
    "free arm, inner rod": partial(arm, kind="free", mounted="inner"),
    "free arm, inner rod measured": partial(arm, kind="free", mounted="inner", measured=INNER),
    "torque at arm": partial(arm, kind="torque"),
    "torque at arm, inner rod": partial(arm, kind="torque", mounted="inner"),
    "current at arm, kt measured": partial(arm, kind="current", constants=("kt",)),
    "current at arm, kt bounded": partial(arm, kind="current"),
    "voltage at arm": partial(arm, kind="voltage"),
    "voltage at arm, inner rod measured": partial(arm, kind="voltage", mounted="inner", measured=INNER),
    **{
        f"effect {name}": partial(diagnosed, name=name)
        for name in (
            *("coulomb_joint1", "coulomb_joint2", "stribeck_joint2", "air_drag_both", "spring_joint1", "clock_rate"),
            *("encoder_offset_joint1", "encoder_scale_joint2", "hysteresis_joint1", "load_friction_joint1"),
        )
    },
}


def show(kind: str, results: Sequence[Mapping[str, tuple[float, float, float]]]) -> None:
    """Print the coverage of each quantity of a kind."""
    inside = defaultdict[str, list[tuple[bool, bool]]](list)
    results, absent = [result for result in results if result], sum(not result for result in results)
    for result in results:
        for name, (low, high, true) in result.items():
            inside[name].append((true < low, true > high))
    print(f"{kind}: {len(results)} rigs" + (f", and {absent} without a named effect" if absent else ""), flush=True)
    for name, sides in inside.items():
        below, above = np.sum(sides, axis=0)
        covered, error = 100 * (1 - (below + above) / len(sides)), 100 * np.sqrt(0.09 / len(sides))
        print(
            f"  {name:26} n {len(sides):3}  {covered:5.1f} +- {error:.1f} %  above {above}, below {below}", flush=True
        )


def main() -> None:
    """Print the coverage of each kind of result."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=40, help="number of rigs (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first rig")
    parser.add_argument("--kinds", nargs="+", default=[*KINDS], choices=[*KINDS], metavar="KIND")
    args = parser.parse_args()
    for kind in args.kinds:
        results = []
        for seed in range(args.first, args.first + (2 if args.quick else args.rigs)):
            try:
                results.append(KINDS[kind](np.random.default_rng(seed)))
            except DprError as error:
                print(f"{kind}, rig {seed}: {error}", flush=True)
        show(kind, results)


if __name__ == "__main__":
    main()

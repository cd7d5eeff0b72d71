"""Rate of false alarms on rigs without effects: unusual rigs, loggers that damage samples, and cameras.

    python benchmarks/clean_rigs.py --count 100

The verdict "inconclusive" is counted separately. It is not a false alarm, because most effects of typical size are
below five standard deviations on these rigs.

scipy simulates the swings with the equations of this file, which share only the description of the rig with dpr-lab.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from _bars import Bar, at_most, options, show
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run

Array = NDArray[np.float64]
Physics = dict[str, float]
"""Parameters of both rods, by their names in the rig file."""

REST_S, SWING_S = 0.5, 10.0
FAULTS = ("late", "repeat", "outlier", "gap")


@dataclass(frozen=True, slots=True)
class Logger:
    """Sampling of a recording, with its faults."""

    rate_hz: int
    counts_per_rev: int
    faults: tuple[str, ...] = ()
    rest_s: float = REST_S
    shared: float = 0.0
    """Share of a frame's error that persists in the next frame, as for a tracker."""
    tracked_rad: float = 0.0
    """Error of a camera's angles, rad, rms."""
    wrong_length: float = 0.0
    """Uncertainty of L1 that the rig file states."""


def odd_rig(rng: np.random.Generator) -> tuple[float, float, Logger]:
    """Draw lengths of both rods, m, and a logger without faults.

    The rigs range from desk toys to fairground rides, with coarse and fine encoders.
    """
    L1 = float(np.exp(rng.uniform(np.log(0.05), np.log(1.5))))
    outer = L1 * rng.uniform(0.4, 1.3)
    rate_hz = int(rng.choice([100, 200, 500, 1000, 2000, 4000]))
    return L1, outer, Logger(rate_hz, int(rng.choice([500, 1000, 2000, 4096, 8192, 16384, 65536])))


def bad_logger(rng: np.random.Generator) -> tuple[float, float, Logger]:
    """Draw lengths of both rods, m, and a logger with one or several faults."""
    L1 = float(rng.uniform(0.15, 0.5))
    outer = L1 * rng.uniform(0.6, 1.2)
    rate_hz, counts = int(rng.choice([200, 500, 1000])), int(rng.choice([2000, 4096, 16384]))
    return L1, outer, Logger(rate_hz, counts, tuple(k for k in FAULTS if rng.random() < 0.5) or ("repeat",))


def camera(rng: np.random.Generator) -> tuple[float, float, Logger]:
    """Draw lengths of both rods, m, and a camera with a poorly known scale and errors that last for several frames."""
    L1 = float(rng.uniform(0.1, 0.4))
    rate_hz, shared = int(rng.choice([100, 120, 200, 240])), float(rng.uniform(0.0, 0.9))
    tracked = float(rng.uniform(0.5e-3, 3e-3))
    return L1, L1 * rng.uniform(0.6, 1.2), Logger(rate_hz, 4096, (), 2.0, shared, tracked, 0.08)


KINDS: dict[str, Callable[[np.random.Generator], tuple[float, float, Logger]]] = {
    "odd rig": odd_rig,
    "bad logger": bad_logger,
    "camera": camera,
}
"""Function that draws each kind of rig."""


def drawn(kind: str, seed: int) -> tuple[Rig, list[Run], Logger]:
    """Draw a rig without effects, its rig file with errors of up to 15 %, and its recordings."""
    rng = np.random.default_rng(seed)
    L1, outer, logger = KINDS[kind](rng)
    rig, nominal = _rig(L1, outer, logger, rng)
    true = {name: value * rng.uniform(0.85, 1.15) for name, value in nominal.items()}
    return rig, [_recorded(rig, true, L1, logger, pose, rng) for pose in rig.poses], logger


def _rig(L1: float, outer: float, logger: Logger, rng: np.random.Generator) -> tuple[Rig, Physics]:
    size = L1 / 0.4
    result = {"l1": L1 * rng.uniform(0.35, 0.6), "l2": outer * rng.uniform(0.35, 0.6)}
    result |= {"m1": 0.1 * size, "m2": 0.1 * size * outer / L1, "mb": 0.2 * size}
    result["J1"] = result["m1"] * L1**2 / 12 * rng.uniform(0.8, 1.3)
    result["J2"] = result["m2"] * outer**2 / 12 * rng.uniform(0.8, 1.3)
    pace = np.sqrt(9.81 / L1)
    inner = result["J1"] + result["m1"] * result["l1"] ** 2 + (result["m2"] + result["mb"]) * L1**2
    result["c1"] = inner * pace * rng.uniform(0.005, 0.03)
    result["c2"] = (result["J2"] + result["m2"] * result["l2"] ** 2) * pace * rng.uniform(0.005, 0.03)
    described = load_rig("paper").model_dump(exclude_none=True)
    for name, parameter in described["parameters"].items():
        parameter.update(nominal=result[name], lower=0.5 * result[name], upper=1.6 * result[name])
    described["rig"].update(L1=L1, L2=outer)
    if logger.wrong_length:
        off = 1 + rng.uniform(-logger.wrong_length, logger.wrong_length)
        described["rig"].update(L1=off * L1, L1_std=logger.wrong_length * L1)
    described["encoders"]["counts_per_rev"] = (logger.counts_per_rev,) * 3
    described["link"]["rate_hz"] = logger.rate_hz
    return Rig.model_validate(described), result


def swing(true: Physics, L1: float, g: float, start: Array, t: Array) -> Array:
    """(n, 4) angles (0 = upright) and speeds of two rods with viscous joints.

    The equations follow from the Lagrangian and are integrated by DOP853.
    """
    p = true
    d = p["m2"] * L1 * p["l2"]
    a = p["J1"] + p["m1"] * p["l1"] ** 2 + (p["m2"] + p["mb"]) * L1**2
    b = p["J2"] + p["m2"] * p["l2"] ** 2
    weight1, weight2 = (p["m1"] * p["l1"] + (p["m2"] + p["mb"]) * L1) * g, p["m2"] * p["l2"] * g

    def slope(_: float, x: Array) -> list[float]:
        s, c = np.sin(x[0] - x[1]), d * np.cos(x[0] - x[1])
        drag = p["c2"] * (x[2] - x[3])
        push1 = weight1 * np.sin(x[0]) - d * s * x[3] ** 2 - p["c1"] * x[2] - drag
        push2 = weight2 * np.sin(x[1]) + d * s * x[2] ** 2 + drag
        det = a * b - c * c
        return [x[2], x[3], (b * push1 - c * push2) / det, (a * push2 - c * push1) / det]

    return solve_ivp(slope, (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-11).y.T


def _recorded(rig: Rig, true: Physics, L1: float, logger: Logger, pose: str, rng: np.random.Generator) -> Run:
    rate = logger.rate_hz
    t = np.arange(-round(logger.rest_s * rate), round(SWING_S * rate) + 1) / rate
    start = np.append(rig.poses[pose].theta[1:] + rng.normal(0, 0.01, 2), rng.normal(0, 0.002, 2))
    late = rng.exponential(0.3 / rate, len(t)) * (rng.random(len(t)) < 0.3) * (t > 0) * ("late" in logger.faults)
    theta = np.zeros((len(t), 3))
    theta[:, 1:] = start[:2]
    read_at, order = (t + late)[t >= 0], np.argsort((t + late)[t >= 0], kind="stable")
    theta[np.flatnonzero(t >= 0)[order], 1:] = swing(true, L1, rig.g, start, read_at[order])[:, :2]
    if logger.tracked_rad:
        from scipy.signal import lfilter  # slow to import

        fresh = rng.normal(0.0, logger.tracked_rad * np.sqrt(1 - logger.shared**2), (len(t), 2))
        theta[:, 1:] += np.asarray(lfilter([1.0], [1.0, -logger.shared], fresh, axis=0))
        return Run(pose, t, theta, None, pose, rig.name, "", rate)
    counts = np.rint(rig.positions(theta) + rng.normal(0, 0.5, theta.shape)).astype(np.int64)
    keep = np.ones(len(t), dtype=bool)
    if "repeat" in logger.faults:
        again = 1 + np.flatnonzero(rng.random(len(t) - 1) < 0.02)
        counts[again] = counts[again - 1]
    if "outlier" in logger.faults:
        hit = np.flatnonzero(rng.random(len(t)) < 0.003)
        counts[hit, rng.integers(1, 3, len(hit))] += rng.integers(-400, 400, len(hit))
    if "gap" in logger.faults:
        for first in rng.integers(round(0.6 * rate), len(t) - 100, 6):
            keep[first : first + rng.integers(2, round(0.08 * rate) + 3)] = False
    return Run(pose, t[keep], rig.theta(counts[keep]), counts[keep], pose, rig.name, "", rate)


def main() -> None:
    """Diagnose `count` rigs of each kind."""
    parser = options(__doc__)
    parser.add_argument("--count", type=int, default=100, help="rigs of each kind")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first rig")
    args = parser.parse_args()
    count, alarms, began = 10 if args.quick else args.count, {}, time.process_time()
    inconclusive = dict.fromkeys(KINDS, 0)
    for kind in KINDS:
        alarms[kind] = []
        for seed in range(args.seed, args.seed + count):
            rig, runs, logger = drawn(kind, seed)
            result = diagnose(runs, rig).to_json()
            inconclusive[kind] += result["verdict"] == "inconclusive"
            if result["verdict"] not in ("no_gap", "inconclusive"):
                named = [effect["name"] for effect in result["effects"]]
                alarms[kind].append({"seed": seed, "L1": rig.L1, "logger": str(logger), "said": result["verdict"]})
                alarms[kind][-1]["effects"] = named
    seconds = (time.process_time() - began) / (count * len(KINDS))
    bars = [at_most(f"{kind}: false alarms of {count}", len(alarms[kind]), 0) for kind in KINDS]
    bars += [Bar(f"{kind}: inconclusive of {count}", "-", inconclusive[kind], None) for kind in KINDS]
    show("Clean rigs", bars, args.json, alarms=alarms, cpu_s_each=seconds)
    if not args.json:
        for kind in KINDS:
            print(*alarms[kind], sep="\n")


if __name__ == "__main__":
    main()

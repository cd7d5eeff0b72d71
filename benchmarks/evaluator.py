"""Speed of the batch evaluator beside a scalar loop, a NumPy batch, more threads and, if given, a compiled C program.

One evaluation is E(Z) of equation (2): three poses of 10 s, 2000 Runge-Kutta steps each, four signals.

    python benchmarks/evaluator.py [--quick] [--json] [--limit path/to/rk4_limit.c]

Every figure is a median over rounds in which all programs run in turn, so that other load on the machine hits all
alike; only the efficiency of threads needs idle cores, hence the load is printed.
"""

import ctypes
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numba
import numpy as np
from _bars import Bar, options, show
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters, rows
from dpr_lab.dynamics.equation import accelerations
from dpr_lab.dynamics.rollout import trajectory_errors
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.rig import load_rig

STEP, SAMPLES = 0.005, 2001
Array = NDArray[np.float64]
Evaluator = Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class Problem:
    """Candidates, poses and the trajectories to compare with."""

    candidates: Array
    poses: Array
    reference: Array


def problem(candidates: int) -> Problem:
    """Random candidates within the paper rig's bounds, reference at its nominal parameters."""
    rig = load_rig("paper")
    L1, g = rig.rig.L1, rig.rig.g
    poses = np.array([[*pose.theta[1:], 0.0, 0.0] for pose in rig.poses.values()])
    t = STEP * np.arange(SAMPLES)
    base = base_parameters(rig.nominal, L1, g)
    reference = np.array([simulate(base, L1, g, pose, t, STEP) for pose in poses])
    drawn = np.random.default_rng(0).uniform(*rig.bounds, size=(candidates, 9))
    return Problem(rows(base_parameters(drawn, L1, g), L1, g), poses, reference)


@numba.njit(error_model="numpy")
def scalar_costs(candidates: Array, poses: Array, reference: Array) -> Array:
    """One candidate after the other, sin and cos at every stage."""
    costs = np.zeros((len(candidates), len(poses)))
    h = STEP
    for i in range(len(candidates)):
        b, d, e1, e2, c1, c2 = candidates[i]
        for p in range(len(poses)):
            x, y, v, w = poses[p]
            for k in range(1, reference.shape[1]):
                a1, a2 = accelerations(x, y, v, w, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v2, w2 = v + h / 2 * a1, w + h / 2 * a2
                b1, b2 = accelerations(x + h / 2 * v, y + h / 2 * w, v2, w2, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v3, w3 = v + h / 2 * b1, w + h / 2 * b2
                g1, g2 = accelerations(x + h / 2 * v2, y + h / 2 * w2, v3, w3, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                v4, w4 = v + h * g1, w + h * g2
                k1, k2 = accelerations(x + h * v3, y + h * w3, v4, w4, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
                x, y = x + h / 6 * (v + 2 * (v2 + v3) + v4), y + h / 6 * (w + 2 * (w2 + w3) + w4)
                v, w = v + h / 6 * (a1 + 2 * (b1 + g1) + k1), w + h / 6 * (a2 + 2 * (b2 + g2) + k2)
                z = reference[p, k]
                costs[i, p] += (x - z[0]) ** 2 + (y - z[1]) ** 2 + (v - z[2]) ** 2 + (w - z[3]) ** 2
    return costs


def numpy_costs(candidates: Array, poses: Array, reference: Array) -> Array:
    """All candidates and poses as one NumPy array."""
    b, d, e1, e2, c1, c2 = candidates.T[:, :, None]

    def slope(x: Array) -> Array:
        t1, t2, w1, w2 = x
        coupling, whirl, drag = d * np.cos(t1 - t2), d * np.sin(t1 - t2), c2 * (w1 - w2)
        f1 = -whirl * w2 * w2 - c1 * w1 - drag + e1 * np.sin(t1)
        f2 = whirl * w1 * w1 + drag + e2 * np.sin(t2)
        scale = 1.0 / (b - coupling * coupling)
        return np.stack([w1, w2, (b * f1 - coupling * f2) * scale, (f2 - coupling * f1) * scale])

    x = np.broadcast_to(poses.T[:, None, :], (4, len(candidates), len(poses)))
    costs = np.zeros(x.shape[1:])
    for target in reference.transpose(1, 2, 0)[1:]:
        k1 = slope(x)
        k2 = slope(x + STEP / 2 * k1)
        k3 = slope(x + STEP / 2 * k2)
        k4 = slope(x + STEP * k3)
        x = x + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
        costs += ((x - target[:, None, :]) ** 2).sum(axis=0)
    return costs


def c_evaluator(source: Path, poses: Array, reference: Array) -> Evaluator:
    """The C yardstick, compiled here for this machine, on one thread."""
    compiler = shutil.which("gcc")
    if compiler is None or not source.is_file():
        sys.exit(f"--limit needs gcc and the C source; gcc: {compiler or 'not found'}, source: {source}")
    flags = "-O3 -march=native -ffast-math -mprefer-vector-width=512 -fopenmp -shared -fPIC -DW=32".split()
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "limit.so"
        subprocess.run([compiler, *flags, "-o", library, source, "-lm"], check=True)
        evaluate = ctypes.CDLL(str(library)).evalb
    evaluate.argtypes = [ctypes.c_void_p, ctypes.c_long, *[ctypes.c_void_p] * 3, ctypes.c_int]

    def run(candidates: Array) -> Array:
        columns, costs = np.ascontiguousarray(candidates.T), np.empty(len(candidates))
        pointers = [array.ctypes.data for array in (reference, poses, costs)]
        evaluate(columns.ctypes.data, len(candidates), *pointers, 1)
        return costs

    return run


def rates(programs: dict[str, tuple[Evaluator, Array]], rounds: int) -> dict[str, list[float]]:
    """Evaluations per second of each program, one figure a round."""
    measured: dict[str, list[float]] = {name: [] for name in programs}
    for i in range(rounds + 1):
        for name, (evaluate, candidates) in programs.items():
            begin = time.perf_counter()
            evaluate(candidates)
            if i:  # the first round compiles
                measured[name].append(len(candidates) / (time.perf_counter() - begin))
    return measured


def with_threads(threads: int, evaluate: Evaluator) -> Evaluator:
    """The same evaluator on a given number of threads."""

    def run(candidates: Array) -> Array:
        numba.set_num_threads(threads)
        return evaluate(candidates)

    return run


def measure(quick: bool, limit: Path | None) -> list[Bar]:
    """All bars of the table."""
    task = problem(520 if quick else 1040)
    threads = numba.get_num_threads()

    def lanes(candidates: Array) -> Array:
        return trajectory_errors(candidates, task.poses, task.reference, STEP)

    programs: dict[str, tuple[Evaluator, Array]] = {
        "lanes": (with_threads(1, lanes), task.candidates),
        "lanes, all threads": (with_threads(threads, lanes), task.candidates),
        "scalar": (lambda z: scalar_costs(z, task.poses, task.reference), task.candidates[:32]),
        "numpy": (lambda z: numpy_costs(z, task.poses, task.reference), task.candidates[: 130 if quick else 520]),
    }
    if limit is not None:
        programs["C"] = (c_evaluator(limit, task.poses, task.reference), task.candidates)
    measured = rates(programs, 3 if quick else 7)

    def ratio(name: str, other: str) -> float:
        return statistics.median(x / y for x, y in zip(measured[name], measured[other], strict=True))

    bars = [
        Bar("lanes, one thread, evaluations/s", "> 5000", rate := statistics.median(measured["lanes"]), rate > 5000),
        Bar("lanes / scalar loop", "> 12", gain := ratio("lanes", "scalar"), gain > 12),
        Bar("lanes / NumPy batch", "> 20", gain := ratio("lanes", "numpy"), gain > 20),
    ]
    scaling = ratio("lanes, all threads", "lanes") / threads
    bars.append(Bar(f"efficiency on {threads} threads", "> 0.6", scaling, scaling > 0.6))
    if limit is not None:
        bars.append(Bar("C on one thread / lanes", "< 1.5", slower := ratio("C", "lanes"), slower < 1.5))
    return bars


def main() -> None:
    """Measure and print."""
    parser = options(__doc__)
    parser.add_argument("--limit", type=Path, metavar="RK4_LIMIT.C", help="C yardstick to compile and compare with")
    chosen = parser.parse_args()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else math.nan
    show(f"evaluator, load before the start {load:.1f}", measure(chosen.quick, chosen.limit), chosen.json)


if __name__ == "__main__":
    main()

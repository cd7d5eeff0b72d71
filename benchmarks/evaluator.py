"""Speed of the batch evaluator: comparison with other programs, influence of threads and batch size, and compile time.

One evaluation is E(Z), docs/theory.md equation (2), for three poses of 10 s with 2000 Runge-Kutta steps and four
signals.

    python benchmarks/evaluator.py [--quick] [--json] [--limit path/to/rk4_limit.c]

A ratio is a median over rounds. In each round, all programs run in turn on one thread, and CPU time is measured, so
that other load on the machine affects all programs equally. The C program is compiled without -ffast-math; gcc then
still uses fused multiply-add, which the batch evaluator ("lanes") does not use. The ratio of the C program to the other
programs is also printed, because it depends on the processor. The speed-up by threads is measured in wall time, as the
best of all rounds. It requires idle cores, so the load of the machine is printed. The error of `solve_ivp` with a
tolerance of 1e-6 is about ten times the error of the batch evaluator with steps of 5 ms; with a tolerance of 1e-8 it is
not larger.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import llvmlite.binding as llvm
import numba
import numpy as np
from _bars import Bar, at_least, at_most, missing, options, show
from _evaluators import (
    Evaluator,
    Problem,
    c_program,
    lanes,
    mujoco_rollout,
    numpy_batch,
    predictions,
    problem,
    scalar_loop,
    solve_ivp,
)

LIMIT = Path(__file__).resolve().parents[2] / "shared" / "bench" / "rk4_limit.c"

Program = tuple[Evaluator, int]
"""An evaluator, and the number of candidates that it evaluates in a round."""

FIRST_CALL = """
import time
import numpy as np
from dpr_lab.dynamics.rollout import trajectory_errors
began = time.perf_counter()
trajectory_errors(np.ones((1, 6)), np.ones((1, 4)), np.ones((1, 2, 4)), 1e-3)
print(time.perf_counter() - began)
"""


def peers(task: Problem, limit: Path, quick: bool) -> dict[str, Program]:
    """All programs that can run on this machine.

    Slow programs evaluate fewer candidates.
    """
    many, few = len(task.candidates), 2 if quick else 4
    made: dict[str, tuple[Evaluator | None, int]] = {
        "lanes": (lanes(task), many),
        "C": (c_program(task, limit), many),
        "C, -ffast-math": (c_program(task, limit, "-ffast-math"), many),
        "C, nothing fused": (c_program(task, limit, "-ffp-contract=off"), many),
        "scalar": (scalar_loop(task), 64),
        "numpy": (numpy_batch(task), 512),
        "mujoco": (mujoco_rollout(task, few), few),
        "solve_ivp 1e-6": (solve_ivp(task, 1e-6), few // 2),
        "solve_ivp 1e-8": (solve_ivp(task, 1e-8), 1),
    }
    return {name: (evaluate, n) for name, (evaluate, n) in made.items() if evaluate is not None}


def check(limit: Path) -> None:
    """Verify that all programs give the same costs.

    Swings of 2 s are compared. The C program, which evaluates only 10 s, is compared by the median over many
    candidates.
    """
    task = problem(8, samples=401)
    same = {"scalar": 1e-9, "numpy": 1e-9, "mujoco": 1e-6, "solve_ivp 1e-6": 1e-3, "solve_ivp 1e-8": 1e-4}
    programs = peers(task, limit, quick=True)
    for name in same.keys() & programs.keys():
        n = min(programs[name][1], 8)
        np.testing.assert_allclose(programs[name][0](n), lanes(task)(n), rtol=same[name], err_msg=name)
    task = problem(64)
    if program := c_program(task, limit):
        assert np.median(np.abs(program(64) / lanes(task)(64) - 1)) < 1e-6, "C gives other costs"


def seconds(programs: dict[str, Program], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of each program for one evaluation, one value per round, with all programs in turn."""
    taken: dict[str, list[float]] = {name: [] for name in programs}
    for i in range(rounds + 1):
        for name, (evaluate, n) in programs.items():
            began = time.process_time()
            evaluate(n)
            if i:  # the first round compiles
                taken[name].append((time.process_time() - began) / n)
    return taken


def beside_peers(limit: Path, quick: bool) -> list[Bar]:
    """Ratios of the times of programs on a single thread in the same round."""
    task = problem(512 if quick else 1024)
    taken = seconds(peers(task, limit, quick), 3 if quick else 9)

    def times(name: str, other: str) -> float:
        return statistics.median(x / y for x, y in zip(taken[name], taken[other], strict=True))

    bars = [Bar("lanes, evaluations/s", "-", 1 / statistics.median(taken["lanes"]), None)]
    if "C" in taken:
        bars.append(at_most("time of lanes / C, strict", times("lanes", "C"), 1.3))
        for name in ("C, -ffast-math", "C, nothing fused"):
            bars.append(Bar(f"time of lanes / {name}", "-", times("lanes", name), None))
    else:
        bars.append(missing("time of lanes / C, strict", "<= 1.3"))
    targets = {"scalar": 20, "numpy": 50, "mujoco": 500, "solve_ivp 1e-6": 2000, "solve_ivp 1e-8": None}
    for name, target in targets.items():
        if name not in taken:
            bars.append(missing(f"time of {name} / lanes", f">= {target}"))
        elif target is None:
            bars.append(Bar(f"time of {name} / lanes", "-", times(name, "lanes"), None))
        else:
            bars.append(at_least(f"time of {name} / lanes", times(name, "lanes"), target))
    if "C" in taken:
        bars += [Bar(f"time of {name} / C, strict", "-", times(name, "C"), None) for name in targets if name in taken]
    return bars


def with_an_arm(quick: bool) -> list[Bar]:
    """Time of predicted readings with a free arm over the time with a clamped arm, in the same rounds."""
    task, n = problem(256), 256
    programs = {name: (predictions(task, arm=arm), n) for name, arm in (("clamped", False), ("free", True))}
    taken = seconds(programs, 3 if quick else 9)
    ratio = statistics.median(x / y for x, y in zip(taken["free"], taken["clamped"], strict=True))
    return [at_most("time per candidate, free arm / clamped arm", ratio, 1.8)]


def on_threads(threads: int, quick: bool) -> list[Bar]:
    """Speed-up by all threads, relative to a linear speed-up."""
    evaluate, n = lanes(problem(2048)), 2048
    wall: dict[int, list[float]] = {1: [], threads: []}
    cpu: dict[int, list[float]] = {1: [], threads: []}
    for _ in range(5 if quick else 25):
        for count in wall:
            numba.set_num_threads(count)
            began, used = time.perf_counter(), time.process_time()
            evaluate(n)
            wall[count].append(time.perf_counter() - began)
            cpu[count].append(time.process_time() - used)
    numba.set_num_threads(1)
    name = f"{threads} threads, share of a linear gain, %"
    gain = 100 * min(wall[1]) / min(wall[threads]) / threads
    shared = 100 * statistics.median(cpu[1]) / statistics.median(cpu[threads])
    return [at_least(name, gain, 85), Bar("the same by CPU time, %", "-", shared, None)]


def growth(quick: bool) -> tuple[list[Bar], dict[str, dict[int, float]]]:
    """Exponents of the cost in the numbers of candidates, samples and runs, and the measured curves."""
    sizes: dict[str, tuple[Iterable[int], Callable[[int], tuple[Problem, int]]]] = {
        "candidates": ((256, 512, 1024, 2048), lambda n: (problem(n, samples=501), n)),
        "samples": ((251, 501, 1001, 2001), lambda n: (problem(512, samples=n), 512)),
        "runs": ((3, 6, 12, 24), lambda n: (problem(256, samples=501, repeats=n // 3), 256)),
    }
    bars, curves = [], {}
    for what, (points, task) in sizes.items():
        tasks = {n: task(n) for n in points}
        programs = {str(n): (lanes(made), count) for n, (made, count) in tasks.items()}
        taken = seconds(programs, 5 if quick else 15)
        curves[what] = {n: 1e3 * count * min(taken[str(n)]) for n, (_, count) in tasks.items()}
        exponent = float(np.polyfit(np.log(list(curves[what])), np.log(list(curves[what].values())), 1)[0])
        bars.append(Bar(f"cost grows as {what} to the power of", "0.9 .. 1.1", exponent, 0.9 <= exponent <= 1.1))
    return bars, curves


def first_calls() -> list[Bar]:
    """Time of the first call in a new process, s, with an empty and with a filled kernel cache."""
    command = [sys.executable, "-c", FIRST_CALL]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        cold, warm = (float(subprocess.check_output(command, env=environment, text=True)) for _ in range(2))
    return [Bar("first call, compiling, s", "-", cold, None), Bar("first call, compiled before, s", "-", warm, None)]


def show_curves(curves: dict[str, dict[int, float]]) -> None:
    """Print the curves as text."""
    for what, curve in curves.items():
        print(f"{what:<10}", *(f"{n:>8}" for n in curve))
        print(f"{'ms':<10}", *(f"{ms:>8.1f}" for ms in curve.values()))


def main() -> None:
    """Measure all programs and print the results."""
    parser = options(__doc__)
    parser.add_argument("--limit", type=Path, default=LIMIT, metavar="RK4_LIMIT.C", help="C yardstick to compile")
    chosen = parser.parse_args()
    load, threads = os.getloadavg()[0], numba.get_num_threads()
    numba.set_num_threads(1)
    check(chosen.limit)
    bars = [*beside_peers(chosen.limit, chosen.quick), *with_an_arm(chosen.quick)]
    linear, curves = growth(chosen.quick)
    bars += [*on_threads(threads, chosen.quick), *linear, *first_calls()]
    if not chosen.json:
        show_curves(curves)
    title = f"evaluator on {llvm.get_host_cpu_name()}, load {load:.1f} before and {os.getloadavg()[0]:.1f} after"
    show(title, bars, chosen.json, milliseconds=curves)


if __name__ == "__main__":
    main()

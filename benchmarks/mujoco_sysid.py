"""MuJoCo's own system identification toolbox on the recordings of `benchmarks/identify.py`.

    python -m pip install "mujoco[sysid]>=4"
    python benchmarks/mujoco_sysid.py [--quick] [--json] [--rigs N]

All programs use the same recordings and start from the middle of the same box. They receive the same initial states of
the segments, which the smoother of `dpr-lab` estimates. Their methods differ:

mujoco.sysid               Gauss-Newton within the box over all nine parameters, with the defaults of the toolbox;
                           initial states stay fixed, because the toolbox has no other option
dpr-lab, start states kept least squares of SciPy over the five ratios; initial states also stay fixed
dpr-lab, no search         the local solver of `identify`; initial states are estimated together with the ratios

Only ratios are compared, because a free swing does not determine other quantities.

error        median over rigs of the largest relative error of the five ratios
over bound   error divided by the Cramer-Rao bound: rms over the five ratios, median over rigs
"""

import logging
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from _bars import Bar, at_most, missing, options, show
from _random_rigs import BOXES, Array, Trial, boxed, draw
from scipy.optimize import least_squares

from dpr_lab.dynamics.base import base_from_ratios, base_parameters, ratios
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.identification.identify import polish
from dpr_lab.identification.ratio_fit import segmented
from dpr_lab.rig import Rig

SEGMENTS_S = (0.25, 1.0)
TOOLBOX, OURS = "mujoco.sysid", "dpr-lab, no search"

Program = Callable[[Trial, Rig], Array]
"""Function that estimates the (5,) ratios from the recordings of a rig and the bounds of a box."""


@dataclass(frozen=True, slots=True)
class Row:
    """Results of one program in one box, over all rigs."""

    box: str
    program: str
    seconds: float
    error: float
    over_bound: float


def states_kept(trial: Trial, rig: Rig, length: float) -> Array:
    """Estimate the ratios (5,) from fixed initial states, as the toolbox does, with the simulation of dpr-lab."""
    problem, starts = segmented(trial.runs, rig, length)
    pieces = np.split(problem.t, problem.segments.offsets[1:-1])

    def residual(q: Array) -> Array:
        base = base_from_ratios(q)
        swings = [simulate(base, rig.L1, rig.g, start, t) for start, t in zip(starts, pieces, strict=True)]
        return (problem.joints.of_rods(np.concatenate(swings)[:, :2]) - problem.measured).ravel()

    middle = ratios(base_parameters(rig.bounds.mean(axis=0), rig.L1, rig.g))
    return least_squares(residual, middle, bounds=(0, np.inf), x_scale=middle).x


def no_search(trial: Trial, rig: Rig) -> Array:
    """Estimate the ratios (5,) with the local solver alone."""
    return polish(rig.bounds.mean(axis=0), trial.runs, rig).ratios


def programs() -> dict[str, Program]:
    """Programs that are installed."""
    made: dict[str, Program] = {}
    try:
        from _mujoco_toolbox import toolbox
    except ImportError as error:
        hint = "it needs the extra `sysid` of MuJoCo 4 or newer: pip install 'mujoco[sysid]>=4'"
        print(f"MuJoCo's toolbox is not tested: {hint} ({error})", file=sys.stderr)
    else:
        made |= {f"{TOOLBOX}, {s:g} s": partial(toolbox, length=s) for s in SEGMENTS_S}
    made |= {f"dpr-lab, start states kept, {s:g} s": partial(states_kept, length=s) for s in SEGMENTS_S}
    return made | {OURS: no_search}


def measured(box: str, name: str, program: Program, trials: Sequence[Trial]) -> Row:
    """Run one program on all rigs, in one box."""
    rig, seconds, errors, bounds = boxed(box), [], [], []
    for trial in trials:
        began = time.perf_counter()
        result = program(trial, rig)
        seconds.append(time.perf_counter() - began)
        errors.append(np.abs(result / trial.ratios - 1).max())
        bounds.append(np.sqrt(np.mean(((result - trial.ratios) / trial.cramer_rao_std) ** 2)))
    print(f"{box}, {name}: done", file=sys.stderr)
    return Row(box, name, *(float(np.median(values)) for values in (seconds, errors, bounds)))


def bars(table: Sequence[Row]) -> list[Bar]:
    """Error of the local solver, relative to the smallest error of the toolbox."""
    made = []
    for box in dict.fromkeys(row.box for row in table):
        name = f"{box}: error of {OURS} over the toolbox's best"
        ours = next(row.error for row in table if (row.box, row.program) == (box, OURS))
        theirs = [row.error for row in table if row.box == box and row.program.startswith(TOOLBOX)]
        made.append(at_most(name, ours / min(theirs), 1.0) if theirs else missing(name, "<= 1"))
    return made


def show_rows(table: Sequence[Row]) -> None:
    """Print the programs as text."""
    print(f"{'box':<9} {'program':<32} {'seconds':>8} {'error':>8} {'over bound':>10}")
    for row in table:
        print(f"{row.box:<9} {row.program:<32} {row.seconds:>8.1f} {row.error:>8.1e} {row.over_bound:>10.1f}")


def main() -> None:
    """Run all programs and print the results."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=3)
    chosen = parser.parse_args()
    logging.disable(logging.WARNING)  # the toolbox warns of every segment that observes states, not sensors
    trials = [draw(seed) for seed in range(1 if chosen.quick else chosen.rigs)]
    boxes, tried = list(BOXES)[: 1 if chosen.quick else None], programs()
    table = [measured(box, name, program, trials) for box in boxes for name, program in tried.items()]
    if not chosen.json:
        show_rows(table)
    show(f"MuJoCo's toolbox, {len(trials)} random rigs", bars(table), chosen.json, rows=[asdict(row) for row in table])


if __name__ == "__main__":
    main()

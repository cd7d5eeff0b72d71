"""Test of the stated uncertainty: errors of the ratios relative to their Cramer-Rao bounds and intervals.

    python benchmarks/uncertainty.py [--rigs 200] [--rates 200 1000] [--processes N] [--quick] [--json]

The rigs are random within 15 % of the rig `paper`. Each rig is recorded from three poses for 10 s, with 14-bit
encoders, a noise of half a count, and rods placed by hand. The true swing is integrated in steps of 0.25 ms. The local
solver starts within 2 % of the true parameters; benchmarks/identify.py tests whether a search comes this close.
"""

import os
from multiprocessing import get_context

import numpy as np
from _bars import Bar, at_most, options, show
from _random_rigs import draw

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.identification.identify import polish
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.rig import load_rig

START_WITHIN = 0.02


def one(job: tuple[int, int]) -> tuple[list[float], list[float], list[bool], float, int]:
    """Record and identify one rig.

    Returns:
        Errors divided by the Cramer-Rao bound and by the stated standard deviation, whether each 90 % interval contains
        the true value, chi-square, and number of segments.
    """
    seed, rate_hz = job
    trial = draw(seed, rate_hz)
    rng = np.random.default_rng([seed, 1])
    start = trial.Z * rng.uniform(1 - START_WITHIN, 1 + START_WITHIN, len(trial.Z))
    result = polish(start, trial.runs, load_rig("paper"))
    sure, error = uncertainty(result), result.ratios - trial.ratios
    inside = [low <= true <= high for i, true in enumerate(trial.ratios) for low, high in [sure.interval90(i)]]
    over_bound, over_std = (error / trial.cramer_rao_std).tolist(), (error / sure.std).tolist()
    return over_bound, over_std, inside, result.chi2_per_dof, result.segments


def _single_thread() -> None:
    import numba

    numba.set_num_threads(1)


def bars_at(rate_hz: int, rigs: int, processes: int) -> list[Bar]:
    """Results at one sample rate."""
    with get_context("spawn").Pool(processes, _single_thread) as pool:
        results = pool.map(one, [(seed, rate_hz) for seed in range(rigs)], chunksize=1)
    over_bound, over_std, inside = (np.array([result[k] for result in results]) for k in range(3))
    bars = [
        at_most(f"{rate_hz} Hz: error of {name} over its bound, rms", float(np.sqrt(np.mean(column**2))), 1.2)
        for name, column in zip(RATIOS, over_bound.T, strict=True)
    ]
    coverage = 100 * float(inside.mean())
    bars.append(Bar(f"{rate_hz} Hz: 90 % intervals cover, %", "86 .. 94", coverage, 86 <= coverage <= 94))
    bars.append(Bar(f"{rate_hz} Hz: error over stated std, rms", "1", float(np.sqrt(np.mean(over_std**2))), None))
    near = float(np.mean([result[3] ** 0.5 <= 1.1 for result in results]))
    bars.append(Bar(f"{rate_hz} Hz: residual within 1.1 of the floor, %", ">= 99", 100 * near, near >= 0.99))
    whole = float(np.mean([result[4] == 3 for result in results]))
    bars.append(Bar(f"{rate_hz} Hz: runs fitted whole, %", "-", 100 * whole, None))
    return bars


def main() -> None:
    """Identify all rigs and print the results."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--rates", type=int, nargs="+", default=[200, 1000], help="Hz")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    chosen = parser.parse_args()
    rigs = 8 if chosen.quick else chosen.rigs
    bars = [bar for rate_hz in chosen.rates for bar in bars_at(rate_hz, rigs, chosen.processes)]
    show(f"uncertainty over {rigs} random rigs", bars, chosen.json)


if __name__ == "__main__":
    main()

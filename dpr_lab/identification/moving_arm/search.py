"""Global search for initial values of rods, arm and drive.

A gene is the logarithm of an unknown of the fit. Its range follows from the bounds that the rig file defines for the
parameters. The cost of a candidate is the sum of squared residuals over segments of a quarter of a second, whose
initial states are estimated from the readings. The search is the improved genetic algorithm of `dpr_lab.search`.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.moving_arm.problem import ArmProblem
from dpr_lab.identification.moving_arm.unknowns import nominal_gain, rod_inertias
from dpr_lab.rig_tables import Parameter
from dpr_lab.search import ALGORITHMS, load_search


@dataclass(frozen=True, slots=True)
class ArmSearchSettings:
    """Settings of the search for initial values."""

    population: int = 24
    generations: int = 16
    wide: float = 10.0
    """Factor between an end of the range of an unknown and its initial value.

    It is used if the rig file contains no bounds.
    """
    draws: int = 200
    """Number of random rigs within the bounds from which the range of a ratio is computed."""


ARM_SEARCH = ArmSearchSettings()


def searched_start(problem: ArmProblem, initial: Array) -> Array | None:
    """Search for the best `SWING_PARAMETERS` (12,); return None if no candidate can be simulated.

    Args:
        problem: short segments of the recordings
        initial: (segments, 4 or 6) estimated initial states of the segments
    """
    rng, unknowns = np.random.default_rng(0), problem.unknowns
    box = np.array([_range(name, problem, rng) for name in unknowns.free]).T

    def vector(genes: Array) -> Array:
        p = unknowns.start.copy()
        p[unknowns.places] = np.exp(genes)
        return p

    def errors(candidates: Array) -> Array:
        readings = (problem.predict(Estimate(vector(genes), initial)) for genes in candidates)
        costs = [np.bincount(problem.segments.run, problem.chi2_by_segment(angles)) for angles in readings]
        return np.array(costs, dtype=np.float64)

    settings = load_search("segments").model_copy(
        update={"population": ARM_SEARCH.population, "generations": ARM_SEARCH.generations}
    )
    *_, last = ALGORITHMS[settings.algorithm].run(errors, np.log(box), settings, rng)
    return vector(last.best) if np.isfinite(last.best_cost) else None


def _range(name: str, problem: ArmProblem, rng: np.random.Generator) -> tuple[float, float]:
    """Return the search range (lower, upper) of an unknown, in units of the scale."""
    unknowns, rig = problem.unknowns, problem.rig
    low, high = rig.bounds
    drawn = np.array([rod_inertias(rng.uniform(low, high), rig) for _ in range(ARM_SEARCH.draws)])
    place = SWING_PARAMETERS.index(name)
    start = float(unknowns.start[place])
    if place < drawn.shape[1]:
        ratios = drawn[:, place] / drawn[:, 1]
        return _positive(float(ratios.min()), float(ratios.max()))
    if name == "gain":
        gain = start or nominal_gain(rig) / unknowns.scale_value or 1.0
        return gain / ARM_SEARCH.wide, gain * ARM_SEARCH.wide
    parameter: Parameter | None = getattr(rig.arm, name, None)
    if parameter is not None and parameter.lower is not None and parameter.upper is not None:
        return _positive(parameter.lower / float(drawn[:, 1].max()), parameter.upper / float(drawn[:, 1].min()))
    return _positive(start / ARM_SEARCH.wide, start * ARM_SEARCH.wide)


def _positive(low: float, high: float) -> tuple[float, float]:
    """Return a range whose ends are positive and different."""
    low = max(low, 1e-9)
    return low, max(high, 1.01 * low)

"""The bare model fitted to screened runs: short segments first, their states carried on to longer ones."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import BASE, base_parameters, ratios
from dpr_lab.effects import effect_vector
from dpr_lab.errors import RunError
from dpr_lab.estimation.anchors import anchor
from dpr_lab.gap.hypothesis import Hypothesis, hypothesis, slots_of
from dpr_lab.gap.problem import FIRST_S, Point, Problem, carried, problem
from dpr_lab.gap.record import Record
from dpr_lab.gap.shooting import Fit, fit, robust_weights
from dpr_lab.model import ParameterValue
from dpr_lab.rig import Rig

WORKING_S = 0.5
"""Length at which effects are told apart: four to seven times as sensitive as 0.25 s, and still Gauss-Newton-able."""
OUTLYING = 0.05  # Student-t weight below which a reading is left out of what follows


def nominal_rods(rig: Rig) -> NDArray[np.float64]:
    """(6,) ratios and b of the rig file's best known values."""
    base = base_parameters(rig.nominal, rig.rig.L1, rig.rig.g)
    return np.append(ratios(base), base[BASE.index("b")])


def anchored(rods: NDArray[np.float64], rig: Rig) -> NDArray[np.float64]:
    """(6,) the same ratios, with the b that is most likely given what of the rig was measured and its bounds."""
    return np.append(rods[:5], scale(rods, rig).value)


def scale(rods: NDArray[np.float64], rig: Rig) -> ParameterValue:
    """b, kg m^2, by the rig file and the ratios: the scale of all torques, which no free swing shows."""
    unsure = np.array([1e-3, 1e-3, 1e-3, 0.3, 0.3]) * np.maximum(rods[:5], 1e-3)  # friction may hide anything
    _, base = anchor(rods[:5], np.diag(unsure**2), rig)
    return base["b"]


def fit_base(records: Sequence[Record], rig: Rig, rods: NDArray[np.float64]) -> tuple[Problem, Hypothesis]:
    """Fit the ratios, robustly at 0.25 s and then at 0.5 s.

    Args:
        records: the runs
        rig: lengths, masses, encoders
        rods: (6,) ratios and b to start from

    Raises:
        RunError: a stretch of readings that no start state comes near.
    """
    short, starts = problem(records, rig, FIRST_S)
    point = Point(rods, effect_vector({}), starts)
    slots = slots_of(point, (), short)
    rough = fit(short, point, slots)
    _all_followed(short, rough)
    robust = replace(short, weight=short.weight * np.sqrt(robust_weights(short, rough)))
    first = fit(robust, rough.point, slots)
    first = replace(first, point=replace(first.point, rods=anchored(first.point.rods, rig)))
    return lengthened(records, rig, short, first, WORKING_S)


def _all_followed(made: Problem, found: Fit) -> None:
    lost = np.flatnonzero(~np.isfinite(found.chi2_by_segment))
    if len(lost):
        run, at = made.records[made.run[lost[0]]].run.name, made.t[made.offsets[lost[0]]]
        raise RunError(
            f"{run}: the model cannot follow the readings from {at:.2f} s on: check rig file and encoder, or leave the"
            " run out"
        )


def lengthened(
    records: Sequence[Record], rig: Rig, short: Problem, first: Fit, length: float
) -> tuple[Problem, Hypothesis]:
    """The bare model at another segment length, from the states that shorter segments found."""
    longer, starts = problem(records, rig, length)
    point = replace(first.point, starts=carried(short, first.point, longer, starts))
    found = fit(longer, point, slots_of(point, (), longer), iterations=20)
    return longer, hypothesis(longer, (), found)

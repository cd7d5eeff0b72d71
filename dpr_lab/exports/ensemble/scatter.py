"""Estimate the scatter of identified ratios between recordings.

A model file does not contain this scatter.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.estimate import SCALE, UNKNOWN_RATIOS
from dpr_lab.gap.conclusion.scatter import between_recordings, left_out_values
from dpr_lab.identification.model import Model
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.ratio_fit import fit_ratios, rods_estimate, segmented
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class RatioScatter:
    """Scatter of the fitted ratios between recordings."""

    names: tuple[str, ...]
    """Names of the fitted ratios, and of the scale b if the recordings determine it."""
    between: Array
    """(n, n) covariance of the values of a further recording about the common values."""
    left_out: Array
    """(recordings, n) values that are fitted without the recording of the row."""


def scatter_of_ratios(model: Model, runs: Sequence[Run], rig: Rig, segment_s: float = 0.5) -> RatioScatter:
    """Estimate the scatter of the ratios of a model between recordings.

    Args:
        model: an identified model without effects
        runs: the runs to which the model was fitted
        rig: rig of the model
        segment_s: length of a segment, s
    """
    problem, initial = segmented([preprocess(run, rig) for run in runs], rig, segment_s)
    fitted = fit_ratios(problem, rods_estimate(model.unknowns, initial)).fit
    ratios = [i for i, free in enumerate(fitted.free) if free.block == "ratios" and free.place <= SCALE]
    return RatioScatter(
        names=tuple(UNKNOWN_RATIOS[fitted.free[i].place] for i in ratios),
        between=between_recordings(problem, fitted)[np.ix_(ratios, ratios)],
        left_out=left_out_values(problem, fitted)[:, ratios],
    )

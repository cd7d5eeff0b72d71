"""What the search minimises: the error of a candidate's simulated swings against the runs.

`segments` starts every 0.25 s from the smoothed state, so that chaos cannot make the landscape noise. `paper` is
equation (2): one free run over the whole record, angles and speeds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import added_base, base_parameters, rows
from dpr_lab.dynamics.segments import segments as laid_end_to_end
from dpr_lab.estimation.segments import cut
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.search.problem import Objective

if TYPE_CHECKING:
    from dpr_lab.estimation.evidence import Evidence

STEP = 0.005
"""The paper's Runge-Kutta step and sample spacing, s; the search needs no finer one to find the basin."""

SEARCH_SEGMENT_S = 0.25


@dataclass(frozen=True, slots=True)
class ObjectiveChoice:
    """An objective and the search settings that suit it."""

    build: "Callable[[Sequence[Evidence], Rig], Objective]"
    settings: str
    """Name of the built-in search file."""


def segment_objective(evidence: "Sequence[Evidence]", rig: Rig) -> Objective:
    """Mean squared whitened angle error over short segments from smoothed start states; about 1 at the noise floor.

    Args:
        evidence: the runs with states and noise
        rig: for L1 and g

    Returns:
        (n, 9) candidates -> (n, runs)
    """
    from dpr_lab.dynamics.rollout import segment_errors  # compiled, slow to import

    parts = []
    for index, item in enumerate(evidence):
        kept = _thinned(item.run.t)
        pieces = cut(index, item.run, item.states, SEARCH_SEGMENT_S)
        edges = np.searchsorted(kept, np.searchsorted(item.run.t, [piece.t[0] for piece in pieces]))
        groups = [group for group in np.split(kept, edges[1:]) if len(group) > 1]
        swings = laid_end_to_end([item.run.t[group] for group in groups], item.states[[g[0] for g in groups]], STEP)
        targets = item.run.theta[np.concatenate(groups), 1:]
        parts.append((item.run, swings, targets, item.noise.whitening))

    def errors(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = [
            segment_errors(_rows(candidates, run, rig), swings, targets, whitening).sum(axis=1) / targets.size
            for run, swings, targets, whitening in parts
        ]
        return np.stack(columns, axis=1)

    return errors


def paper_objective(evidence: "Sequence[Evidence]", rig: Rig) -> Objective:
    """E(Z) of equation (2), by run: one free run from the smoothed first state, angles and speeds.

    Args:
        evidence: the runs with states
        rig: for L1 and g

    Returns:
        (n, 9) candidates -> (n, runs)
    """
    from dpr_lab.dynamics.rollout import segment_errors  # compiled, slow to import

    parts = []
    for item in evidence:
        kept = _thinned(item.run.t)
        swings = laid_end_to_end([item.run.t[kept]], item.states[:1], STEP)
        parts.append((item.run, swings, np.hstack([item.run.theta[kept, 1:], item.states[kept, 2:]])))

    def errors(candidates: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = [segment_errors(_rows(candidates, run, rig), swings, targets) for run, swings, targets in parts]
        return np.hstack(columns)

    return errors


OBJECTIVES = {
    "segments": ObjectiveChoice(segment_objective, "segments"),
    "paper": ObjectiveChoice(paper_objective, "paper"),
}
"""Every objective by the name that `--objective` takes."""


def _thinned(t: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of samples about `STEP` apart: more of them cost time and say nothing new to a search."""
    ticks = np.floor((t - t[0]) / STEP + 1e-6)
    return np.flatnonzero(np.diff(ticks, prepend=-1.0) > 0)


def _rows(candidates: NDArray[np.float64], run: Run, rig: Rig) -> NDArray[np.float64]:
    """What the kernel reads of the candidates, with the mass that was clamped on during the run."""
    L1, g = rig.rig.L1, rig.rig.g
    return rows(base_parameters(candidates, L1, g) + added_base(run.added_mass, L1, g), L1, g)

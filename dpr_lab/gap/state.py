"""State of a diagnosis: frozen records, one for each stage.

ScreenedRuns     request, recordings, held-out recordings
Fitted           extends ScreenedRuns by segments, bare model, residual maps
ForwardSelected  Fitted, and the state of the search after forward selection (module `corrections`)
Selected         Fitted, selected set of effects, classes with their probabilities
Transferred      extends Selected by performance on held-out recordings, size of the gap, covariance
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects.effect import Effect
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.gap_size import Gap, Where
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.gap.transfer.out_of_sample import OutOfSample
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.gap.which.selected import Selection
from dpr_lab.progress import FitBegan, ScoreTestBegan, StageBegan
from dpr_lab.rig import Rig
from dpr_lab.run import Run

Event = StageBegan | FitBegan | ScoreTestBegan


@dataclass(frozen=True, slots=True)
class Request:
    """Input and options of a diagnosis."""

    runs: tuple[Run, ...]
    held_out: tuple[Run, ...]
    rig: Rig
    library: Mapping[str, Effect]
    """Effects from which the diagnosis chooses."""
    max_effects: int
    start: Array
    """(7,) initial ratios, b and p/b."""
    seed: int
    """Seed of the bootstrap."""
    on_progress: Callable[[Event], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenedRuns:
    """State after sensor screening."""

    request: Request
    recordings: Recordings
    held_out: Recordings
    """Recordings that no fit uses."""
    division: str
    """Sentence on the division of a long record into pieces, or empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted(ScreenedRuns):
    """State after the fit of the bare model, without disturbed intervals and outliers."""

    problem: Problem
    bare: Hypothesis
    held_out_prediction: OutOfSample | None
    """Prediction of the held-out recordings by any model; None if there are none."""
    residual_maps: tuple[Where, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """State with the selected set of effects, and with the class of each effect."""

    fitted: Fitted
    """Recordings and their bare model; the selection may have found a better fit of it."""
    selection: Selection
    posteriors: tuple[EffectPosterior, ...]


@dataclass(frozen=True, slots=True)
class Description:
    """Result of the tests of a recording's description."""

    hint: str = ""
    """Probable mistake and its correction; empty without evidence against the description."""
    withholds: bool = False
    """Whether another interpretation explains as much as the chosen effects; no effect is then named as a cause."""
    forced: bool = False
    """Whether a force that the model lacks probably acts on the rods; no effect is then certain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transferred(Selected):
    """State with the results and the uncertainty of the selected set."""

    free_runs: Mapping[str, FreeRuns]
    """Free runs along all recordings, `before` and `after` the correction."""
    transfer: Transfer
    description: Description
    """Whether a wrong description of the recordings explains the gap."""
    remainder: Discrepancy | None
    """Discrepancy term; None if only noise remains."""
    gap: Gap
    covariance: Array
    """(free, free) covariance of the fitted values."""

    @property
    def intervals(self) -> dict[tuple[str, str], float]:
        """Half width of the 90 % interval of each value, by effect and parameter."""
        half_width = NORMAL_Q90 * np.sqrt(np.diag(self.covariance))
        free = self.selection.chosen.fit.free
        return {(parameter.effect, parameter.name): float(r) for parameter, r in zip(free, half_width, strict=True)}

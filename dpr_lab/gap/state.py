"""State of a diagnosis: frozen records, one for each stage.

    ScreenedRuns    request, recordings, held-out recordings
    Fitted          + segments, bare model, residual maps
    ForwardSelected Fitted, and the state of the search after forward selection (module `corrections`)
    Selected        selected set of effects for the fitted recordings, classes with their probabilities
    Transferred     + performance on held-out recordings, size of the gap, covariance

A function that accepts `ScreenedRuns` or `Selected` also accepts the record that extends it.
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
from dpr_lab.gap.transfer.free_run import FreeSwings
from dpr_lab.gap.transfer.out_of_sample import OutOfSample
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.gap.which.selected import Selection
from dpr_lab.identification.misread.tried import Description
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
    """Recordings that no fit uses; may be empty."""
    cut: str
    """Sentence on the pieces of a long record; empty if the record was not divided."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted(ScreenedRuns):
    """State after the fit of the bare model, without disturbed intervals and outliers."""

    problem: Problem
    """Segments of the fitted runs."""
    bare: Hypothesis
    held_out_prediction: OutOfSample | None
    """Prediction of the held-out recordings by any model; None if there are no held-out recordings."""
    residual_maps: tuple[Where, ...]
    """Residual maps of the locations at which the gap may arise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """State with the selected set of effects, and with the class of each effect.

    A class contains effects that are indistinguishable in these recordings, with their probabilities.
    """

    fitted: Fitted
    """Recordings and their bare model, which the selection may have replaced by a better fit."""
    selection: Selection
    posteriors: tuple[EffectPosterior, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Transferred(Selected):
    """State with the results of the selected set on held-out data, and the uncertainty of the set."""

    free_swings: Mapping[str, FreeSwings]
    """Free runs along all recordings, by model: `before` and `after` the correction."""
    transfer: Transfer
    description: Description
    """Result of the test whether a wrong description of the recordings explains the gap."""
    remainder: Discrepancy | None
    """Discrepancy term of the selected set; None if only noise remains."""
    gap: Gap
    covariance: Array
    """(free, free) covariance of the fitted values of the selected set."""

    @property
    def intervals(self) -> dict[tuple[str, str], float]:
        """Half width of the 90 % interval of each fitted value, by effect and parameter."""
        reach = NORMAL_Q90 * np.sqrt(np.diag(self.covariance))
        free = self.selection.chosen.fit.free
        return {(parameter.effect, parameter.name): float(r) for parameter, r in zip(free, reach, strict=True)}

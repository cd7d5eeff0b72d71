"""State of a diagnosis: frozen records, one for each stage.

ScreenedRuns     request, recordings, held-out recordings
Fitted           ScreenedRuns with segments, bare model and residual maps
ForwardSelected  Fitted with the state of the search after forward selection (module `corrections`)
Selected         Fitted with the selected set of effects, and the probabilities of their classes
Transferred      Selected with the performance on held-out recordings, size of the gap, covariance
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
    """Predictions of the held-out recordings, for any model; None without held-out recordings."""
    residual_maps: tuple[Where, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """State after the selection of effects, with the class of each selected effect."""

    fitted: Fitted
    """State after the fit of the bare model, with the better fit of this model if the search reached one."""
    selection: Selection
    posteriors: tuple[EffectPosterior, ...]


@dataclass(frozen=True, slots=True)
class Description:
    """Result of the tests whether the description of the recordings is wrong."""

    hint: str = ""
    """Sentences on the probable mistake and its correction; empty without evidence of a mistake."""
    withholds: bool = False
    """Whether another interpretation explains as much as the chosen effects; no effect is then named as a cause."""
    forced: bool = False
    """Whether a force that the model lacks probably acts on the rods; no effect is then certain."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transferred(Selected):
    """State after the test of the selected set on held-out recordings."""

    free_runs: Mapping[str, FreeRuns]
    """Free runs along all recordings, `before` and `after` the correction."""
    transfer: Transfer
    description: Description
    """Result of the tests of the description of the recordings."""
    remainder: Discrepancy | None
    """Discrepancy term; None if only noise remains."""
    gap: Gap
    covariance: Array
    """(free, free) covariance of the fitted values."""

    @property
    def intervals(self) -> dict[tuple[str, str], float]:
        """Half width of the 90 % interval of each value, by effect and parameter."""
        return half_widths90(self.selection.chosen, self.covariance)


def half_widths90(model: Hypothesis, covariance: Array) -> dict[tuple[str, str], float]:
    """Return the half width of the 90 % interval of each fitted value, by effect and parameter.

    `covariance` is the (free, free) covariance of the fitted values.
    """
    half_widths = NORMAL_Q90 * np.sqrt(np.diag(covariance))
    return {(p.effect, p.name): r for p, r in zip(model.fit.free, half_widths.tolist(), strict=True)}

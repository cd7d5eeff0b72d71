"""The chosen set of effects, what it was chosen from, and how."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest


@dataclass(frozen=True, slots=True)
class TracedTrial:
    """One trial of the search."""

    move: str
    before: tuple[str, ...]
    """Effects of the current set."""
    tried: tuple[str, ...]
    """Effects of the proposed set."""
    criterion: float
    """Of the proposed set: held-out chi-square and price of the parameters."""
    change: float
    """Of the criterion, from the current set to the proposed one; negative is better."""
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True)
class Selection:
    """The selected set of effects and the candidates it was selected from."""

    base: Hypothesis
    chosen: Hypothesis
    fitted: Mapping[frozenset[str], Hypothesis]
    """Every set that was fitted."""
    final_test: ScoreTest
    """The score test of further effects on the chosen set."""
    without: Mapping[str, Hypothesis]
    """The chosen set without each of its effects."""
    tests_without: Mapping[str, ScoreTest]
    """The score test on each of those sets."""
    path: tuple[tuple[str, Hypothesis], ...]
    """From the bare model to the chosen set, one effect at a time, the largest first."""
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have; they stay in the model at any size."""
    misleading: tuple[str, ...] = ()
    """Effects that make held-out runs harder to predict, and so are not in the chosen set."""
    trace: tuple[TracedTrial, ...] = ()
    """Every trial of the search, in order."""

    @property
    def share_explained(self) -> float:
        """Share of the bare model's excess chi2 that the chosen effects take away, 0 to 1."""
        before, after = self.base.residuals.excess, self.chosen.residuals.excess
        return float(np.clip(1 - max(after, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0

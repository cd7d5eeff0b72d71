"""Result of the search: the selected set, the sets compared with it, and the trials."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.result.evidence import DetectableSizes
from dpr_lab.gap.result.search_step import SearchStep


@dataclass(frozen=True, slots=True)
class Selection:
    """Selected set of effects, and the fitted sets from which it was selected."""

    bare: Hypothesis
    """Bare model: ratios and initial states, without effects of the library."""
    chosen: Hypothesis
    """Selected set of effects."""
    fitted: Mapping[frozenset[str], Hypothesis]
    """All fitted sets with their best fits."""
    final_test: ScoreTest
    """Score test of further effects for the selected set."""
    detectable: DetectableSizes
    """Minimum detectable size, given the selected set, by effect and amplitude; None if undetectable at any size."""
    without: Mapping[str, Hypothesis]
    """Sets without one effect of the selected set, by the removed effect."""
    without_substitute: Mapping[str, Hypothesis]
    """Sets without one effect and without a curve that would imitate it, by the removed effect.

    `imitation.substitute_curve` determines the curve.
    """
    tests_without: Mapping[str, ScoreTest]
    """Score tests of the sets without one effect of the selected set, by the removed effect."""
    compensation_odds: Mapping[str, float]
    """Odds that an effect only compensates for the inexact form of another effect, by its name.

    Effects that are certainly no compensations are not included (`dpr_lab.gap.which.compensations`).
    """
    path: tuple[tuple[str, Hypothesis], ...]
    """Sets of increasing size up to the selected set, each with the name of the effect that it adds, most necessary
    effect first."""
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have; they are kept even if they are small."""
    impossible: frozenset[frozenset[str]] = frozenset()
    """Fitted sets with an effect of an impossible size."""
    oversized: tuple[str, ...] = ()
    """Effects of the selected set whose sizes are physically impossible or indicate another cause."""
    misleading: tuple[str, ...] = ()
    """Effects that were removed because they worsen the prediction of held-out runs."""
    trace: tuple[SearchStep, ...] = ()
    """All trials of the search, in order."""

    @property
    def models(self) -> dict[str, Hypothesis]:
        """The bare model, `before`, and the selected model, `after`."""
        return {"before": self.bare, "after": self.chosen}

    @property
    def absorbed(self) -> dict[str, dict[str, str]]:
        """Name of the parameter that absorbs an amplitude, by effect and amplitude.

        For an effect of the selected set, the score test of the set without it applies.
        """
        scores = {name: self.tests_without.get(name, self.final_test).best_score(name) for name in EFFECTS}
        return {name: dict(score.absorbed) for name, score in scores.items() if score is not None and score.absorbed}

    @property
    def share_explained(self) -> float:
        """Fraction of the bare model's excess chi2 that the selected effects explain, 0 to 1."""
        before, after = self.bare.residuals.excess, self.chosen.residuals.excess
        return float(np.clip(1 - max(after, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0

    def unique_share(self, name: str) -> float:
        """Return the unique contribution of an effect, 0 to 1.

        It is the share of the bare model's excess that returns if the effect is removed and the others are refitted.
        """
        before, after = self.bare.residuals.excess, max(self.chosen.residuals.excess, 0.0)
        returned = self.without_substitute[name].residuals.excess - after
        return float(np.clip(returned / before, 0.0, 1.0)) if before > 0 else float(returned > 0)

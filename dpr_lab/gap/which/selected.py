"""The selected set of effects, the compared sets, and the trials of the search."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.result.search_step import SearchStep


@dataclass(frozen=True, slots=True)
class Selection:
    """The selected set of effects and the candidates it was selected from."""

    base: Hypothesis
    chosen: Hypothesis
    fitted: Mapping[frozenset[str], Hypothesis]
    """All sets that were fitted."""
    final_test: ScoreTest
    """The score test of further effects on the selected set."""
    without: Mapping[str, Hypothesis]
    """The selected set without one of its effects, for each effect."""
    without_substitute: Mapping[str, Hypothesis]
    """The sets of `without`, also without a curve that would imitate the removed effect.

    `thresholds.substitute_curve` names the curve.
    """
    tests_without: Mapping[str, ScoreTest]
    """The score test on each set of `without`."""
    own_shares: Mapping[str, float]
    """For each effect of less than the share `THRESHOLDS.secondary`, unless every rig has it: part of its reduction
    that no other functional form of the other effects explains, 0 to 1 (`dpr_lab.gap.which.forms.own_share`).
    """
    path: tuple[tuple[str, Hypothesis], ...]
    """The sets from the bare model to the selected one, which differ by one effect each, the largest effect first."""
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have; they stay in the model at any size."""
    impossible: frozenset[frozenset[str]] = frozenset()
    """Fitted sets with an effect of an impossible size."""
    oversized: tuple[str, ...] = ()
    """Effects of the selected set whose sizes are physically impossible or typical of another cause."""
    misleading: tuple[str, ...] = ()
    """Effects that worsen the prediction of held-out runs and are therefore not in the selected set."""
    trace: tuple[SearchStep, ...] = ()
    """All trials of the search, in order."""

    @property
    def models(self) -> dict[str, Hypothesis]:
        """The bare model `before`, and the selected one `after`."""
        return {"before": self.base, "after": self.chosen}

    @property
    def share_explained(self) -> float:
        """Fraction of the bare model's excess chi2 that the selected effects remove, 0 to 1."""
        before, after = self.base.residuals.excess, self.chosen.residuals.excess
        return float(np.clip(1 - max(after, 0.0) / before, 0.0, 1.0)) if before > 0 else 0.0

    def unique_share(self, name: str) -> float:
        """Fraction of the bare model's excess chi2 that only this effect of the set removes, 0 to 1."""
        before, after = self.base.residuals.excess, max(self.chosen.residuals.excess, 0.0)
        returned = self.without_substitute[name].residuals.excess - after
        return float(np.clip(returned / before, 0.0, 1.0)) if before > 0 else float(returned > 0)

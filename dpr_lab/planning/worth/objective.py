"""Objective of a plan: weighted bits about causes, library, ratios and limits."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dpr_lab.acceptance.limits import Limits
from dpr_lab.arrays import Array
from dpr_lab.gap.classes.calibration import CALIBRATION
from dpr_lab.planning.knowledge import Knowledge
from dpr_lab.planning.worth.criteria import WORTH, OpenPairs, cause_bits, library_bits, open_bits, ratio_bits
from dpr_lab.planning.worth.goals import goal_bits


@dataclass(frozen=True, slots=True)
class Gain:
    """(...,) expected information of each part of the objective, bits, without weights."""

    causes: Mapping[tuple[str, str], Array]
    """Expected information for each undecided pair of causes on which of the two is correct, bits."""
    open_effects: Array
    """Expected information on the presence of the effects that are not excluded, bits."""
    library: Array
    ratios: Array
    limits: Array

    @property
    def weighed(self) -> Array:
        """Value of these gains: weighted sum of the bits."""
        library = WORTH.library if self.causes else 1.0
        others = WORTH.ratios * self.ratios + WORTH.limits * self.limits
        return sum(self.causes.values(), self.open_effects) + library * self.library + others


@dataclass(frozen=True, slots=True)
class Objective:
    """Objective that a plan maximises, given the current knowledge."""

    known: Knowledge
    pairs: tuple[OpenPairs, ...]
    """For each named effect, the candidate causes that a release can show."""
    before: tuple[Array, ...]
    """(n, n) D^2 between the causes from the runs recorded so far, for each named effect."""
    ratios: Array
    """Bits about the ratios before the planned releases."""
    limits: Limits = field(default_factory=Limits)
    """Limits that the rig must satisfy."""

    @classmethod
    def of(cls, known: Knowledge, limits: Limits | None = None) -> "Objective":
        """Create the objective from the current knowledge and the limits of the rig."""
        pairs = tuple(OpenPairs.of(known, causes) for causes in known.causes)
        pairs = tuple(pair for pair in pairs if pair.names)
        before = tuple(pair.distances(known.information) for pair in pairs)
        return cls(known, pairs, before, ratio_bits(known, known.information), limits or Limits())

    def gained(self, F: Array) -> list[Array]:
        """Return the (..., n, n) squared distances d^2 added by further information.

        There is one matrix for each named effect.
        """
        added = [pair.distances(F) - before for pair, before in zip(self.pairs, self.before, strict=True)]
        return [np.maximum(D2, 0.0) / CALIBRATION.temperature for D2 in added]

    def bits(self, gained: list[Array]) -> dict[tuple[str, str], Array]:
        """Return the expected bits about each undecided pair, given the result of `gained`."""
        of_each = (cause_bits(open_pair, d2) for open_pair, d2 in zip(self.pairs, gained, strict=True))
        return {pair: bits for open_pair in of_each for pair, bits in open_pair.items()}

    def gain(self, F: Array) -> Gain:
        """Return the bits of each part of the objective for the Fisher information F, (..., k, k)."""
        known, ratios = self.known, ratio_bits(self.known, F) - self.ratios
        matrices, causes = F.reshape(-1, *F.shape[-2:]), self.bits(self.gained(F))
        limits = np.reshape([goal_bits(known, matrix, self.limits) for matrix in matrices], F.shape[:-2])
        return Gain(causes, open_bits(known, F), library_bits(known, F), ratios, limits)

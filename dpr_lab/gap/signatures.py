"""The least size of every effect that these recordings would show."""

from collections.abc import Mapping

import numpy as np

from dpr_lab.effects import EFFECTS, place
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.score import Scores

SIGMAS = 5.0


def detectable(at: Hypothesis, scores: Scores) -> Mapping[str, Mapping[str, float | None]]:
    """Least detectable amplitude of each effect beside what is fitted: five standard deviations.

        size = 5 sqrt(f) / | s |,

    s the change of the whitened readings by one unit, start states and fitted unknowns projected out, f what one
    independent piece of evidence costs. None where the readings do not change at all.

    Args:
        at: what is fitted
        scores: its score test
    """
    spread = SIGMAS * np.sqrt(at.remainder.inflation)
    found: dict[str, dict[str, float | None]] = {}
    active = list(scores.active)
    inner = np.linalg.inv(scores.H[np.ix_(active, active)] + 1e-12 * np.eye(len(active)))
    for item in scores.ranking:
        sizes: dict[str, float | None] = {}
        for column in item.columns:
            across = scores.H[column, active]
            left = scores.H[column, column] - across @ inner @ across
            seen = left > 1e-6 and scores.scale[column] < 1e200
            sizes[scores.slots[column].name] = float(spread * scores.scale[column] / np.sqrt(left)) if seen else None
        found[item.effect.name] = sizes
    for name in at.effects:
        found[name] = {
            slot.name: float(spread * np.sqrt(inner[i, i]) * scores.scale[i])
            for i, slot in enumerate(at.fit.slots)
            if slot.effect == name and _is_amplitude(name, slot.name)
        }
    return {name: found[name] for name in EFFECTS if name in found}


def _is_amplitude(effect: str, parameter: str) -> bool:
    return any(place(effect, p.name) == place(effect, parameter) for p in EFFECTS[effect].amplitudes)

"""How far the fitted values may be off: by noise, by the integrator, by what was weighed.

With A the slopes of a fit, start states projected out, noise leaves the covariance f (A^T A)^-1, f being what one piece
of independent evidence costs. Whatever else changes the readings by dr, though the fit takes it for known, shifts the
values by -(A^T A)^-1 A^T dr. These shifts count as standard deviations: that of half the integrator's step, and that of
each weighed mass, by its standard uncertainty.

Source: consider covariance, S. F. Schmidt (1966), Application of state-space methods to navigation problems.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.problem import Problem
from dpr_lab.rig import MASSES

Array = NDArray[np.float64]


def covariance(made: Problem, at: Hypothesis) -> Array:
    """(slots, slots) covariance of a fit's values; zero for what is held at its bound."""
    slots, point = at.fit.slots, at.fit.point
    free = [i for i, slot in enumerate(slots) if slot.read(point) > slot.lower]
    A = at.fit.linear.A[:, :, free].reshape(-1, len(free))
    scale = 1 / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    inner = np.linalg.pinv((A * scale).T @ (A * scale), hermitian=True) * scale[:, None] * scale
    found = inner * at.remainder.inflation
    before = made.predict(point)[0]
    for otherwise in _otherwise(made):
        moved = np.nan_to_num(otherwise.predict(point)[0] - before)  # a segment that cannot be followed says nothing
        shift = inner @ (A.T @ made.whitened(moved).ravel())
        found += np.outer(shift, shift)
    whole = np.zeros((len(slots), len(slots)))
    whole[np.ix_(free, free)] = found
    return whole


def _otherwise(made: Problem) -> Iterator[Problem]:
    """The same problem as a finer integrator or a heavier part would have it."""
    yield replace(made, pieces=replace(made.pieces, step=made.pieces.step / 2))
    for name in MASSES:
        std = made.rig.parameters[name].std
        if std is not None:
            yield replace(made, known=made.known._replace(**{name: getattr(made.known, name) + std}))

"""How far the fitted values may be off: by noise, by the integrator, by what was weighed.

With A the slopes of a fit, initial states projected out, noise leaves the covariance f (A^T A)^-1, f being what one
piece of independent evidence costs. Whatever else changes the readings by dr, though the fit takes it for known, shifts
the values by -(A^T A)^-1 A^T dr. These shifts count as standard deviations: that of half the integrator's step, and
that of each weighed mass, by its standard uncertainty.

Source: consider covariance, S. F. Schmidt (1966), Application of state-space methods to navigation problems.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.rig import MASSES, Rig

Array = NDArray[np.float64]


def covariance(problem: Problem, at: Hypothesis, rig: Rig) -> Array:
    """(free, free) covariance of a fit's values; zero for what is held at its bound."""
    before = problem.predict(at.fit.estimate)
    shifts = [other.predict(at.fit.estimate) - before for other in _otherwise(problem, rig)]
    # A segment that cannot be followed says nothing.
    changes = [problem.whitened(np.nan_to_num(shift)) for shift in shifts]
    return considered(at.fit, at.residuals.inflation, changes)


def _otherwise(problem: Problem, rig: Rig) -> Iterator[Problem]:
    """The same problem as a finer integrator or a heavier part would have it."""
    segments, model = problem.segments, problem.model
    yield replace(problem, segments=replace(segments, step=segments.step / 2))
    for name in MASSES:
        std = rig.parameters[name].std
        if std is not None:
            heavier = model.constants._replace(**{name: getattr(model.constants, name) + std})
            yield replace(problem, model=model.with_constants(heavier))

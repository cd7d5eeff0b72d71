"""Swing amplitudes, and the share of a recording outside the fitted range.

The amplitude of a moving double pendulum is the angle alpha from the hanging position at which its straight rods have
the same energy E at rest:

    E = (e1 + e2) (1 - cos alpha),    alpha = pi if the energy is larger.

e1 and e2 are the gravity torques of the rods. At other amplitudes than the fitted ones, a friction law is extrapolated
with an unknown error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.exports.ensemble.bands import BANDS, PredictiveBand
from dpr_lab.gap.damage.hand import energies
from dpr_lab.identification.compare import follow
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class FittedAmplitudes:
    """Range of the swing amplitudes in the fitted recordings, rad."""

    low: float
    high: float

    def beyond(self, amplitudes: Array, tolerance: float = 0.05) -> float:
        """Return the share of amplitudes outside the fitted range.

        An amplitude counts as outside if it leaves the range by more than a relative tolerance.
        """
        within = (amplitudes >= self.low * (1 - tolerance)) & (amplitudes <= self.high * (1 + tolerance))
        return float(np.mean(~within)) if len(within) else 0.0


def fitted_amplitudes(model: Model, runs: Sequence[Run], rig: Rig) -> FittedAmplitudes | None:
    """Return the range of the amplitudes in the recordings of a fit.

    The result is None if there are no recordings.
    """
    if not runs:
        return None
    fitted = np.concatenate([amplitudes(model, run, rig)[1] for run in runs])
    return FittedAmplitudes(float(fitted.min()), float(fitted.max()))


def beyond_fitted(fitted: FittedAmplitudes, band: PredictiveBand, model: Model, run: Run, rig: Rig) -> float:
    """Return the share of a recording with amplitudes outside the fitted range."""
    begins, angles = amplitudes(model, run, rig)
    return fitted.beyond(
        angles[(begins >= begins[0] + band.delay_s + BANDS.start_s - 1e-9) & (begins < band.horizon_s)]
    )


def amplitudes(model: Model, run: Run, rig: Rig) -> tuple[Array, Array]:
    """Return the start of each segment, s since the release, and its swing amplitude, rad."""
    bare = follow(run, rig, model).bare
    problem, estimate = bare.problem, bare.fit.estimate
    upright = energies(problem, estimate.changed(initial=np.zeros((1, 4))))
    share = np.clip(energies(problem, estimate) / upright, 0.0, 1.0)
    return problem.t[problem.segments.offsets[:-1]], np.arccos(1 - 2 * share)

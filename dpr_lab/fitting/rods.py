"""Model of the rods without effects, with exact derivatives of the Runge-Kutta map.

A segment starts at its first sample. The base parameters of a run (`dpr_lab.dynamics.base.base_of_run`) depend on the
mounting, a known attached mass, and the base parameters of the whole rig. The latter are b times (a/b, 1, d/b, e1/b,
c1/b, c2/b, p/b). An attached mass can make b or p/b identifiable.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, WHOLE, base_of_run, base_slopes, ratio_slopes, ratios
from dpr_lab.dynamics.segments import Segments
from dpr_lab.dynamics.sensitivity import driven
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, Estimate, FreeParameter, whole_of
from dpr_lab.joint_angles import JointAngles
from dpr_lab.setup import BOTH, Setup

_B, _P = WHOLE.index("b"), WHOLE.index("p")
_OTHERS = [i for i in range(len(BASE)) if i != _B]


@dataclass(frozen=True, slots=True)
class RodsAlone:
    """Two rods without effects on an arm that is clamped or has a known motion."""

    constants: RigConstants

    def predict(self, segments: Segments, estimate: Estimate) -> Array:
        """Return the (samples, 2) encoder readings, rad."""
        states, _ = followed(estimate.ratios, segments, estimate.initial, self.constants)
        return JointAngles(self.constants.relative2 == 1.0).of_rods(states[:, :2])

    def slopes(
        self,
        segments: Segments,
        estimate: Estimate,
        free: Sequence[FreeParameter],
        predicted: Array | None = None,
    ) -> Array:
        """Return the (samples, 2, free + 4) exact derivatives of the readings.

        The free parameters are ratios, b and p/b.
        """
        values, chains = self._ratios(segments, estimate)
        begins = segments.turning_as_one(estimate.initial)
        _, by_unknown, by_push = driven(values, self.constants, segments, begins, 2)
        by_unknown[:, 1] -= self.constants.relative2 * by_unknown[:, 0]
        by_push[:, 1] -= self.constants.relative2 * by_push[:, 0]
        columns = [parameter.place for parameter in free]
        if columns == list(range(len(RATIOS))) and all(setup == BOTH for setup in segments.setups):
            return by_unknown
        slopes = np.empty((len(by_unknown), 2, len(free) + 4))
        slopes[:, :, len(free) :] = by_unknown[:, :, len(RATIOS) :]
        for s, (first, last) in enumerate(pairwise(segments.offsets)):
            by_ratio = by_unknown[first:last, :, : len(RATIOS)].reshape(-1, len(RATIOS))
            by_ratio = np.concatenate([by_ratio, by_push[first:last].reshape(-1, 1)], axis=1)
            slopes[first:last, :, : len(free)] = (by_ratio @ chains[s][:, columns]).reshape(last - first, 2, len(free))
            slopes[first:last, :, -4:] = by_start(slopes[first:last, :, -4:], segments.setups[segments.run[s]])
        return slopes

    def _ratios(self, segments: Segments, estimate: Estimate) -> tuple[Array, Array]:
        """Return ratios and 1 / b (segments, 6), and their derivatives (segments, 6, 7)."""
        L1, g = self.constants.L1, self.constants.g
        by_run = [values_and_slopes(estimate.ratios, setup, L1, g) for setup in segments.setups]
        values, slopes = zip(*by_run, strict=True)
        return np.array(values)[segments.run], np.array(slopes)[segments.run]


def by_start(slopes: Array, setup: Setup) -> Array:
    """Adapt derivatives (..., 4) with respect to initial states to rods that turn as one body."""
    if setup.held:
        slopes = slopes.copy()
        slopes[..., 2] += slopes[..., 3]
        slopes[..., 3] = 0.0
        slopes[..., 1] *= not setup.alone
    return slopes


def values_of_run(unknown: Array, setup: Setup, L1: float, g: float) -> Array:
    """Return the (6,) five ratios and 1 / b of a run; 1 / b is replaced by 0 for a run without torques."""
    as_whole = _as_whole(setup)
    if as_whole and setup.torques is None:
        return np.append(unknown[: len(RATIOS)], 0.0)
    base = base_of_run(whole_of(unknown), setup, L1, g)
    push = 0.0 if setup.torques is None else 1 / base[_B]
    return np.append(unknown[: len(RATIOS)] if as_whole else ratios(base), push)


def _as_whole(setup: Setup) -> bool:
    """Return whether the ratios of a run are the ratios of the complete rig."""
    return setup.added is None and setup.inner is None and not setup.alone


def ratios_of_run(unknown: Array, setup: Setup, L1: float, g: float) -> tuple[Array, Array]:
    """Return the (5,) ratios of a run, and their (5, 7) derivatives with respect to the ratios, b and p/b."""
    if _as_whole(setup):
        return unknown[: len(RATIOS)], np.eye(len(RATIOS), len(WHOLE))
    base = base_of_run(whole_of(unknown), setup, L1, g)
    return ratios(base), ratio_slopes(base) @ _whole_slopes(unknown, setup, L1, g)


def _whole_slopes(unknown: Array, setup: Setup, L1: float, g: float) -> Array:
    """Return the (6, 7) derivative of the base parameters of a run with respect to the ratios, b and p/b."""
    b, slopes = unknown[SCALE], np.zeros((len(WHOLE), len(WHOLE)))
    slopes[_OTHERS, : len(RATIOS)], slopes[_P, ON_ELBOW] = b * np.eye(len(RATIOS)), b
    slopes[:, SCALE] = whole_of(unknown) / b
    return base_slopes(setup, L1, g) @ slopes if setup.alone else slopes[:_P]


def values_and_slopes(unknown: Array, setup: Setup, L1: float, g: float) -> tuple[Array, Array]:
    """Return the result of `values_of_run`, and the (6, 7) derivatives of these values."""
    values, slopes = values_of_run(unknown, setup, L1, g), ratios_of_run(unknown, setup, L1, g)[1]
    by_unknown = np.zeros(len(WHOLE))
    if setup.torques is not None:
        # b of the run includes the attached mass; for a single rod it is half the inertia
        by_unknown = -(values[-1] ** 2) * (_whole_slopes(unknown, setup, L1, g)[_B])
    return values, np.vstack([slopes, by_unknown])


def followed(
    ratios: Array, laid_out: Segments, initial: Array, rig: RigConstants, outputs: int = 0
) -> tuple[Array, Array]:
    """Return the (N, 4) states of segments for (7,) ratios, b and p/b, and their derivatives.

    The derivatives (N, `outputs`, 9) are those of `sensitivities`.
    """
    values = np.array([values_of_run(ratios, setup, rig.L1, rig.g) for setup in laid_out.setups])[laid_out.run]
    states, slopes, _ = driven(values, rig, laid_out, laid_out.turning_as_one(initial), outputs)
    return states, slopes

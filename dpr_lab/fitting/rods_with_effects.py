"""Model of the rods with effects.

Runge-Kutta steps, computed for many segments in parallel, give the readings. Forward differences give the derivatives.

A segment starts a little before its first sample (`dpr_lab.dynamics.prediction`). All differences are computed with
twice the integration step, which halves the time. The resulting relative error of a derivative, 1e-3, does not change
the solution of a fit. With nearly singular inertias, however, the simulation with twice the step diverges, and a fit
cannot use its derivatives. The normal step is therefore used for segments in which the two simulations differ by more
than `coarse_error`. Encoder errors do not affect the motion, so one simulation is sufficient for all of them.

Derivatives with respect to initial states keep the internal states of effects fixed. Internal states are passed from
segment to segment and must not depend on the initial state of another segment.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers, row_sums
from dpr_lab.dynamics.encoder_errors import with_encoder_errors
from dpr_lab.dynamics.prediction import predict, predict_with_internal
from dpr_lab.dynamics.segments import Segments
from dpr_lab.effects import EFFECTS, named_params, param_index
from dpr_lab.effects.effect_kernels import active_effects, keep_states
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.estimate import EFFECTS_BEGIN, ZEROS_BEGIN, Estimate, FreeParameter, whole_of

INITIAL_STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5, 1e-6, 1e-5])
"""Increments of each component of an initial state, rad and rad/s: about a thousandth of a count."""


@dataclass(frozen=True, slots=True)
class DerivativeSettings:
    """Accuracy of the swings from which derivatives are computed."""

    coarser: float = 2.0
    """Step of the integrator for derivatives, relative to the step for readings."""
    coarse_error: float = 0.01
    """Maximum rms error of the readings of a segment due to the coarser step, rad.

    Above this error, the derivatives are computed with the normal step. Readings change by about 1 rad if a ratio
    changes by 100 %, so the value is also the relative error of a derivative. The error of usual swings is below 1e-3,
    that of diverging simulations above 0.1.
    """


DERIVATIVES = DerivativeSettings()

ENCODER_AMPLITUDES = [
    param_index(effect.name, parameter.name)
    for effect in EFFECTS.values()
    if effect.stage in ("encoder", "encoder0")
    for parameter in effect.amplitudes
]
"""Indices of the amplitudes of encoder errors."""


STEP_LIMITS = {name: effect.longest_step for name, effect in EFFECTS.items() if effect.longest_step is not None}
"""Functions that return the longest suitable step, s, for the parameters of an effect, by its name."""


@dataclass(frozen=True, slots=True)
class RodsWithEffects:
    """Two rods with every effect of the library."""

    constants: RigConstants

    def predict(self, segments: Segments, estimate: Estimate) -> Array:
        """Return the (samples, 2) encoder readings, rad."""
        return predict(
            estimate.whole,
            estimate.params,
            self.constants,
            resolved(segments, estimate.params),
            estimate.initial,
            arm=segments.arm_moves,
        )

    def slopes(
        self,
        segments: Segments,
        estimate: Estimate,
        free: Sequence[FreeParameter],
        predicted: Array | None = None,
    ) -> Array:
        """Return the (samples, 2, free + 4) derivatives of the readings.

        The last four derivatives are those with respect to the initial state.

        Args:
            segments: layout of the samples
            estimate: point of expansion
            free: unknowns in addition to the initial states
            predicted: (samples, 2) readings at the estimate, with which the swing of the longer step is compared
        """
        fine = resolved(segments, estimate.params)
        coarse = replace(fine, step=DERIVATIVES.coarser * fine.step)
        slopes, reading = self._differences(coarse, estimate, free)
        if predicted is not None and (inexact := _inexact(segments, reading, predicted)).any():
            partly_fine = replace(fine, step=np.where(inexact, fine.step, coarse.step))
            slopes, _ = self._differences(partly_fine, estimate, free)
        return slopes

    def _differences(
        self, segments: Segments, estimate: Estimate, free: Sequence[FreeParameter]
    ) -> tuple[Array, Array]:
        """Compute forward differences (samples, 2, free + 4) and readings (samples, 2).

        The integration steps are those of `segments`.
        """
        ratios, params, initial = _varied(estimate, free)
        states, axes = segments.states, 3 if segments.arm_moves else 2
        of_encoders = np.array(
            [p.block == "effects" and EFFECTS[p.effect].stage in ("encoder", "encoder0") for p in free]
            + [False] * states
        )
        moving, still = np.flatnonzero(~of_encoders), np.flatnonzero(of_encoders)
        quiet = params.copy()
        quiet[-1, ENCODER_AMPLITUDES] = 0.0
        angles = np.empty((len(ratios), len(segments.t), axes))

        def predicted(rows: Integers, internal: Array | None = None) -> tuple[Array, Array]:
            whole, starts = whole_of(ratios[rows]), initial[rows]
            return predict_with_internal(whole, quiet[rows], self.constants, segments, starts, internal, axes == 3)

        other_rows = np.append(moving[:-states], len(ratios) - 1)  # the last row is the estimate itself
        start_rows = moving[-states:]
        if keep_states(active_effects(estimate.params)):
            angles[other_rows], internal = predicted(other_rows)
            angles[start_rows], _ = predicted(start_rows, internal[-1])
        else:
            angles[[*other_rows, *start_rows]], _ = predicted(np.append(other_rows, start_rows))
        angles[[*still, -1]] = with_encoder_errors(angles[-1], params[[*still, -1]], self.constants, segments)
        steps = np.array([*(parameter.step for parameter in free), *INITIAL_STEPS[:states]])
        slopes = angles[:-1]
        with np.errstate(invalid="ignore"):  # a diverging swing gives invalid values
            slopes -= angles[-1]
        slopes /= steps[:, None, None]
        return np.moveaxis(slopes, 0, -1), angles[-1]


def _inexact(segments: Segments, reading: Array, predicted: Array) -> Flags:
    """Return the (segments,) mask of the segments whose derivatives need the normal step.

    They are the segments in which the rms error due to the longer step exceeds `coarse_error`.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.add.reduceat(row_sums((reading - predicted) ** 2), segments.offsets[:-1])
        followed = np.isfinite(np.add.reduceat(row_sums(predicted), segments.offsets[:-1]))
    return followed & ~(squares < DERIVATIVES.coarse_error**2 * np.diff(segments.offsets))


def resolved(segments: Segments, params: Array) -> Segments:
    """Return the segments with steps that are short enough for every active effect."""
    named = named_params(params, among=STEP_LIMITS)
    limits = [STEP_LIMITS[name](values) for name, values in named.items()]
    return replace(segments, step=np.minimum(segments.step, min(limits))) if limits else segments


def _varied(estimate: Estimate, free: Sequence[FreeParameter]) -> tuple[Array, Array, Array]:
    """Return the estimates for forward differences: ratios, effects, and initial states.

    The shapes are (n, 7), (n, SIZE) and (n, segments, states). In each row, one free parameter or one component of the
    initial states is incremented. The last row is the estimate itself, so n = free + states + 1.
    """
    states = estimate.initial.shape[1]
    rows = len(free) + states + 1
    vectors, initial = np.tile(estimate.vector, (rows, 1)), np.tile(estimate.initial, (rows, 1, 1))
    for i, parameter in enumerate(free):
        for place, value in parameter.overrides:
            vectors[i, place] = value
        vectors[i, parameter.place] += parameter.step
    for j in range(states):
        initial[len(free) + j, :, j] += INITIAL_STEPS[j]
    return vectors[:, :EFFECTS_BEGIN], vectors[:, EFFECTS_BEGIN:ZEROS_BEGIN], initial

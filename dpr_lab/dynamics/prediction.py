"""Prediction of encoder readings along segments with free initial states and all effects.

A segment starts `PAD` before its first sample, so that a reading with a clock error is not before the start. The first
segment of a run starts at the release if the release is near (`segment_start`). The segment is integrated by classical
Runge-Kutta steps of equal length. Angles at the sampling instants are interpolated by the cubic polynomial through the
states at both ends of a step.

Some effects have internal states (`INTERNAL`): presliding, backlash of an encoder, an arm on a spring. At the start of
a segment, the internal states have the values that the simulation of the previous segment gives for this instant. Until
the release, they have the values of a rig at rest: no presliding displacement, the encoder in the middle of its
backlash, the arm held. A run that starts later starts with sliding joints.
"""

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import WHOLE, base_of_run
from dpr_lab.dynamics.lanes.blocks import Candidates, SegmentArrays, allocate
from dpr_lab.dynamics.lanes.driving import drive_of
from dpr_lab.dynamics.lanes.readings import predict_tracks
from dpr_lab.dynamics.lanes.starts import PAD, segment_start
from dpr_lab.dynamics.lanes.stepping import advance
from dpr_lab.dynamics.lanes.tracks import tracks_of
from dpr_lab.dynamics.lanes.workspace import FEW_LANES, LANES
from dpr_lab.dynamics.rig_constants import constants_of_run
from dpr_lab.dynamics.segments import Segments
from dpr_lab.effects import SIZE
from dpr_lab.effects.effect_kernels import INTERNAL, active_effects, keep_states
from dpr_lab.effects.mounted import differ, effects_of_run
from dpr_lab.effects.quantities import RigConstants

__all__ = ["INTERNAL", "PAD", "predict", "predict_batch", "predict_with_internal", "segment_start"]


def predict(
    base: ArrayLike,
    params: ArrayLike,
    constants: RigConstants,
    segments: Segments,
    initial: ArrayLike,
    internal: ArrayLike | None = None,
    arm: bool = False,
) -> Array:
    """Predict the readings of one candidate.

    See `predict_batch` for the arguments, without the first axis.

    Returns:
        (N, 2) theta1 and the angle of joint 2 as read by its encoder, rad; with `arm` a third column, theta0
    """
    base, params, initial = (np.asarray(values, dtype=np.float64)[None] for values in (base, params, initial))
    return predict_batch(base, params, constants, segments, initial, internal, arm)[0]


def predict_batch(
    bases: ArrayLike,
    params: ArrayLike,
    constants: RigConstants,
    segments: Segments,
    initial: ArrayLike,
    internal: ArrayLike | None = None,
    arm: bool = False,
) -> Array:
    """Predict the readings of many candidates in parallel, for example for forward differences.

    Args:
        bases: (n, 7) base parameters a, b, d, e1, c1, c2, p of the whole rig without an attached mass, SI; or (n, 6) if
            no run has a single rod
        params: (n, SIZE) effects, SI; or (n, runs, SIZE) if they differ between runs
        constants: constants of the rig from `dpr_lab.dynamics.rig_constants.rig_constants`
        segments: times of the readings, in device time, and the Runge-Kutta step of each segment
        initial: (n, S, 4) theta1, theta2, omega1, omega2 at the start of each segment (`segment_start`), rad and rad/s;
            (n, S, 6) with theta0, omega0 of a free or driven arm
        internal: (S, k) or (n, S, k) internal states of effects (`INTERNAL`) at the start of each segment. None, or
            nan: those at the end of the previous segment. For derivatives with respect to the initial states, pass the
            states of `predict_with_internal` at the point of expansion.
        arm: whether to return the arm's angle

    Returns:
        (n, N, 2) theta1 and the angle of joint 2 as read by its encoder (relative or absolute), rad; with `arm` (n, N,
        3), with theta0 as third column. Not finite after a failure of the integration.

    Raises:
        ValueError: an array has another shape.
    """
    return predict_with_internal(bases, params, constants, segments, initial, internal, arm)[0]


def predict_with_internal(
    bases: ArrayLike,
    params: ArrayLike,
    constants: RigConstants,
    segments: Segments,
    initial: ArrayLike,
    internal: ArrayLike | None = None,
    arm: bool = False,
) -> tuple[Array, Array]:
    """Return the readings of `predict_batch`, and the (n, S, k) internal states at the segment starts.

    The internal states are valid only for candidates with an active effect that has internal states.
    """
    bases, params, initial = (np.asarray(values, dtype=np.float64) for values in (bases, params, initial))
    n, count, runs = len(bases), len(segments), len(segments.setups)
    params = _shaped(params, (n, SIZE) if params.ndim == 2 else (n, runs, SIZE), "params").reshape(n, -1, SIZE)
    if differ(params, segments.setups):
        every_run = np.broadcast_to(params, (n, runs, SIZE))
        params = np.stack([effects_of_run(every_run[:, i], setup) for i, setup in enumerate(segments.setups)], axis=1)
    free = np.full((n, count, len(INTERNAL)), np.nan)  # taken from the previous segment
    held = free if internal is None else _shaped(np.asarray(internal), free.shape, "internal")
    whole = _shaped(bases, (n, min(bases.shape[-1], len(WHOLE))), "bases")
    bases_of = {setup: base_of_run(whole, setup, constants.L1, constants.g) for setup in set(segments.setups)}
    by_run = np.stack([bases_of[setup] for setup in segments.setups], axis=1)
    states = segments.turning_as_one(_shaped(initial, (n, count, 6 if initial.shape[-1] == 6 else 4), "initial"))
    initial = np.full((n, count, 6), np.nan)
    initial[..., : states.shape[-1]] = states
    candidates = Candidates(by_run, params, initial, held)
    active = active_effects(params)
    linked = internal is None or np.logical_or.reduce(np.isnan(held), axis=(1, 2))[:, None]
    chained = keep_states(active) & linked
    tracks = tracks_of(active, chained, segments.run, segments.chains)
    every_block = np.ones_like(tracks.required.torque)
    if any((setup.torques and setup.torques.on_joints) or setup.arm for setup in segments.setups):
        tracks = tracks._replace(required=tracks.required._replace(torque=every_block))
    if any(setup.arm for setup in segments.setups):
        tracks = tracks._replace(required=tracks.required._replace(prescribed=every_block))
    rig = RigConstants(*map(float, constants))
    arrays = _arrays(segments, rig)
    lanes = FEW_LANES if chained.all() and len(tracks.candidate) <= FEW_LANES else LANES
    buffers = allocate(arrays, n, 3 if arm else 2, lanes)
    predict_tracks(advance(lanes), tracks, arrays, candidates, rig, buffers)
    return buffers.angles, buffers.initial_internal


def _arrays(segments: Segments, constants: RigConstants) -> SegmentArrays:
    hanging = [constants_of_run(constants, setup) for setup in segments.setups]
    parts = np.array([(rig.L1, rig.L2, rig.m1, rig.m2, rig.mb) for rig in hanging])
    return SegmentArrays(segments.t, segments.offsets, segments.run, segments.step, parts, drive_of(segments.setups))


def _shaped(values: Array, shape: tuple[int, ...], name: str) -> Array:
    """Broadcast values to a shape; the compiled kernel needs a contiguous copy."""
    shaped = np.empty(shape)
    try:
        shaped[:] = values
    except ValueError:
        raise ValueError(f"{name} must have shape {shape}, not {values.shape}") from None
    return shaped

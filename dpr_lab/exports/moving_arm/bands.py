"""Compute predictive bands of an ensemble of models with a moving arm.

The bands are computed as for a clamped arm (`dpr_lab.exports.ensemble.bands`), but in windows. An arm with rods soon
moves chaotically. In each window, every model starts from a random initial state, which is drawn from its distribution
given the first readings of the window. The later readings are compared.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.errors import RunError
from dpr_lab.exports.ensemble.bands import BANDS, PredictiveBand, quantiles_of
from dpr_lab.exports.ensemble.starts import drawn_starts
from dpr_lab.exports.moving_arm.replay import ARM_REPLAY, arm_first, noise_of, run_problem
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods_with_effects import RodsWithEffects
from dpr_lab.identification.moving_arm.engine import engine_constants, engine_values
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig
from dpr_lab.run import Run


def predictive_arm_band(members: Sequence[MovingArmModel], run: Run, rig: Rig, seed: int) -> PredictiveBand:
    """Compute the predictive band of an ensemble for one recording.

    Args:
        members: the ensemble
        run: the recording
        rig: rig of the recording
        seed: seed of initial states and noise

    Raises:
        RunError: the mode of the arm differs between run and models, or no model can follow the readings.
    """
    rng = np.random.default_rng(seed)
    problem, initial = run_problem(run, rig, members[0], BANDS.window_s)
    segments = problem.segments
    first = segments.t[segments.offsets[:-1]][problem.owner]
    head = segments.t < first + BANDS.start_s
    stride = max(1, round(1.0 / max(float(np.median(np.diff(segments.t))) * BANDS.rate_hz, 1e-9)))
    compared = ~head & (segments.t <= segments.t[0] + BANDS.length_s) & (np.arange(len(head)) % stride == 0)
    started = replace(problem, weight=np.where(head[:, None], problem.weight, 0.0))
    drawn = np.array([_readings(member, started, initial, rig, compared, rng) for member in members])
    drawn += np.nan_to_num(noise_of(problem)) * rng.standard_normal(drawn.shape)
    if not np.isfinite(drawn).all(axis=(1, 2)).any():
        raise RunError(f"{run.file or run.name}: no model of the ensemble can follow these readings")
    low, high = (np.roll(bound, 1, axis=1) for bound in quantiles_of(drawn))
    measured = arm_first(problem, problem.measured)[compared]
    t = segments.t[compared]
    return PredictiveBand(run.name, float(t[-1]) if len(t) else 0.0, t, measured, low, high)


def _readings(
    member: MovingArmModel,
    started: Problem,
    initial: Array,
    rig: Rig,
    compared: Flags,
    rng: np.random.Generator,
) -> Array:
    """Simulate the readings (n, 3) of one model from random initial states, without noise, rad."""
    problem = replace(started, model=RodsWithEffects(engine_constants(member, rig)))
    unknown, params = engine_values(member, rig)
    followed = fit(problem, Estimate.of(unknown, params, initial), (), iterations=ARM_REPLAY.iterations)
    return problem.predict(drawn_starts(problem, followed, rng))[compared]

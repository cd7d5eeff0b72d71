"""Uncertainty that the prediction of a correct model has, for comparison with the prediction error.

    E = simulation - measurement,    u_val^2 = u_num^2 + u_input^2 + u_D^2

An error E far above u_val (`FREE_RUN_TEST`) is attributed to the model itself. All contributions are propagated along a
free run up to the predictability horizon. The initial state of this run is fitted to the first readings:

    u_num      by halving the step of the integrator
    u_input    by the measured or assumed constants of the rig, each with refitted ratios, and by the noise in the
               inputs, the fitted values and the initial state
    u_D        by the noise of the compared readings

No contribution contains the model error; otherwise no error would ever exceed u_val.

A change of an input by one standard uncertainty changes the whitened readings by c. The fitted values absorb a part of
c, and c' remains. The recordings would show a large error of the input by a residual of this shape. They therefore
reduce the standard uncertainty by the factor (1 + |c'|^2 / f)^-1/2, where f is the variance inflation n / n_eff.

Sources: ASME V&V 20-2009, Standard for Verification and Validation in Computational Fluid Dynamics and Heat Transfer;
JCGM 100:2008 (GUM), 4.3.7 for limits without a distribution.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import EFFECTS
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.covariance import considered, shifted
from dpr_lab.fitting.disturbance import disturbance
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.evidence import UncertaintySource
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import FreeRuns
from dpr_lab.rig import MASSES, Rig


@dataclass(frozen=True, slots=True)
class AssumedInputs:
    """Assumed uncertainties of constants for which the rig file states none.

    A limit is the half width of a rectangular distribution.
    """

    rule_m: float = 1e-3
    """Limit of the error of L1, m, measured with a ruler in millimetres."""
    gravity: float = 0.026
    """Limit of the error of g: half its range at sea level, from the equator (9.780) to the poles (9.832), m/s^2."""
    rectangular: float = 3.0**-0.5
    """Standard deviation of a uniform distribution of half width 1."""
    richardson: float = 16 / 15
    """Ratio of the error of a fourth-order method to the change of the result when the step is halved."""


ASSUMED = AssumedInputs()

Kind = Literal["numerical", "input", "data"]


@dataclass(frozen=True, slots=True)
class Source:
    """One contribution to the uncertainty of the predicted readings."""

    name: str
    kind: Kind
    how: str
    variance: list[Array]
    """(n, 2) variance of the predicted readings of each recording, rad^2."""
    left: float = 1.0
    """Factor by which the recordings reduce the stated standard uncertainty of the source."""


def sources(problem: Problem, model: Hypothesis, recordings: Recordings, runs: FreeRuns) -> Iterator[Source]:
    """Yield all sources of the uncertainty of the free runs of a model.

    The sources are the integrator, constants of the rig, inputs, and the noise of the readings. This noise affects the
    fitted values, the initial state, and the comparison itself.
    """
    rig, swings, level, noise = recordings.rig, runs.swings, model.residuals.level, model.residuals.independent_noise
    origin = "half the step of the Runge-Kutta method, with refitted values"
    changes, _ = _changes(problem, model, runs, Problem.with_half_steps)
    yield Source("integrator", "numerical", origin, [(ASSUMED.richardson * change) ** 2 for change in changes])
    for name, origin, constants in _changed(problem.model.constants, rig, problem.always):
        changes, left = _changes(problem, model, runs, partial(Problem.with_constants, constants=constants))
        yield Source(name, "input", origin, [(left * change) ** 2 for change in changes], left)
    if not all(setup.free and setup.inner is None for setup in problem.segments.setups):
        origin = "noise of measured torques, and of the readings of a prescribed joint"
        yield Source("inputs", "input", origin, _by_inputs(recordings, runs))
    origin, spread = "noise of the readings to which ratios and effects are fitted", considered(model.fit, noise)
    moves = (swing.refitted_changes(swing.by_values) for swing in swings)
    yield Source("fitted values", "input", origin, [np.einsum("nij,jk,nik->ni", D, spread, D) for D in moves])
    origin = "noise of the readings to which the initial state is fitted"
    yield Source("initial state", "input", origin, [noise * swing.start_variance() for swing in swings])
    weights = (swing.weight for swing in swings)
    of_readings = [np.where(weight > 0, level / np.maximum(weight, 1e-140) ** 2, 0.0) for weight in weights]
    yield Source("readings", "data", "noise of the compared readings", of_readings)


def _changes(
    problem: Problem, model: Hypothesis, runs: FreeRuns, change: Callable[[Problem], Problem]
) -> tuple[list[Array], float]:
    """Change the problem, refit the model to first order, and return the changes of the free runs.

    Args:
        problem: segments of the fit
        model: the model that is refitted to unchanged readings
        runs: free runs of the model
        change: change of an input by one standard uncertainty, or of the integrator

    Returns:
        (n, 2) change of the predicted readings of each free run, rad, and the factor by which the recordings reduce the
        standard uncertainty
    """
    fit = model.fit
    other = change(problem).predict(fit.estimate)
    whitened = problem.whitened(np.nan_to_num(other - problem.predict(fit.estimate)))
    step = shifted(fit, whitened)
    remaining = fit.linear.projected(whitened[:, :, None])[:, :, 0] + fit.linear.A @ step
    changes = [
        swing.refitted_changes((direct + swing.by_values @ step)[:, :, None])[:, :, 0]
        for swing, direct in zip(runs.swings, runs.changes_with(change), strict=True)
    ]
    return changes, float((1 + np.sum(remaining**2) / model.inflation) ** -0.5)


def _by_inputs(recordings: Recordings, runs: FreeRuns) -> list[Array]:
    """Return the (n, 2) variance of each free run due to noise of measured torques and prescribed motions, rad^2."""
    most_Nm = (0.0, 0.0) if recordings.exact_torques else recordings.torque_noise_Nm
    noise = disturbance(runs.problem, runs.start, most_Nm=most_Nm)
    if noise is None:
        return [np.zeros_like(swing.predicted) for swing in runs.swings]
    outs = ((noise.out[rows], np.cumsum(noise.walk[rows], axis=0)) for rows in runs.rows)
    return [np.einsum("nij,njk,nik->ni", out, P, out) for out, P in outs]


def _changed(known: RigConstants, rig: Rig, fitted: Sequence[str]) -> Iterator[tuple[str, str, RigConstants]]:
    """Yield name, origin of the uncertainty, and changed constants, for each uncertain constant of the rig.

    One constant at a time is changed by its standard uncertainty. A fitted L1 is left out.
    """
    if not any(EFFECTS[name].corrects == "L1" for name in fitted):
        std = ASSUMED.rule_m * ASSUMED.rectangular
        description = (
            f"{1e3 * std:.2g} mm, assumed: read from a ruler to {1e3 * ASSUMED.rule_m:g} mm; no uncertainty in the"
            " rig file"
        )
        yield "L1", description, known._replace(L1=known.L1 + std)
    std = ASSUMED.gravity * ASSUMED.rectangular
    yield "g", f"{std:.2g} m/s², assumed: anywhere on earth at sea level", known._replace(g=known.g + std)
    for name in MASSES:
        if (weighed := rig.parameters[name].std) is not None:
            changed = known._replace(**{name: getattr(known, name) + weighed})
            yield name, f"{1e3 * weighed:.2g} g, from the rig file", changed


def mean_squares(parts: Sequence[Source], compared: Sequence[Flags]) -> Array:
    """Return the (sources, runs) mean variance due to each source over the compared readings, rad^2."""
    by_source = [[values[samples] for values, samples in zip(part.variance, compared, strict=True)] for part in parts]
    return np.array([[float(values.mean()) if len(values) else 0.0 for values in row] for row in by_source])


def uncertainty_sources(
    by_model: Mapping[str, Sequence[Source]], pooled: Mapping[str, Array]
) -> list[UncertaintySource]:
    """Return the rows of the uncertainty budget.

    Args:
        by_model: sources of the uncertainty, under the keys `before` and `after` the correction
        pooled: (sources,) mean squares under the same keys, pooled over the free runs
    """
    return [
        UncertaintySource(
            name=source.name,
            kind=source.kind,
            how=source.how,
            left=source.left,
            before_rad=float(np.sqrt(pooled["before"][i])),
            after_rad=float(np.sqrt(pooled["after"][i])),
        )
        for i, source in enumerate(by_model["after"])
    ]

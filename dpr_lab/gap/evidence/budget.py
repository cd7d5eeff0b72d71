"""Uncertainty of the prediction of a correct model, compared with the prediction error.

    E = simulation - measurement,    u_val^2 = u_num^2 + u_input^2 + u_D^2

An error E far above u_val (`FREE_RUN_TEST`) is attributed to the model itself. All contributions are propagated to a
free run whose initial state is fitted to the first readings, up to the predictability horizon:

    u_num      by halving the step of the integrator
    u_input    by the measured or assumed constants of the rig, with the ratios refitted each time, and by the noise in
               the inputs, the fitted values and the initial state
    u_D        by the noise of the compared readings

No contribution contains the model error; otherwise no error would ever exceed u_val.

A change of an input by one standard uncertainty changes the readings by c. The fitted values absorb a part of c, and c'
remains. A larger error of the input would be visible in the recordings. The recordings therefore reduce the standard
uncertainty by the factor (1 + |c'|^2 / f)^-1/2, where f is the variance inflation n / n_eff.

Sources: ASME V&V 20-2009, Standard for Verification and Validation in Computational Fluid Dynamics and Heat Transfer;
JCGM 100:2008 (GUM), 4.3.7 for limits without a distribution.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, Self

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
    """Half the range of g at sea level, from the equator (9.780) to the poles (9.832), m/s^2."""
    rectangular: float = 3.0**-0.5
    """Standard deviation of a uniform distribution of half width 1."""
    richardson: float = 16 / 15
    """Ratio of the error of a fourth-order method to the change of its result when the step is halved."""


ASSUMED = AssumedInputs()

Kind = Literal["numerical", "input", "data"]


@dataclass(frozen=True, slots=True)
class _Source:
    """One contribution to the uncertainty of a prediction."""

    name: str
    kind: Kind
    how: str
    variance: Callable[[FreeRuns], list[Array]]
    """Function that returns the (n, 2) variance of the predicted readings of each recording, rad^2."""
    left: float = 1.0
    """Factor by which the recordings reduce the given standard uncertainty of the source."""


def sources(problem: Problem, model: Hypothesis, recordings: Recordings) -> list[_Source]:
    """Return all sources of the uncertainty of a prediction."""
    return [
        _integrator(problem, model),
        *_constants(problem, model, recordings.rig),
        *_inputs(problem, recordings),
        *_noise(model),
    ]


Change = Callable[[Problem], Problem]
"""Change of an input by one standard uncertainty, or of the integrator, in the problem of the fit or of free runs."""


@dataclass(frozen=True, slots=True)
class _Refit:
    """First-order refit of the model after a change of the predicted readings."""

    change: Change
    step: Array
    """(free,) change of the fitted values."""
    reduction: float
    """Factor (1 + |c'|^2 / f)^-1/2 by which the recordings reduce the standard uncertainty of the change."""

    @classmethod
    def of(cls, problem: Problem, model: Hypothesis, change: Change) -> Self:
        """Refit the model to the same readings after a change of the problem, in linear approximation."""
        fit = model.fit
        other = change(problem).predict(fit.estimate)
        whitened = problem.whitened(np.nan_to_num(other - problem.predict(fit.estimate)))
        step = shifted(fit, whitened)
        remaining = fit.linear.projected(whitened[:, :, None])[:, :, 0] + fit.linear.A @ step
        return cls(change, step, float((1 + np.sum(remaining**2) / model.inflation) ** -0.5))

    def variance(self, runs: FreeRuns, factor: float) -> list[Array]:
        """Return the (n, 2) squared change, rad^2, of each free run after the refit.

        Args:
            runs: the free runs
            factor: factor on the total change
        """
        return [
            (factor * swing.settled((change + swing.by_values @ self.step)[:, :, None])[:, :, 0]) ** 2
            for swing, change in zip(runs.swings, runs.otherwise(self.change), strict=True)
        ]


def _integrator(problem: Problem, model: Hypothesis) -> _Source:
    """Return the contribution of the integrator, from a prediction with half the step."""
    refit = _Refit.of(problem, model, _halved)
    return _Source(
        "integrator",
        "numerical",
        "half the step of the Runge-Kutta method, with refitted values",
        partial(refit.variance, factor=ASSUMED.richardson),
    )


def _halved(problem: Problem) -> Problem:
    return replace(problem, segments=replace(problem.segments, step=problem.segments.step / 2))


def _constants(problem: Problem, model: Hypothesis, rig: Rig) -> Iterator[_Source]:
    """Yield the contribution of each length, weighed mass, and gravity.

    Each value is changed by one standard uncertainty.
    """
    for name, description, constants in _changed(problem.model.constants, rig, problem.always):
        refit = _Refit.of(problem, model, partial(_with_constants, constants=constants))
        yield _Source(name, "input", description, partial(refit.variance, factor=refit.reduction), refit.reduction)


def _with_constants(problem: Problem, constants: RigConstants) -> Problem:
    return replace(problem, model=problem.model.with_constants(constants))


def _inputs(problem: Problem, recordings: Recordings) -> Iterator[_Source]:
    """Yield the contribution of the noise of measured torques and prescribed motions, as process noise."""
    if all(setup.free and setup.inner is None for setup in problem.segments.setups):
        return
    most_Nm = (0.0, 0.0) if recordings.exact_torques else recordings.torque_noise_Nm

    def variance(runs: FreeRuns) -> list[Array]:
        noise = disturbance(runs.problem, runs.start, most_Nm=most_Nm)
        if noise is None:
            return [np.zeros_like(swing.predicted) for swing in runs.swings]
        covariances = [np.cumsum(noise.walk[rows], axis=0) for rows in runs.rows]
        return [
            np.einsum("nij,njk,nik->ni", noise.out[rows], P, noise.out[rows])
            for rows, P in zip(runs.rows, covariances, strict=True)
        ]

    yield _Source("inputs", "input", "noise of measured torques, and of the readings of a prescribed joint", variance)


def _noise(model: Hypothesis) -> Iterator[_Source]:
    """Yield the contributions of the noise of the readings.

    The noise acts on the fitted values, on the initial state, and on the comparison itself.
    """
    level, noise = model.residuals.level, model.residuals.independent_noise
    spread = considered(model.fit, noise)

    def of_values(runs: FreeRuns) -> list[Array]:
        moves = [swing.settled(swing.by_values) for swing in runs.swings]
        return [np.einsum("nij,jk,nik->ni", D, spread, D) for D in moves]

    def of_readings(runs: FreeRuns) -> list[Array]:
        weights = [swing.weight for swing in runs.swings]
        return [np.where(weight > 0, level / np.maximum(weight, 1e-140) ** 2, 0.0) for weight in weights]

    fitted = "noise of the readings to which ratios and effects are fitted"
    yield _Source("fitted values", "input", fitted, of_values)
    yield _Source(
        "initial state",
        "input",
        "noise of the readings to which the initial state is fitted",
        lambda runs: [noise * swing.start_variance() for swing in runs.swings],
    )
    yield _Source("readings", "data", "noise of the compared readings", of_readings)


def _changed(known: RigConstants, rig: Rig, fitted: Sequence[str]) -> Iterator[tuple[str, str, RigConstants]]:
    """Yield name, source and changed constants for each measured constant of the rig.

    The change is one standard uncertainty of this constant.
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


def mean_squares(parts: Sequence[_Source], runs: FreeRuns, compared: Sequence[Flags]) -> Array:
    """Return the (sources, runs) mean variance of the readings due to each source, rad^2."""
    by_source = [
        [values[samples] for values, samples in zip(source.variance(runs), compared, strict=True)] for source in parts
    ]
    return np.array([[float(values.mean()) if len(values) else 0.0 for values in row] for row in by_source])


def uncertainty_sources(
    by_model: Mapping[str, Sequence[_Source]], pooled: Mapping[str, Array]
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

"""Uncertainty of a prediction although the model is right, compared with its error.

    E = simulation - measurement,    u_val^2 = u_num^2 + u_input^2 + u_D^2

E beyond 2 u_val is the model's own fault. All are propagated to a free run from a start state that the first readings
fix, up to the predictability horizon: u_num by halving the integrator's step, u_input by what was measured or assumed
of the rig (with the ratios refitted each time), by the noise in what fitted values and start state rest on, u_D by
that of the readings compared. What the model itself lacks is in none of them, or no error would ever be beyond them.

An input one standard uncertainty off changes the readings by c, of which c' remains after the fitted values absorb
their part. With f what one piece of independent evidence costs, the recordings themselves leave the share (1 + |c'|^2
/ f)^-1/2 of it: what would be seen in them is not unsure.

Sources: ASME V&V 20-2009, Standard for Verification and Validation in Computational Fluid Dynamics and Heat Transfer;
JCGM 100:2008 (GUM), 4.3.7 for limits without a distribution.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.covariance import considered, shifted
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.evidence import UncertaintySource
from dpr_lab.rig import MASSES, Rig

if TYPE_CHECKING:
    from dpr_lab.gap.evidence.free_swing import FreeSwings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AssumedInputs:
    """Assumed uncertainties where the rig file states none; a limit is the half width of a rectangular density."""

    rule_m: float = 1e-3
    """L1, by a steel rule with millimetres, at either end."""
    gravity: float = 0.026
    """g of sea level from the equator (9.780) to the poles (9.832), m/s^2."""
    rectangular: float = 3.0**-0.5
    """Standard deviation of a rectangular distribution of half width 1."""
    richardson: float = 16 / 15
    """Error of a fourth-order method over its change when the step is halved."""


ASSUMED = AssumedInputs()

Kind = Literal["numerical", "input", "data"]


@dataclass(frozen=True, slots=True)
class _Source:
    """One contribution, and by what standard deviations or variances it moves a prediction."""

    name: str
    kind: Kind
    how: str
    variance: Callable[["FreeSwings"], list[Array]]
    """(n, 2) of each recording, rad^2."""
    left: float = 1.0
    """Share of the standard uncertainty put in that the recordings leave."""


def sources(problem: Problem, at: Hypothesis, rig: Rig) -> list[_Source]:
    """Every contribution to the uncertainty of a prediction."""
    before = problem.predict(at.fit.estimate)

    def fitted_anew(other: Problem) -> tuple[Array, float]:
        change = problem.whitened(np.nan_to_num(other.predict(at.fit.estimate) - before))
        step = shifted(at.fit, change)
        seen = at.fit.linear.projected(change[:, :, None])[:, :, 0] + at.fit.linear.A @ step
        return step, float((1 + np.sum(seen**2) / at.residuals.inflation) ** -0.5)

    def moved(
        step: Array, factor: float, changes: Callable[["FreeSwings"], list[Array]]
    ) -> Callable[["FreeSwings"], list[Array]]:
        return lambda swings: [
            (factor * swing.settled((change + swing.by_values @ step)[:, :, None])[:, :, 0]) ** 2
            for swing, change in zip(swings.each, changes(swings), strict=True)
        ]

    halved = replace(problem, segments=replace(problem.segments, step=problem.segments.step / 2))
    finer = moved(fitted_anew(halved)[0], ASSUMED.richardson, lambda swings: swings.otherwise(finer=2.0))
    how = "halving the step of the Runge-Kutta method, the values refitted"
    found = [_Source("integrator", "numerical", how, finer)]
    for name, how, constants in _inputs(problem.model.constants, rig, problem.always):
        step, left = fitted_anew(replace(problem, model=problem.model.with_constants(constants)))
        moves = moved(step, left, lambda swings, c=constants: swings.otherwise(c))
        found.append(_Source(name, "input", how, moves, left))
    level, rho = at.residuals.level, at.residuals.noise_correlation
    noise = level * (1 + rho) / (1 - rho)
    spread = considered(at.fit, noise)

    def along(swings: "FreeSwings") -> list[Array]:
        moves = [swing.settled(swing.by_values) for swing in swings.each]
        return [np.einsum("nij,jk,nik->ni", D, spread, D) for D in moves]

    return [
        *found,
        _Source("fitted values", "input", "noise of the readings that ratios and effects are fitted to", along),
        _Source(
            "start state",
            "input",
            "noise of the readings that it is fitted to",
            lambda swings: [noise * swing.start_variance() for swing in swings.each],
        ),
        _Source(
            "readings",
            "data",
            "noise of the readings compared",
            lambda swings: [
                np.where(swing.weight > 0, level / np.maximum(swing.weight, 1e-140) ** 2, 0.0) for swing in swings.each
            ],
        ),
    ]


def _inputs(known: RigConstants, rig: Rig, fitted: Sequence[str]) -> Iterator[tuple[str, str, RigConstants]]:
    """What was measured of the rig: name, how it is known, and the rig one standard uncertainty away."""
    if not fitted:
        std = ASSUMED.rule_m * ASSUMED.rectangular
        how = f"{1e3 * std:.2g} mm, assumed: read off a rule to {1e3 * ASSUMED.rule_m:g} mm; the rig file gives none"
        yield "L1", how, known._replace(L1=known.L1 + std)
    std = ASSUMED.gravity * ASSUMED.rectangular
    yield "g", f"{std:.2g} m/s², assumed: anywhere on earth at sea level", known._replace(g=known.g + std)
    for name in MASSES:
        if (weighed := rig.parameters[name].std) is not None:
            changed = known._replace(**{name: getattr(known, name) + weighed})
            yield name, f"{1e3 * weighed:.2g} g, from the rig file", changed


def mean_squares(found: Sequence[_Source], swings: "FreeSwings", compared: Sequence[NDArray[np.bool_]]) -> Array:
    """(sources, swings) mean variance over what is compared of each, (n, 2), rad^2."""
    each = [[values[own] for values, own in zip(item.variance(swings), compared, strict=True)] for item in found]
    return np.array([[float(values.mean()) if len(values) else 0.0 for values in row] for row in each])


def uncertainty_sources(found: Mapping[str, Sequence[_Source]], pooled: Mapping[str, Array]) -> list[UncertaintySource]:
    """Rows of the budget, from the sources and pooled mean squares (sources,) before and after."""
    return [
        UncertaintySource(
            name=item.name,
            kind=item.kind,
            how=item.how,
            left=item.left,
            before_rad=float(np.sqrt(pooled["before"][i])),
            after_rad=float(np.sqrt(pooled["after"][i])),
        )
        for i, item in enumerate(found["after"])
    ]

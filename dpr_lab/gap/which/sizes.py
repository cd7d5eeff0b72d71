"""Detection of effect sizes that are impossible or indicate another cause.

Near the noise, the amplitudes of an effect are strongly correlated. A fit may, for example, estimate the stiffness of a
hardening spring as zero, which is impossible. The intervals of the sizes are therefore considered.
"""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, base_of_run
from dpr_lab.effects import EFFECTS, named_params, param_index
from dpr_lab.effects.com_offset import COM_OFFSET_LINK1
from dpr_lab.effects.effect import Effect, Params
from dpr_lab.effects.limits import oversized
from dpr_lab.errors import IdentificationError
from dpr_lab.fitting.covariance import considered
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.size_prior import SCALES, SPRINGS


@dataclass(frozen=True, slots=True)
class SizeRules:
    """Width of the interval of a fitted size, and spring ratios that suggest an error of the encoder scale."""

    deviations: float = 2.0
    """Half the width of the interval of a fitted value, in standard deviations."""
    softening: float = -1 / 12
    """Ratio k3 / k of a spring that softens like an error of the encoder scale."""
    tolerance: float = 0.5
    """Maximum relative deviation of a fitted ratio k3 / k from `softening`."""


RULES = SizeRules()

SIZES = ("stiffness_Nm_per_rad", "cubic_Nm_per_rad3")
"""Names of the parameters k and k3 of a spring."""


def half_width(model: Hypothesis, effect: str, name: str) -> float | None:
    """Return half the width of the interval of a fitted value, or None if the value is not fitted.

    Args:
        model: the fitted set
        effect: effect of the parameter; empty for a ratio
        name: name of the parameter
    """
    place = next((i for i, p in enumerate(model.fit.free) if (p.effect, p.name) == (effect, name)), None)
    if place is None:
        return None
    return RULES.deviations * float(np.sqrt(np.diag(considered(model.fit, model.inflation))[place]))


def significantly_oversized(model: Hypothesis, limits: Array | None) -> tuple[str, ...]:
    """Return the effects with impossible sizes, within the errors of the fit.

    A size is impossible at its limit, or if the sizes of the effect cannot occur together.

    Args:
        model: the fitted set
        limits: (SIZE,) maximum sizes; None: no limits
    """
    params = model.estimate.params

    def impossible(name: str) -> bool:
        effect, sizes = EFFECTS[name], named_params(params)[name]
        if effect.possible(sizes):  # together, so one of them is at its limit
            return True
        errors = {p.name: half_width(model, name, p.name) or 0.0 for p in effect.amplitudes}
        return impossible_together(effect, sizes, errors)

    return tuple(name for name in oversized(params, limits) if impossible(name))


def impossible_together(effect: Effect, sizes: Params, errors: Mapping[str, float]) -> bool:
    """Return whether no sizes of an effect within their intervals can occur together.

    The tested values of each amplitude are its estimate, the ends of its interval, and zero if the interval contains
    zero.

    Args:
        effect: the effect
        sizes: estimates of its amplitudes
        errors: half the width of the interval of each amplitude
    """

    def choices(name: str, value: float) -> set[float]:
        error = errors.get(name, 0.0)
        return {value, value - error, value + error, 0.0 if abs(value) < error else value}

    every = product(*(choices(name, value) for name, value in sizes.items()))
    return not any(effect.possible(dict(zip(sizes, chosen, strict=True))) for chosen in every)


def off_axis(problem: Problem, model: Hypothesis) -> tuple[str, ...]:
    """Return the centre-of-mass offset of the inner rod if its size is implausible.

    The offset is implausible if it is significantly larger than the distance of the centre of mass along the rod. Such
    a rod would hang at more than 45 degrees from zero. A wrong zero of the angles, or a constant torque, is more
    probable.
    """
    effect, constants = COM_OFFSET_LINK1, problem.model.constants
    sizes = named_params(model.estimate.params)
    if effect.name not in sizes or (torque := _gravity_torque(problem, model)) is None:
        return ()
    ((name, offset),) = sizes[effect.name].items()
    if (error := half_width(model, effect.name, name)) is None:
        return ()
    least = constants.m1 * constants.g * (abs(offset) - error)
    return (effect.name,) if least > torque * model.estimate.ratios[SCALE] else ()


def rises(problem: Problem, model: Hypothesis) -> bool:
    """Return whether the gravity torque of the inner rod is significantly negative.

    In swings of similar amplitude, an effect that depends on the angle can compensate for a gravity torque of wrong
    size or sign.
    """
    torque = _gravity_torque(problem, model)
    if torque is None or torque >= 0.0:
        return False
    error = half_width(model, "", "e1/b")
    return error is not None and torque + error < 0.0


def refuse_rising(problem: Problem, model: Hypothesis) -> None:
    """Reject a model in which the weight of the inner rod acts upwards.

    Raises:
        IdentificationError: the gravity torque is significantly negative.
    """
    if not rises(problem, model):
        return
    described = f" The model contains {', '.join(model.effects)}, which may replace gravity." if model.effects else ""
    raise IdentificationError(
        "the weight of the inner rod acts upwards (gravity torque divided by b:"
        f" {_gravity_torque(problem, model):.3g} 1/s^2).{described}"
        " Check the sign, the unit and the zero of each angle, also of the arm (--scale, --unit, --zero)."
    )


def _gravity_torque(problem: Problem, model: Hypothesis) -> float | None:
    """Return the largest gravity torque of the inner rod, divided by b, 1/s^2.

    The result is None if no inner rod is mounted in any run, or if g is zero.
    """
    estimate, constants = model.estimate, problem.model.constants
    setups = [setup for setup in set(problem.segments.setups) if setup.mounting != "outer"]
    if not (setups and constants.g > 0.0):
        return None
    whole = estimate.whole / estimate.ratios[SCALE]
    return max(float(base_of_run(whole, setup, constants.L1, constants.g)[BASE.index("e1")]) for setup in setups)


def springs_like_scale(problem: Problem, library: Container[str], model: Hypothesis) -> tuple[str, ...]:
    """Return the softening springs that an error of the encoder scale probably causes.

    An encoder of a single rod that reads q = (1 + x) theta changes the acceleration of the reading by

        -x w (sin q - q cos q),    w = e1 / a.

    Up to terms in q^7, this equals the change by a spring k q + k3 q^3 with k / a = 4 x w and k3 = -k / 12, and by a
    gravity torque that is smaller by k. On an arc of 3 rad, the best ratio k3 / k is -0.071, and 0.4 % of the change
    are not reproduced. The recordings of a single rod therefore do not distinguish the two causes. A real spring would
    have this ratio only by coincidence, so a significantly softening spring with this ratio is returned.
    """
    springs: list[str] = []
    if not all(setup.held for setup in set(problem.segments.setups)):
        return ()
    for spring, scale in zip(SPRINGS, SCALES, strict=True):
        if spring not in model.effects or scale not in library:
            continue
        stiffness, cubic = model.estimate.params[[param_index(spring, name) for name in SIZES]]
        like_scale = abs(cubic - RULES.softening * stiffness) < RULES.tolerance * abs(RULES.softening) * stiffness
        if like_scale and (error := half_width(model, spring, SIZES[1])) is not None and cubic + error < 0.0:
            springs.append(spring)
    return tuple(springs)

"""Springs with the same softening as an error of the encoder scale.

An encoder of a single rod that reads q = (1 + x) theta changes the acceleration of the reading by

    -x w (sin q - q cos q),    w = e1 / a.

Up to terms in q^7, this is the change by a spring k q + k3 q^3 with k / a = 4 x w and k3 = -k / 12, together with a
gravity torque that is smaller by k. On an arc of 3 rad the best ratio k3 / k is -0.071, and 0.4 % of the change remain.
The recordings of one rod therefore do not distinguish the two causes. A real spring would have exactly this ratio only
by coincidence.
"""

from collections.abc import Container

from dpr_lab.effects import param_index
from dpr_lab.effects.encoder_scale import ENCODER_SCALE
from dpr_lab.effects.spring import SPRING
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.which.sizes import errors

SPRINGS, ENCODER_SCALES = ([effect.name for effect in pair] for pair in (SPRING, ENCODER_SCALE))
"""Names of the springs, and of the errors of the encoder scale, of joints 1 and 2."""

SIZES = ("stiffness_Nm_per_rad", "cubic_Nm_per_rad3")
"""Names of the parameters k and k3 of a spring."""


def springs_like_scale(
    problem: Problem, library: Container[str], model: Hypothesis, ratio: float = -1 / 12, tolerance: float = 0.5
) -> tuple[str, ...]:
    """Return the springs of a single rod that soften significantly, with the ratio k3 / k of a scale error."""
    springs: list[str] = []
    if not all(setup.held for setup in set(problem.segments.setups)):
        return ()
    for spring, scale in zip(SPRINGS, ENCODER_SCALES, strict=True):
        if spring not in model.effects or scale not in library:
            continue
        stiffness, cubic = model.fit.estimate.params[[param_index(spring, name) for name in SIZES]]
        free = [i for i, p in enumerate(model.fit.free) if (p.effect, p.name) == (spring, SIZES[1])]
        like_scale = free and abs(cubic - ratio * stiffness) < tolerance * abs(ratio) * stiffness
        if like_scale and cubic + errors(model)[free[0]] < 0.0:
            springs.append(spring)
    return tuple(springs)

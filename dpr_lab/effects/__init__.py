"""Library of physical effects that the base model lacks; each file defines one kind.

The order of the table `EFFECTS` defines the flat parameter vector; effects of plugins (`dpr_lab.plugins`) come last. An
effect is active if one of its amplitudes is not zero.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects.air_drag import AIR_DRAG_BOTH, AIR_DRAG_JOINT0, AIR_DRAG_OUTER
from dpr_lab.effects.arm_compliance import ARM_COMPLIANCE
from dpr_lab.effects.axis_tilt import AXIS_TILT_JOINT0
from dpr_lab.effects.backlash import BACKLASH_JOINT0, BACKLASH_JOINT1, BACKLASH_JOINT2
from dpr_lab.effects.base_tilt import BASE_TILT
from dpr_lab.effects.base_vibration import BASE_VIBRATION
from dpr_lab.effects.clock_rate import CLOCK_RATE
from dpr_lab.effects.com_offset import COM_OFFSET_LINK1, COM_OFFSET_LINK2
from dpr_lab.effects.coulomb import COULOMB, COULOMB_JOINT0
from dpr_lab.effects.dead_zone import DEAD_ZONE_JOINT0
from dpr_lab.effects.detent import DETENT_JOINT0, DETENT_JOINT1, DETENT_JOINT2
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect, Recorded, Shape
from dpr_lab.effects.encoder_drift import ENCODER_DRIFT
from dpr_lab.effects.encoder_eccentricity import ENCODER_ECCENTRICITY, ENCODER_ECCENTRICITY_JOINT0
from dpr_lab.effects.encoder_offset import ENCODER_OFFSET_JOINT0, ENCODER_OFFSET_JOINT1, ENCODER_OFFSET_JOINT2
from dpr_lab.effects.encoder_scale import ENCODER_SCALE, ENCODER_SCALE_JOINT0
from dpr_lab.effects.fold import slices
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.friction_curve import FRICTION_CURVE, FRICTION_CURVE_JOINT0
from dpr_lab.effects.friction_drift import FRICTION_DRIFT
from dpr_lab.effects.hard_stop import HARD_STOP_JOINT0
from dpr_lab.effects.hysteresis import HYSTERESIS, HYSTERESIS_JOINT0
from dpr_lab.effects.input_delay import INPUT_DELAY
from dpr_lab.effects.latency import LATENCY_JOINT0, LATENCY_JOINT2
from dpr_lab.effects.load_friction import LOAD_FRICTION
from dpr_lab.effects.missed_counts import MISSED_COUNTS
from dpr_lab.effects.refusal import refusal
from dpr_lab.effects.rotor_inertia import ROTOR_INERTIA_JOINT1, ROTOR_INERTIA_JOINT2
from dpr_lab.effects.saturation import SATURATION_JOINT0
from dpr_lab.effects.spring import SPRING, SPRING_JOINT0
from dpr_lab.effects.stribeck import STRIBECK, STRIBECK_JOINT0
from dpr_lab.effects.torque_offset import TORQUE_OFFSET, TORQUE_OFFSET_JOINT0
from dpr_lab.effects.torque_ripple import TORQUE_RIPPLE, TORQUE_RIPPLE_JOINT0
from dpr_lab.effects.torque_scale import TORQUE_SCALE, TORQUE_SCALE_JOINT0
from dpr_lab.effects.viscous_ground import VISCOUS_GROUND
from dpr_lab.effects.wrong_length import WRONG_LENGTH
from dpr_lab.errors import unknown_name
from dpr_lab.plugins.rows import plugin_rows

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        *COULOMB,
        *STRIBECK,
        *FRICTION_CURVE,
        *LOAD_FRICTION,
        *HYSTERESIS,
        *FRICTION_DRIFT,
        VISCOUS_GROUND,
        AIR_DRAG_OUTER,
        AIR_DRAG_BOTH,
        *SPRING,
        DETENT_JOINT1,
        DETENT_JOINT2,
        ROTOR_INERTIA_JOINT1,
        ROTOR_INERTIA_JOINT2,
        BACKLASH_JOINT2,
        BASE_TILT,
        COM_OFFSET_LINK1,
        COM_OFFSET_LINK2,
        WRONG_LENGTH,
        ARM_COMPLIANCE,
        BASE_VIBRATION,
        ENCODER_OFFSET_JOINT1,
        ENCODER_OFFSET_JOINT2,
        *ENCODER_SCALE,
        *ENCODER_ECCENTRICITY,
        LATENCY_JOINT2,
        CLOCK_RATE,
        MISSED_COUNTS,
        *TORQUE_SCALE,
        *TORQUE_OFFSET,
        *TORQUE_RIPPLE,
        INPUT_DELAY,
        FREE_ARM,
        DRIVE_GAIN,
        COULOMB_JOINT0,
        STRIBECK_JOINT0,
        FRICTION_CURVE_JOINT0,
        SPRING_JOINT0,
        HARD_STOP_JOINT0,
        DETENT_JOINT0,
        ENCODER_OFFSET_JOINT0,
        ENCODER_SCALE_JOINT0,
        ENCODER_ECCENTRICITY_JOINT0,
        LATENCY_JOINT0,
        TORQUE_SCALE_JOINT0,
        TORQUE_OFFSET_JOINT0,
        TORQUE_RIPPLE_JOINT0,
        DEAD_ZONE_JOINT0,
        SATURATION_JOINT0,
        HYSTERESIS_JOINT0,
        AXIS_TILT_JOINT0,
        AIR_DRAG_JOINT0,
        BACKLASH_JOINT1,
        BACKLASH_JOINT0,
        *ENCODER_DRIFT,
    )
}
EFFECTS |= plugin_rows("effects", Effect, EFFECTS, lambda _, effect: effect.name, refusal)

OF_FREE_SWINGS = {name: effect for name, effect in EFFECTS.items() if not (effect.driven or effect.of_arm)}
"""Effects that free swings with a clamped arm can show."""

OF_ARM = {name: effect for name, effect in EFFECTS.items() if effect.of_arm and effect not in (FREE_ARM, DRIVE_GAIN)}
"""Effects that only a rig with a free or driven arm may have, except for the arm itself and the gain of its drive."""

SLICES = slices(EFFECTS.values())
"""Slice of the parameters of each effect in the flat vector."""

SIZE = sum(len(effect.parameters) for effect in EFFECTS.values())

_INDICES = {
    (effect.name, parameter.name): SLICES[effect.name].start + i
    for effect in EFFECTS.values()
    for i, parameter in enumerate(effect.parameters)
}

_AMPLITUDES = {
    effect.name: [_INDICES[effect.name, parameter.name] for parameter in effect.amplitudes]
    for effect in EFFECTS.values()
}

_OF_AMPLITUDE = [name for name, places in _AMPLITUDES.items() for _ in places]
_PLACES = np.array([place for places in _AMPLITUDES.values() for place in places])

_EVENTS = tuple(name for name, effect in EFFECTS.items() if effect.event)

_DEFAULTS = np.array([parameter.default for effect in EFFECTS.values() for parameter in effect.parameters])


def effect_params(values: Mapping[str, Mapping[str, float]]) -> Array:
    """Convert named coefficients to a flat parameter vector.

    A missing amplitude is zero; a missing shape parameter has its default.

    Args:
        values: values by effect and parameter, for example `{"coulomb_joint1": {"torque_Nm": 0.001}}`

    Returns:
        (SIZE,) parameters, SI

    Raises:
        ValueError: an effect or a parameter is unknown.
    """
    params = _DEFAULTS.copy()
    for name, coefficients in values.items():
        if name not in EFFECTS:
            raise ValueError(unknown_name(f"no effect {name!r}", name, EFFECTS))
        for parameter, value in coefficients.items():
            params[param_index(name, parameter)] = value
    return params


def named_params(params: Array, among: Iterable[str] = EFFECTS) -> dict[str, dict[str, float]]:
    """Convert a flat vector to named coefficients of the active effects.

    This is the inverse of `effect_params`. Only effects in `among` are included.
    """
    active = {_OF_AMPLITUDE[i] for i in np.flatnonzero(params[_PLACES]).tolist()}
    return {
        name: dict(zip((p.name for p in EFFECTS[name].parameters), params[SLICES[name]].tolist(), strict=True))
        for name in among
        if name in active
    }


def plausibility(params: Array, effect: str) -> float:
    """Return the prior weight of an effect with its fitted size.

    The weight is nearly the prior odds of the effect if its size is below the scale of the prior, and falls with the
    fourth power of a larger size.
    """
    amplitudes = EFFECTS[effect].amplitudes
    u = max(abs(float(params[place])) / p.prior_scale for place, p in zip(_AMPLITUDES[effect], amplitudes, strict=True))
    return EFFECTS[effect].prior_odds / (1.0 + min(u, 1e6) ** 4)  # positive, so that ratios stay finite


def without_effect(params: Array, effect: str) -> Array:
    """Return the flat vector with one effect at its defaults."""
    params = params.copy()
    params[SLICES[effect]] = _DEFAULTS[SLICES[effect]]
    return params


def without_events(params: Array) -> Array:
    """Return the flat vector without the effects that occurred only once, in one run."""
    for name in _EVENTS:
        params = without_effect(params, name)
    return params


def param_index(effect: str, parameter: str) -> int:
    """Return the index of one parameter of one effect in the flat vector.

    Raises:
        ValueError: the effect has no such parameter.
    """
    if (effect, parameter) not in _INDICES:
        known = ", ".join(p.name for p in EFFECTS[effect].parameters)
        raise ValueError(f"effect {effect} has no parameter {parameter!r}; it has: {known}")
    return _INDICES[effect, parameter]


def proposed_shapes(effect: Effect, recorded: Recorded) -> list[Shape] | None:
    """Return the values of the shape parameters that an effect proposes for given recordings.

    The result is None if the effect has no such function. The grid of `scan` is then used.
    """
    proposed = effect.propose(recorded) if effect.propose else None
    if proposed is None:
        return None
    return [tuple((param_index(effect.name, name), value) for name, value in shapes.items()) for shapes in proposed]

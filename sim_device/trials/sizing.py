"""Scale an effect to a requested gap."""

import math
from dataclasses import dataclass

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.saturation import SATURATION_JOINT0
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.foreign import FOREIGN
from sim_device.trials.noiseless import plant_gap

Coefficients = dict[str, float]


@dataclass(frozen=True, slots=True)
class SizeSearch:
    """Limits of the search for the scale of an effect."""

    exact: float = 0.04
    """Maximum deviation from the requested gap, as the logarithm of the ratio of the gaps."""
    rounds: int = 9
    """Maximum number of tried scales. The nearest result is used."""
    stride: float = 20.0
    """Maximum factor between two successive scales, in either direction."""
    retreat: float = 5.0
    """Divisor of the next scale while all previous scales were too large."""


SEARCH = SizeSearch()


def sized(plant: PlantConfig, rig: Rig, name: str, unit: Coefficients, gap: float) -> Coefficients:
    """Scale the coefficients `unit` of an effect so that it alone causes the requested gap, in units of the noise.

    If no size causes this gap, the coefficients with the nearest gap are returned.
    """
    if name == SATURATION_JOINT0.name:
        return unit  # the output of a drive never exceeds its limit
    table = "foreign" if name in FOREIGN else "effects"
    bare = plant.model_copy(update={"effects": {}, "foreign": {}})
    most = FOREIGN[name].most / abs(unit[FOREIGN[name].amplitude.name]) if name in FOREIGN else math.inf
    scale, bounds = 1.0, [0.0, math.inf]
    nearest, best = math.inf, unit
    for _ in range(SEARCH.rounds):
        tried = _scaled(name, unit, scale)
        reached = max(plant_gap(bare.model_copy(update={table: {name: tried}}), rig), 1e-9)
        if (off := abs(math.log(reached / gap))) < nearest:
            nearest, best = off, tried
        if off < SEARCH.exact or (reached < gap and scale == most):
            break
        bounds[reached > gap] = scale
        scale = min(_next_scale(scale * gap / reached, scale, bounds), most)
    return best


def _next_scale(proposed: float, scale: float, bounds: list[float]) -> float:
    """Return the next scale: the proposed one, limited by scales that were too small and too large."""
    if bounds[0] < proposed < bounds[1]:
        return min(max(proposed, scale / SEARCH.stride), scale * SEARCH.stride)
    return math.sqrt(bounds[0] * bounds[1]) if bounds[0] > 0.0 else scale / SEARCH.retreat


def _scaled(name: str, unit: Coefficients, scale: float) -> Coefficients:
    if name in FOREIGN:
        amplitude = FOREIGN[name].amplitude.name
        return {**unit, amplitude: unit[amplitude] * scale}
    return {**unit, **{p.name: _allowed(p, unit[p.name] * scale) for p in EFFECTS[name].amplitudes}}


def _allowed(parameter: EffectParameter, value: float) -> float:
    return math.copysign(max(1.0, round(abs(value))), value) if parameter.whole else value

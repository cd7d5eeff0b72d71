"""How big an effect has to be to open a gap of a size: scale it until it does."""

import math
from dataclasses import dataclass

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig
from sim_device.plant.foreign import FOREIGN
from sim_device.trials.noiseless import plant_gap

Coefficients = dict[str, float]


@dataclass(frozen=True, slots=True)
class SizeSearch:
    """When the search for a scale ends, and how far it looks at a time."""

    exact: float = 0.04
    """How near a size comes to the gap wanted, as the logarithm of their ratio."""
    rounds: int = 9
    """Most scales tried; the nearest is kept."""
    stride: float = 20.0
    """Largest factor of the scale at once, either way."""
    retreat: float = 5.0
    """What the scale is divided by while every one tried was too large."""


SEARCH = SizeSearch()


def sized(plant: PlantConfig, rig: Rig, name: str, unit: Coefficients, gap: float) -> Coefficients:
    """Coefficients of an effect, scaled from `unit` until it alone opens a gap on the plant, in units of the noise.

    Where no size opens that gap they are those that come nearest.
    """
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
    """The scale in proportion, or the middle between one too small and one too large when that lies outside them."""
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

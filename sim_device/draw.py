"""Draw a plant whose effects nobody chose: what there is to find in a blind trial.

    single   one effect of the library            form      one of its families in another form
    pair     two, the smaller a fifth as visible   outside   one that the library does not hold
    triple   three, 1 : 0.45 : 0.2                 clean     none
    dirty    one or none, and faulty encoders       any       one of these

Sizes are drawn as the gap they open (`sim_device.visible`): at least twice the noise where they should be `clear`, half
to one and a half times where they should be `subtle`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from dpr_lab.rig import MASSES, Parameter, Rig
from sim_device.chance import Stream, generator
from sim_device.config import Encoders, PlantConfig, drawn
from sim_device.foreign import FOREIGN, FORMS, OUTSIDE
from sim_device.noiseless import plant_gap

Kind = Literal["single", "pair", "triple", "clean", "form", "outside", "dirty"]
Level = Literal["clear", "subtle"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LEVELS: dict[Level, tuple[float, float]] = {"clear": (2.0, 20.0), "subtle": (0.5, 1.5)}
"""Range of the gap over the noise."""

_KIND_NAMED: dict[str, Kind] = {kind: kind for kind in KINDS}
_LEVEL_NAMED: dict[str, Level] = {level: level for level in LEVELS}

ANY = "any"
"""Instead of a kind: chance chooses it too."""

SHARES: dict[Kind, tuple[float, ...]] = {"pair": (1.0, 0.2), "triple": (1.0, 0.45, 0.2)}
"""Gap of each effect over that of the largest, of which the smallest is to be clear."""

LARGEST = 40.0
"""Gap over the noise of the largest effect of a pair or triple, at most."""

EXACT = 0.04
"""How near a drawn size comes to the gap wanted, as the logarithm of their ratio."""

MAX_ROUNDS = 9

MASS_SPREAD = 0.15
"""How far a weighed part is from the plant file's value, relative."""
SCALES_STD = 1e-4
"""Of the scales that the parts are weighed on, kg."""

Coefficients = dict[str, float]


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to draw."""

    kind: Kind
    level: Level = "clear"
    effects: tuple[str, ...] = ()
    """Names instead of drawn ones, the largest first."""
    held_back: bool | None = None
    """Of foreign effects only those held back from tuning, only the others, or (None) all."""


def settled(text: str, seed: int) -> str:
    """What is wanted, with a kind drawn from the seed where it says `any`."""
    kind, colon, rest = text.partition(":")
    return f"{generator(seed, Stream.KIND).choice(KINDS) if kind == ANY else kind}{colon}{rest}"


def weighed(base: PlantConfig, rig: Rig) -> tuple[PlantConfig, Rig]:
    """A rig of other parts, drawn from the plant's seed: its masses, and the rig file after each has been weighed.

    Masses that the rig file gives as measured stay.
    """
    chance = generator(base.seed, Stream.RIG)
    drawn_masses = {name: base.parameters[name] * (1 + MASS_SPREAD * chance.uniform(-1, 1)) for name in MASSES}
    read = {name: float(mass + chance.normal(0, SCALES_STD)) for name, mass in drawn_masses.items()}
    known = {
        name: Parameter(nominal=rig.parameters[name].nominal, measured=read[name], std=SCALES_STD)
        for name in MASSES
        if rig.parameters[name].measured is None
    }
    masses = {name: drawn_masses[name] for name in known}
    return (
        base.model_copy(update={"parameters": {**base.parameters, **masses}}),
        rig.model_copy(update={"parameters": {**rig.parameters, **known}}),
    )


def parse_wanted(text: str) -> Wanted:
    """`KIND`, `KIND:LEVEL`, or `KIND:LEVEL:EFFECT,EFFECT`; `tuning` or `held_back` may stand for the effects.

    Raises:
        ConfigError: no such kind, level or effect.
    """
    said, _, rest = text.partition(":")
    size, _, names = rest.partition(":")
    kind, level = _KIND_NAMED.get(said), _LEVEL_NAMED.get(size or "clear")
    if kind is None or level is None:
        raise ConfigError(
            f"draw {text!r}: write KIND:LEVEL, with a kind of {', '.join(KINDS)} or {ANY}"
            f" and a level of {', '.join(LEVELS)}"
        )
    if names in ("tuning", "held_back"):
        return Wanted(kind, level, held_back=names == "held_back")
    effects = tuple(name for name in names.split(",") if name)
    unknown = [name for name in effects if name not in EFFECTS and name not in FOREIGN]
    if unknown:
        raise ConfigError(f"draw {text!r}: no effect {', '.join(unknown)}")
    return Wanted(kind, level, effects)


def draw_plant(wanted: Wanted, base: PlantConfig, rig: Rig) -> PlantConfig:
    """A plant around `base`, drawn from its seed.

    Raises:
        ConfigError: `base` does not belong to the rig.
    """
    plant = drawn(base.model_copy(update={"effects": {}, "foreign": {}}), rig)
    chance = generator(base.seed, Stream.DRAW)
    effects = wanted.effects or _chosen(wanted, chance)
    if wanted.kind == "dirty":
        plant = plant.model_copy(update={"encoders": dirty(chance)})
    shares = SHARES.get(wanted.kind, (1.0,))
    lower, upper = LEVELS[wanted.level]
    gap = _log_uniform(chance, lower, min(upper, LARGEST * min(shares))) / min(shares)
    for name, share in zip(effects, shares, strict=False):
        plant = _with_effect(plant, rig, name, gap * share, chance)
    return plant


def dirty(chance: np.random.Generator) -> Encoders:
    """Encoders with one or more of the faults that a real recording has."""
    faults = np.zeros(5, dtype=np.bool_)
    while not faults.any():
        faults = chance.random(5) < 0.4
    coarse, other, missing, jitter, repeats = faults
    noise = tuple(chance.uniform(0.3, 1.5, 3).tolist()) if other else (0.5, 0.5, 0.5)
    return Encoders(
        noise_counts=(0.0, 0.0, 0.0) if coarse else noise,
        step_counts=4 if coarse else 1,
        missing_share=chance.uniform(0.01, 0.02) if missing else 0.0,
        jitter_ms=0.2 if jitter else 0.0,
        repeated_share=0.01 if repeats else 0.0,
    )


def _chosen(wanted: Wanted, chance: np.random.Generator) -> tuple[str, ...]:
    """Names of the effects, the largest first."""
    if wanted.kind == "clean" or (wanted.kind == "dirty" and chance.random() < 0.5):
        return ()
    if wanted.kind in ("form", "outside"):
        names = [n for n in (FORMS if wanted.kind == "form" else OUTSIDE) if _takes_part(n, wanted.held_back)]
        return (str(chance.choice(names)),)
    chosen: list[str] = []
    for name in chance.permutation(visible_effects()).tolist():
        if not any(alike(name, other) for other in chosen):
            chosen.append(name)
    return tuple(chosen[: len(SHARES.get(wanted.kind, (1.0,)))])


def _takes_part(name: str, held_back: bool | None) -> bool:
    return held_back is None or FOREIGN[name].held_back == held_back


def visible_effects() -> list[str]:
    """Library effects that a free swing can show."""
    return [name for name, effect in EFFECTS.items() if not effect.absorbed_by]


def alike(name: str, other: str) -> bool:
    """Whether two effects are twins, cases of one another or of a third, so that together they are not two."""
    return not _relatives(name).isdisjoint(_relatives(other))


def _relatives(name: str) -> set[str]:
    return {name, *EFFECTS[name].twins, *EFFECTS[name].nested}


def _with_effect(plant: PlantConfig, rig: Rig, name: str, gap: float, chance: np.random.Generator) -> PlantConfig:
    """The plant with one more effect, scaled until it alone opens the gap wanted, or as near as its swings allow."""
    table = "foreign" if name in FOREIGN else "effects"
    bare = plant.model_copy(update={"effects": {}, "foreign": {}})
    unit = _foreign_unit(name, chance) if table == "foreign" else _library_unit(name, chance)
    most = FOREIGN[name].most / abs(unit[FOREIGN[name].amplitude.name]) if table == "foreign" else math.inf
    scale, bounds = 1.0, [0.0, math.inf]
    nearest, sized = math.inf, unit
    for _ in range(MAX_ROUNDS):
        tried = _scaled(name, unit, scale)
        reached = max(plant_gap(bare.model_copy(update={table: {name: tried}}), rig), 1e-9)
        if (off := abs(math.log(reached / gap))) < nearest:
            nearest, sized = off, tried
        if off < EXACT or (reached < gap and scale == most):
            break
        bounds[reached > gap] = scale
        scale = min(_next_scale(scale * gap / reached, scale, bounds), most)
    return plant.model_copy(update={table: {**getattr(plant, table), name: sized}})


def _next_scale(proposed: float, scale: float, bounds: list[float]) -> float:
    """The scale in proportion, or the middle between one too small and one too large when that lies outside them."""
    if bounds[0] < proposed < bounds[1]:
        return min(max(proposed, scale / 20), scale * 20)
    return math.sqrt(bounds[0] * bounds[1]) if bounds[0] > 0.0 else scale / 5


def _scaled(name: str, unit: Coefficients, scale: float) -> Coefficients:
    amplitudes = {FOREIGN[name].amplitude.name} if name in FOREIGN else {p.name for p in EFFECTS[name].amplitudes}
    sized = {key: value * scale if key in amplitudes else value for key, value in unit.items()}
    return {
        key: math.copysign(max(1.0, round(abs(value))), value) if key == COUNTED else value
        for key, value in sized.items()
    }


def _foreign_unit(name: str, chance: np.random.Generator) -> Coefficients:
    effect = FOREIGN[name]
    unit = {size.name: float(chance.uniform(size.lower, size.upper)) for size in (effect.amplitude, *effect.shape)}
    if effect.sign == "any":
        unit[effect.amplitude.name] *= float(chance.choice([-1.0, 1.0]))
    return unit


def _library_unit(name: str, chance: np.random.Generator) -> Coefficients:
    """Coefficients of an effect at about its typical size: free amplitudes of either sign, shapes over their range."""
    unit: Coefficients = {}
    for parameter in EFFECTS[name].parameters:
        if parameter.role == "shape":
            unit[parameter.name] = _shape(parameter.name, parameter.default, chance)
            continue
        one_way = parameter.sign == "positive" or parameter.name in RISING
        unit[parameter.name] = float(parameter.typical * chance.uniform(0.5, 1.5) * (one_way or chance.choice([-1, 1])))
    return unit


SHAPES: Mapping[str, tuple[float, float]] = {
    "order": (3, 24),
    "frequency_hz": (2.0, 20.0),
    "damping_ratio": (0.02, 0.3),
    "speed_rad_per_s": (0.2, 2.0),
    "length_rad": (0.01, 0.2),
    "joint": (1, 2),
    "run": (0, 2),
    "time_s": (1.0, 9.0),
}
"""Range of each shape parameter of the library; of those in `WHOLE` only whole values."""

WHOLE = ("order", "joint", "run")

COUNTED = "counts"
"""Amplitude that is a whole number and at least one."""

RISING = ("rate_Nm_per_rad", "cubic_Nm_per_rad3")
"""Amplitudes drawn positive though either sign is physical.

Friction that falls below nothing would drive the rods, and a spring that turns round would throw them out.
"""


def _shape(name: str, default: float, chance: np.random.Generator) -> float:
    lower, upper = SHAPES.get(name, (default / 3, default * 3))
    if name in WHOLE:
        return float(chance.integers(int(lower), int(upper), endpoint=True))
    return _log_uniform(chance, lower, upper)


def _log_uniform(chance: np.random.Generator, lower: float, upper: float) -> float:
    return float(np.exp(chance.uniform(np.log(lower), np.log(upper))))

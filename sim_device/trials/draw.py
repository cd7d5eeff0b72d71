"""Draw plants with effects for blind trials (`sim_device.trials.request`)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.encoder_drift import ENCODER_DRIFT
from dpr_lab.effects.encoder_offset import ENCODER_OFFSET_JOINT1, ENCODER_OFFSET_JOINT2
from dpr_lab.effects.wrong_length import WRONG_LENGTH
from dpr_lab.errors import ConfigError
from dpr_lab.rig import MASSES, Rig
from dpr_lab.rig_tables import Parameter
from sim_device.plant.config import EncoderConfig, MountConfig, PlantConfig
from sim_device.plant.foreign import FOREIGN, FORMS, OUTSIDE
from sim_device.random_streams import RandomStream, generator
from sim_device.trials.driven import drawn_fault, driven
from sim_device.trials.moving_arm import DRAW as ARM_DRAW
from sim_device.trials.moving_arm import drawn_arm, is_plausible, visible_on_arm, within_reach
from sim_device.trials.noiseless import plant_gap
from sim_device.trials.parameters import drawn
from sim_device.trials.request import LEVELS, ON_ARM, EffectRequest
from sim_device.trials.sizing import Coefficients, sized

NOT_DRAWN = frozenset(effect.name for effect in ENCODER_DRIFT)
"""Names of effects that are never drawn. They were added to the library after the published campaigns; drawing them
would change the plants of the same seeds."""

LARGEST = 40.0
"""Maximum gap of the largest effect in a pair or triple, in units of the noise."""


@dataclass(frozen=True, slots=True)
class Background:
    """Small effects that every real rig has in addition to its largest effect."""

    effects: tuple[int, int] = (3, 6)
    """Minimum and maximum number of these small effects."""
    gap: tuple[float, float] = (0.1, 0.6)
    """Range of the gap of each small effect, in units of the noise."""
    logger: float = 1 / 3
    """Probability of a fault of the logger; also the probability of a second fault if there is one."""
    stiffness: tuple[float, float] = (1e5, 5e5)
    """Range of the stiffness of the mount's second mode, N/m. The mode moves the rods by less than the noise."""
    frequency_hz: tuple[float, float] = (15.0, 40.0)
    damping: tuple[float, float] = (0.02, 0.05)
    length: float = 0.005
    """Standard deviation of the rod's length about L1 of the rig file, relative."""
    mass: float = 0.01
    """Standard deviation of the true masses about those in the rig file, relative."""


BACKGROUND = Background()


def draw_plant(wanted: EffectRequest, base: PlantConfig, rig: Rig) -> PlantConfig:
    """Draw a plant similar to `base`, from the seed of `base`.

    Raises:
        ConfigError: `base` does not belong to the rig.
    """
    plant = drawn(base.model_copy(update={"effects": {}, "foreign": {}}), rig)
    if wanted.kind == "driven":
        return driven(plant, drawn_fault(base.seed, wanted))
    rng = generator(base.seed, RandomStream.DRAW)
    if plant.arm.mode != "clamped":
        return _on_arm(wanted, drawn_arm(plant, rng), rig, rng)
    effects = wanted.effects or _chosen(wanted, rng)
    if wanted.kind == "dirty":
        plant = plant.model_copy(update={"encoders": dirty(rng)})
    shares = wanted.shares
    lower, upper = LEVELS[wanted.level]
    gap = _log_uniform(rng, lower, min(upper, LARGEST * min(shares))) / min(shares)
    for name, share in zip(effects, shares, strict=False):
        plant = _with_effect(plant, rig, name, gap * share, rng)
    return _with_background(plant, rig, rng) if wanted.kind == "background" else plant


def _on_arm(wanted: EffectRequest, plant: PlantConfig, rig: Rig, rng: np.random.Generator) -> PlantConfig:
    """Return the plant with effects at joint 0, or of the arm's drive, that its recordings show."""
    if wanted.kind not in ON_ARM:
        raise ConfigError(f"draw {wanted.kind}: not available with a moving arm; available: {', '.join(ON_ARM)}")
    if wanted.kind == "dirty":
        plant = plant.model_copy(update={"encoders": dirty(rng)})
    bare, none = plant, wanted.kind == "clean" or (wanted.kind == "dirty" and rng.random() < 0.5)
    names = list(wanted.effects) or rng.permutation(visible_on_arm(plant)).tolist()
    lower, upper = LEVELS[wanted.level]
    smallest = min(wanted.shares)
    largest = _log_uniform(rng, lower, min(upper, LARGEST * smallest)) / smallest
    for share in () if none else wanted.shares:
        before = plant
        while plant is before and names:
            name = names.pop(0)
            with_it = _with_effect(plant, rig, name, largest * share, rng)
            only = bare.model_copy(update={"effects": {name: with_it.effects[name]}})
            visible = bool(wanted.effects) or (
                is_plausible(only, rig) and plant_gap(only, rig) > ARM_DRAW.reached * largest * share
            )
            if visible and not any(alike(name, other) for other in plant.effects):
                plant = with_it
    return plant


def _with_background(plant: PlantConfig, rig: Rig, rng: np.random.Generator) -> PlantConfig:
    """Add the background to a plant: small effects, a zero offset, a vibrating mount and changed values.

    Some plants also get faults of the logger.
    """
    least, most = BACKGROUND.effects
    wanted = len(plant.effects) + int(rng.integers(least, most, endpoint=True))
    for name in rng.permutation(visible_effects()).tolist():
        if len(plant.effects) < wanted and not any(alike(name, other) for other in plant.effects):
            plant = _with_effect(plant, rig, name, _log_uniform(rng, *BACKGROUND.gap), rng)
    if rng.random() < BACKGROUND.logger:
        plant = plant.model_copy(update={"encoders": logger_fault(rng)})
    zero = (ENCODER_OFFSET_JOINT1, ENCODER_OFFSET_JOINT2)[int(rng.integers(2))].name
    if zero not in plant.effects:
        plant = _with_effect(plant, rig, zero, _log_uniform(rng, *BACKGROUND.gap), rng)
    values = plant.parameters | {
        name: plant.parameters[name] * float(1 + BACKGROUND.mass * rng.standard_normal()) for name in MASSES
    }
    longer = {WRONG_LENGTH.amplitudes[0].name: float(BACKGROUND.length * rig.L1 * rng.standard_normal())}
    effects = plant.effects if WRONG_LENGTH.name in plant.effects else plant.effects | {WRONG_LENGTH.name: longer}
    mount = MountConfig(
        stiffness_N_per_m=_log_uniform(rng, *BACKGROUND.stiffness),
        frequency_hz=float(rng.uniform(*BACKGROUND.frequency_hz)),
        damping_ratio=float(rng.uniform(*BACKGROUND.damping)),
    )
    return plant.model_copy(update={"parameters": values, "effects": effects, "mount": mount})


def described(wanted: EffectRequest, rig: Rig) -> Rig:
    """Return the rig file of a drawn plant, for dpr-lab.

    For plants with background effects, the rig file contains masses with an uncertainty of 1 %.
    """
    if wanted.kind != "background":
        return rig
    return rig.model_copy(update={"parameters": {**rig.parameters, **dict(_roughly_weighed(rig))}})


def _roughly_weighed(rig: Rig) -> Iterator[tuple[str, Parameter]]:
    for name in MASSES:
        if (measured := rig.parameters[name].measured) is not None:
            yield name, rig.parameters[name].model_copy(update={"std": BACKGROUND.mass * measured})


def logger_fault(rng: np.random.Generator) -> EncoderConfig:
    """Draw encoders with one or two faults of a logger.

    Samples can be late periodically, be taken at uneven times, or be missing for some time. They can also repeat the
    previous sample: periodically, periodically in a part of the recording (as in a video), or at random (busy bus).
    """
    cycle, begin = int(rng.integers(5, 41)), float(rng.uniform(0.5, 4.0))
    faults: list[dict[str, float]] = [
        {"late_every": cycle, "late_ms": float(rng.uniform(0.5, 4.0))},
        {"stale_every": cycle + 1},
        {"stale_every": int(rng.integers(3, 8)), "stale_from_s": begin, "stale_for_s": float(rng.uniform(0.5, 2.0))},
        {"repeated_share": float(rng.uniform(0.01, 0.05))},
        {"jitter_ms": 0.2},
        {"lost_from_s": begin, "lost_for_s": float(rng.uniform(0.1, 0.5))},
    ]
    chosen = rng.permutation(len(faults))[: 1 + int(rng.random() < BACKGROUND.logger)]
    together: dict[str, float] = {}
    for k in sorted(chosen.tolist()):
        together |= faults[k]
    return EncoderConfig.model_validate(together)


def dirty(rng: np.random.Generator) -> EncoderConfig:
    """Draw encoders with one or more of the faults of real recordings."""
    faults = np.zeros(5, dtype=np.bool_)
    while not faults.any():
        faults = rng.random(5) < 0.4
    coarse, other, missing, jitter, repeats = faults
    noise = tuple(rng.uniform(0.3, 1.5, 3).tolist()) if other else (0.5, 0.5, 0.5)
    return EncoderConfig(
        noise_counts=(0.0, 0.0, 0.0) if coarse else noise,
        step_counts=4 if coarse else 1,
        missing_share=rng.uniform(0.01, 0.02) if missing else 0.0,
        jitter_ms=0.2 if jitter else 0.0,
        repeated_share=0.01 if repeats else 0.0,
    )


def _chosen(wanted: EffectRequest, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the names of the effects, the largest first."""
    if wanted.kind == "clean" or (wanted.kind == "dirty" and rng.random() < 0.5):
        return ()
    if wanted.kind in ("form", "outside"):
        names = [n for n in (FORMS if wanted.kind == "form" else OUTSIDE) if _takes_part(n, wanted.held_back)]
        return (str(rng.choice(names)),)
    chosen: list[str] = []
    for name in rng.permutation(visible_effects()).tolist():
        if not any(alike(name, other) for other in chosen):
            chosen.append(name)
    return tuple(chosen[: len(wanted.shares)])


def _takes_part(name: str, held_back: bool | None) -> bool:
    return held_back is None or FOREIGN[name].held_back == held_back


def visible_effects() -> list[str]:
    """Return the library effects that are identifiable in a free swing, without those in `NOT_DRAWN`."""
    return [name for name, effect in OF_FREE_SWINGS.items() if not effect.absorbed_by and name not in NOT_DRAWN]


def alike(name: str, other: str) -> bool:
    """Return whether two effects are so similar that they would not count as two effects.

    They have the same signature, or one is a simpler form of the other, or they share such a relative.
    """
    return not _relatives(name).isdisjoint(_relatives(other))


def _relatives(name: str) -> set[str]:
    return {name, *EFFECTS[name].twins, *EFFECTS[name].nested}


def _with_effect(plant: PlantConfig, rig: Rig, name: str, gap: float, rng: np.random.Generator) -> PlantConfig:
    """Add an effect to a plant; the effect alone causes the requested gap, as nearly as possible."""
    table, unit = ("foreign", _foreign_unit) if name in FOREIGN else ("effects", _library_unit)
    coefficients = unit(name, rng)
    if plant.arm.mode != "clamped":
        coefficients = within_reach(plant.model_copy(update={"effects": {}}), rig, coefficients, rng)
    return plant.model_copy(update={table: {**getattr(plant, table), name: sized(plant, rig, name, coefficients, gap)}})


def _foreign_unit(name: str, rng: np.random.Generator) -> Coefficients:
    effect = FOREIGN[name]
    unit = {size.name: float(rng.uniform(size.lower, size.upper)) for size in (effect.amplitude, *effect.shape)}
    if effect.sign == "any":
        unit[effect.amplitude.name] *= float(rng.choice([-1.0, 1.0]))
    return unit


def _library_unit(name: str, rng: np.random.Generator) -> Coefficients:
    """Draw the coefficients of an effect near its typical size.

    The amplitudes have random signs, and the shapes lie within their ranges.
    """
    return {p.name: (_shape if p.role == "shape" else _amplitude)(p, rng) for p in EFFECTS[name].parameters}


def _amplitude(parameter: EffectParameter, rng: np.random.Generator) -> float:
    one_way = parameter.sign == "positive" or parameter.one_way
    return float(parameter.typical * rng.uniform(0.5, 1.5) * (one_way or rng.choice([-1, 1])))


def _shape(parameter: EffectParameter, rng: np.random.Generator) -> float:
    lower, upper = parameter.draw or (parameter.default / 3, parameter.default * 3)
    if parameter.whole:
        return float(rng.integers(int(lower), int(upper), endpoint=True))
    return _log_uniform(rng, lower, upper)


def _log_uniform(rng: np.random.Generator, lower: float, upper: float) -> float:
    return float(np.exp(rng.uniform(np.log(lower), np.log(upper))))

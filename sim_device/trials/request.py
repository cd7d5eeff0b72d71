"""What a blind trial asks to be drawn.

    single   one effect of the library            form      one of its families in another form
    pair     two, the smaller a fifth as visible   outside   one that the library does not hold
    triple   three, 1 : 0.45 : 0.2                 clean     none
    dirty    one or none, and faulty encoders       any       one of these
    driven   joints driven by torques that are reported, their drives with a fault or none; only where asked for
    background   one, three to six others near or below the noise, one in three with a logger's fault; only likewise

Sizes are drawn as the gap they open (`sim_device.trials.gap_size`): at least twice the noise where they should be
`clear`, half to one and a half times where they should be `subtle`.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from sim_device.plant.foreign import FOREIGN
from sim_device.random_streams import RandomStream, generator

Kind = Literal["single", "pair", "triple", "clean", "form", "outside", "dirty", "driven", "background"]
Level = Literal["clear", "subtle"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LEVELS: dict[Level, tuple[float, float]] = {"clear": (2.0, 20.0), "subtle": (0.5, 1.5)}
"""Range of the gap over the noise."""

_KIND_NAMED: dict[str, Kind] = {kind: kind for kind in KINDS}
_LEVEL_NAMED: dict[str, Level] = {level: level for level in LEVELS}

ANY = "any"
"""Instead of a kind: the seed chooses it too."""

FREE_SWINGS: tuple[Kind, ...] = tuple(kind for kind in KINDS if kind not in ("driven", "background"))
"""The kinds that `ANY` stands for."""

SHARES: dict[Kind, tuple[float, ...]] = {"pair": (1.0, 0.2), "triple": (1.0, 0.45, 0.2)}
"""Gap of each effect over that of the largest, of which the smallest is to be clear."""


@dataclass(frozen=True, slots=True)
class EffectRequest:
    """What to draw."""

    kind: Kind
    level: Level = "clear"
    effects: tuple[str, ...] = ()
    """Names instead of drawn ones, the largest first."""
    held_back: bool | None = None
    """Of out-of-library effects only those held back from tuning, only the others, or (None) all."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Gap of each effect over that of the largest."""
        return SHARES.get(self.kind, (1.0,))


def with_kind(text: str, seed: int) -> str:
    """What is asked for, with a kind drawn from the seed where it says `any`."""
    kind, colon, rest = text.partition(":")
    return f"{generator(seed, RandomStream.KIND).choice(FREE_SWINGS) if kind == ANY else kind}{colon}{rest}"


def parse_request(text: str) -> EffectRequest:
    """`KIND`, `KIND:LEVEL`, or `KIND:LEVEL:EFFECT,EFFECT`; `tuning` or `held_back` may stand for the effects.

    Raises:
        ConfigError: no such kind, level or effect.
    """
    kind_name, _, rest = text.partition(":")
    size, _, names = rest.partition(":")
    kind, level = _KIND_NAMED.get(kind_name), _LEVEL_NAMED.get(size or "clear")
    if kind is None or level is None:
        raise ConfigError(
            f"draw {text!r}: write KIND:LEVEL, with a kind of {', '.join(KINDS)} or {ANY}"
            f" and a level of {', '.join(LEVELS)}"
        )
    if names in ("tuning", "held_back"):
        return EffectRequest(kind, level, held_back=names == "held_back")
    effects = tuple(name for name in names.split(",") if name)
    unknown = [name for name in effects if name not in EFFECTS and name not in FOREIGN]
    if unknown:
        raise ConfigError(f"draw {text!r}: no effect {', '.join(unknown)}")
    return EffectRequest(kind, level, effects)

"""Requests for a blind trial: the kind, level and effects of a drawn plant.

    single       one effect of the library
    pair         two effects with gaps in the ratio 1 : 0.2
    triple       three effects with gaps in the ratio 1 : 0.45 : 0.2
    form         one effect of a family of the library, in another form
    outside      one effect that the library lacks
    clean        no effect
    dirty        one effect or none, and faulty encoders
    any          one of the kinds above
    driven       joints driven by reported torques, drives with a fault or none; only on request
    background   one effect, and three to six small effects near or below the noise; a third of the trials also have a
                 fault of the logger; only on request

Plants whose arm is free or driven have effects at joint 0 and of its drive, and the kinds `ON_ARM`.

Sizes are drawn by the gap that they cause (`sim_device.trials.gap_size`): at least twice the noise for `clear`, half to
one and a half times the noise for `subtle`, 0.1 to 1 times for `faint`. On plants like `paper` with 1000 readings per
second, the last range is about one to ten times the smallest size that the first release of the fixed menu shows.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from sim_device.plant.foreign import FOREIGN
from sim_device.random_streams import RandomStream, generator

Kind = Literal["single", "pair", "triple", "clean", "form", "outside", "dirty", "driven", "background"]
Level = Literal["clear", "subtle", "faint"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LEVELS: dict[Level, tuple[float, float]] = {"clear": (2.0, 20.0), "subtle": (0.5, 1.5), "faint": (0.1, 1.0)}
"""Range of the gap in units of the noise."""

_KIND_NAMED: dict[str, Kind] = {kind: kind for kind in KINDS}
_LEVEL_NAMED: dict[str, Level] = {level: level for level in LEVELS}

ANY = "any"
"""Name for any kind; the kind is then drawn from the seed too."""

FREE_SWINGS: tuple[Kind, ...] = tuple(kind for kind in KINDS if kind not in ("driven", "background"))
"""The kinds that `ANY` may select."""

ON_ARM: tuple[Kind, ...] = ("single", "pair", "triple", "clean", "dirty")
"""Kinds of plants with a free or driven arm."""

SHARES: dict[Kind, tuple[float, ...]] = {"pair": (1.0, 0.2), "triple": (1.0, 0.45, 0.2)}
"""Gap of each effect relative to the largest gap, such that the smallest effect is still clear."""


@dataclass(frozen=True, slots=True)
class EffectRequest:
    """Request for a drawn plant: kind, level and effects."""

    kind: Kind
    level: Level = "clear"
    effects: tuple[str, ...] = ()
    """Names of effects to use in place of drawn ones, the largest first; empty: all are drawn."""
    held_back: bool | None = None
    """Which out-of-library effects may be drawn: those excluded from tuning (True), the others (False), or all
    (None)."""

    @property
    def shares(self) -> tuple[float, ...]:
        """Gap of each effect relative to the largest gap."""
        return SHARES.get(self.kind, (1.0,))


def with_kind(text: str, seed: int, kinds: tuple[Kind, ...] = FREE_SWINGS) -> str:
    """Replace the kind `any` in a request by a kind that is drawn from the seed."""
    kind, colon, rest = text.partition(":")
    return f"{generator(seed, RandomStream.KIND).choice(kinds) if kind == ANY else kind}{colon}{rest}"


def parse_request(text: str) -> EffectRequest:
    """Parse `KIND`, `KIND:LEVEL` or `KIND:LEVEL:EFFECT,EFFECT`; the effects may be given as `tuning` or `held_back`.

    Raises:
        ConfigError: the kind, the level or an effect is unknown.
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

"""The unknowns of a fit: the ratios of the rods, the parameters of effects, and where every segment starts."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.base import BASE, RATIOS, base_from_ratios
from dpr_lab.dynamics.base import ratios as base_ratios
from dpr_lab.effects import SLICES
from dpr_lab.effects.effect import Effect
from dpr_lab.setup import Setup

Array = NDArray[np.float64]

UNKNOWN_RATIOS = (*RATIOS, "b", "p/b")
"""Order of `Estimate.ratios`: 1, 1, 1/s^2, 1/s, 1/s, kg m^2, 1."""

SCALE, ON_ELBOW = UNKNOWN_RATIOS.index("b"), UNKNOWN_RATIOS.index("p/b")
"""Places of b, which only what has a known weight makes visible, and of p / b, which only the inner rod alone does."""

FRICTION = tuple(i for i, name in enumerate(RATIOS) if name.startswith("c"))
"""Places of c1/b and c2/b, which cannot be negative."""


STRAIGHT = 0.15
"""Sine of an elbow's angle up to which the rods count as one line, whose gravity pulls one way."""


@dataclass(frozen=True, slots=True)
class DifferenceSteps:
    """Forward steps of derivatives: a slope that is off by a thousandth moves no solution of a fit."""

    ratio: float = 1e-5
    """Of a ratio, relative."""
    amplitude: float = 1e-3
    """Of an amplitude, of its typical size."""
    shape: float = 1e-5
    """Of a shape parameter likewise: a frequency off by 1e-3 is out of phase after ten seconds."""
    least_ratio: float = 1e-2
    """Size that a ratio counts with at least, in its own unit."""
    least_shape: float = 0.2
    """Lower bound of a refined shape parameter, of the first value of its scan."""


DIFFERENCE_STEPS = DifferenceSteps()


ZERO = "zero of an encoder"
"""What a zero that is put anew before each run belongs to, in place of an effect."""

ZERO_SIZE = 0.02
"""rad, of such a zero: what dry friction holds a hanging rod aside by."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One value of everything unknown."""

    ratios: Array
    """(7,) the five ratios, b, and p/b (nan where nobody asks), in the order of `UNKNOWN_RATIOS`."""
    params: Array
    """(SIZE,) parameters of all effects, SI."""
    initial: Array
    """(segments, 4) theta1, theta2, omega1, omega2 where each segment starts, rad and rad/s."""
    zeros: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(runs, 2) by how much the encoders of joints 1 and 2 read more in each run, rad; empty where they keep zero."""

    @property
    def base(self) -> Array:
        """(6,) base parameters, SI."""
        return self.ratios[SCALE] * base_from_ratios(self.ratios[: len(RATIOS)])

    @property
    def whole(self) -> Array:
        """(7,) base parameters of the whole rig, with p, SI."""
        return whole_of(self.ratios)


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """One unknown besides the initial states."""

    name: str
    effect: str | None
    """The effect it belongs to; none for a ratio, `ZERO` for a zero of one run."""
    index: int
    """Its place in `Estimate.ratios`, `Estimate.params` or the flat `Estimate.zeros`."""
    step: float
    """Forward step of its derivative."""
    lower: float = -np.inf
    size: float = 1.0
    """How large it may be expected to be."""
    overrides: tuple[tuple[int, float], ...] = ()
    """Entries of the parameters that hold only while this one is moved: the shape of an effect that is off."""
    amplitude: bool = True
    """Whether it says how much, not how."""

    def read(self, at: Estimate) -> float:
        """Its value in an estimate."""
        return float(_holder(self, at.ratios, at.params, at.zeros)[self.index])


def _holder(parameter: FreeParameter, ratios: Array, params: Array, zeros: Array) -> Array:
    """The one of the three that a parameter is part of, flat."""
    if parameter.effect is None:
        return ratios
    return zeros.reshape(-1) if parameter.effect == ZERO else params


def unknown_ratios(base: ArrayLike) -> Array:
    """(7,) the five ratios of base parameters, b, and p/b: of (7,) with p, or (6,) without."""
    values = np.asarray(base, dtype=np.float64)
    b = values[BASE.index("b")]
    return np.append(base_ratios(values[: len(BASE)]), [b, values[-1] / b if len(values) > len(BASE) else np.nan])


def with_scale(ratios: Array, b: float) -> Array:
    """(7,) ratios at another scale of all torques, b in kg m^2."""
    ratios = ratios.copy()
    ratios[SCALE] = b
    return ratios


def whole_of(ratios: Array) -> Array:
    """(..., 7) base parameters of the whole rig from (..., 7) ratios, b and p/b, SI; p is nan without p/b."""
    on_elbow = ratios[..., ON_ELBOW:] if ratios.shape[-1] > ON_ELBOW else np.full((*ratios.shape[:-1], 1), np.nan)
    unit = np.concatenate([base_from_ratios(ratios[..., : len(RATIOS)]), on_elbow], axis=-1)
    return ratios[..., SCALE, None] * unit


def visible_ratios(setups: Iterable[Setup], scale_visible: bool = False) -> tuple[int, ...]:
    """Places of the unknowns that runs can show; the others stay as they are given.

    Both rods free show the five ratios, and the inner one alone beside them p/b. Without any swing of both, e1/b and
    c1/b stand for e and c over the inertia of what swings, d/b for the outer rod's gravity where it hangs aside, and
    a/b for a second mounting.
    """
    setups = list(setups)
    seen = {setup.mounting for setup in setups}
    elbows = {setup.elbow for setup in setups if setup.mounting == "clamped"}
    aside = "outer" in seen or len(elbows) > 1 or any(abs(math.sin(elbow)) > STRAIGHT for elbow in elbows)
    if "both" in seen:
        ratios = {*range(len(RATIOS)), *([ON_ELBOW] if "inner" in seen else [])}
    else:
        names = {"c1/b", *(["e1/b"] if seen & {"inner", "clamped"} else []), *(["d/b"] if aside else [])}
        several = len(seen) + max(len(elbows) - 1, 0) > 1
        ratios = {RATIOS.index(name) for name in names | ({"a/b"} if several else set())}
    return tuple(sorted(ratios | ({SCALE} if scale_visible else set())))


def ratio_parameters(at: Estimate, visible: Iterable[int] = range(len(RATIOS))) -> tuple[FreeParameter, ...]:
    """Those of the unknown ratios that can be seen, by their places."""
    steps = DIFFERENCE_STEPS
    sizes = np.maximum(np.abs(at.ratios), steps.least_ratio).tolist()
    return tuple(
        FreeParameter(UNKNOWN_RATIOS[i], None, i, steps.ratio * sizes[i], 0.0 if i in FRICTION else -np.inf, sizes[i])
        for i in visible
    )


def zero_parameters(setups: Iterable[Setup]) -> tuple[FreeParameter, ...]:
    """The zeros of the encoders that are read, of each run its own."""
    return tuple(
        FreeParameter(f"zero{joint + 1}_of_run{run + 1}_rad", ZERO, 2 * run + joint, 1.0, size=ZERO_SIZE)
        for run, setup in enumerate(setups)
        for joint in range(1 if setup.alone else 2)
    )


def effect_parameters(
    effect: Effect, *, refined: bool = False, overrides: tuple[tuple[int, float], ...] = ()
) -> tuple[FreeParameter, ...]:
    """The amplitudes of an effect; where `refined`, also those shapes that vary continuously."""
    found, steps = [], DIFFERENCE_STEPS
    for index, parameter in enumerate(effect.parameters, start=SLICES[effect.name].start):
        amplitude = parameter.role == "amplitude"
        if amplitude:
            step, lower = steps.amplitude, 0.0 if parameter.sign == "positive" else -np.inf
        elif refined and parameter.continuous:
            step, lower = steps.shape, steps.least_shape * parameter.scan[0]
        else:
            continue
        size = parameter.typical
        found.append(FreeParameter(parameter.name, effect.name, index, step * size, lower, size, overrides, amplitude))
    return tuple(found)


def moved(at: Estimate, free: Sequence[FreeParameter], step: Array, initial_step: Array) -> Estimate:
    """The estimate a step further, no parameter beyond its bound."""
    ratios, params, zeros = at.ratios.copy(), at.params.copy(), at.zeros.copy()
    for parameter, change in zip(free, step.tolist(), strict=True):
        values = _holder(parameter, ratios, params, zeros)
        values[parameter.index] = max(values[parameter.index] + change, parameter.lower)
    return replace(at, ratios=ratios, params=params, initial=at.initial + initial_step, zeros=zeros)

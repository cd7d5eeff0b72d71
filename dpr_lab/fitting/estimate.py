"""Unknowns of a fit: ratios of the rods, effect parameters, and initial states."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, base_from_ratios
from dpr_lab.dynamics.base import ratios as base_ratios
from dpr_lab.effects import SIZE, SLICES
from dpr_lab.effects.effect import Effect
from dpr_lab.setup import Setup

UNKNOWN_RATIOS = (*RATIOS, "b", "p/b")
"""Order of `Estimate.ratios`; units 1, 1, 1/s^2, 1/s, 1/s, kg m^2, 1."""

SCALE, ON_ELBOW = UNKNOWN_RATIOS.index("b"), UNKNOWN_RATIOS.index("p/b")
"""Indices of b and of p/b in `Estimate.ratios`.

b is identifiable with a known mass, and p/b with a swing of the inner rod alone.
"""

EFFECTS_BEGIN, ZEROS_BEGIN = len(UNKNOWN_RATIOS), len(UNKNOWN_RATIOS) + SIZE
"""Indices in `Estimate.vector` of the first elements of the blocks `effects` and `zeros`."""

FRICTION = tuple(i for i, name in enumerate(RATIOS) if name.startswith("c"))
"""Indices of c1/b and c2/b in `Estimate.ratios`; both are not negative."""


STRAIGHT = 0.05
"""Maximum sine of an elbow's angle for which the rods count as aligned; their gravity torques are then parallel."""


@dataclass(frozen=True, slots=True)
class DifferenceSteps:
    """Increments of forward differences.

    A relative error of a derivative of 1e-3 does not change the solution of a fit.
    """

    ratio: float = 1e-5
    """Relative increment of a ratio."""
    amplitude: float = 1e-3
    """Increment of an amplitude, relative to its typical size."""
    dry_arm: float = 0.1
    """Relative increment of the Coulomb friction of an arm.

    With a smaller increment, the numerical effect of dividing steps at changes of direction would dominate.
    """
    geared: float = 1.0
    """Relative increment of a backlash with a motor behind it.

    With a smaller increment, the motor would cross the increment of the backlash within one step.
    """
    shape: float = 1e-5
    """Relative increment of a shape parameter.

    The value is small, because a relative frequency error of 1e-3 causes a phase error after ten seconds.
    """
    least_ratio: float = 1e-2
    """Lower limit of the size of a ratio in the computation of its increment, in the unit of the ratio."""
    least_shape: float = 0.2
    """Lower bound of a refined shape parameter, relative to the first value of its scan."""


DIFFERENCE_STEPS = DifferenceSteps()


ZERO_SIZE = 0.02
"""Typical zero offset of a hanging rod that is caused by stiction, rad."""

Block = Literal["ratios", "effects", "zeros"]
"""Names of the blocks of `Estimate.vector`, in their order."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Values of all unknowns: a flat vector with named blocks, and all initial states."""

    vector: Array
    """(7 + SIZE + 2 runs,) the blocks `ratios`, `effects` and `zeros` in this order, SI."""
    initial: Array
    """(segments, 4) initial states theta1, theta2, omega1, omega2, rad and rad/s."""

    @classmethod
    def of(cls, ratios: Array, params: Array, initial: Array, zeros: Array | None = None) -> "Estimate":
        """Create an estimate from its blocks.

        Args:
            ratios: (7,) five ratios, b and p/b
            params: (SIZE,) parameters of all effects, SI
            initial: (segments, 4) initial states
            zeros: (runs, 2) zero offsets of the encoders, rad; None unless encoders are zeroed before each run

        Raises:
            ValueError: a block has another length.
        """
        if (len(ratios), len(params)) != (EFFECTS_BEGIN, SIZE):
            raise ValueError(f"an estimate needs {EFFECTS_BEGIN} ratios and {SIZE} effect parameters")
        return cls(np.concatenate([ratios, params, np.zeros(0) if zeros is None else zeros.reshape(-1)]), initial)

    def changed(
        self,
        *,
        ratios: Array | None = None,
        params: Array | None = None,
        initial: Array | None = None,
        zeros: Array | None = None,
    ) -> "Estimate":
        """Return a copy of the estimate with some blocks replaced."""
        return Estimate.of(
            self.ratios if ratios is None else ratios,
            self.params if params is None else params,
            self.initial if initial is None else initial,
            self.zeros if zeros is None else zeros,
        )

    @property
    def ratios(self) -> Array:
        """(7,) five ratios, b and p/b, as in `UNKNOWN_RATIOS`; p/b may be nan."""
        return self.vector[:EFFECTS_BEGIN]

    @property
    def params(self) -> Array:
        """(SIZE,) parameters of all effects, SI."""
        return self.vector[EFFECTS_BEGIN:ZEROS_BEGIN]

    @property
    def zeros(self) -> Array:
        """(runs, 2) zero offsets of encoders 1 and 2, rad; empty if fixed."""
        return self.vector[ZEROS_BEGIN:].reshape(-1, 2)

    @property
    def base(self) -> Array:
        """(6,) base parameters, SI."""
        return self.ratios[SCALE] * base_from_ratios(self.ratios[: len(RATIOS)])

    @property
    def whole(self) -> Array:
        """(7,) base parameters of the whole rig, including p, SI."""
        return whole_of(self.ratios)


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """One free entry of `Estimate.vector`: its index, bounds and scale."""

    name: str
    block: Block
    place: int
    """Index in `Estimate.vector`."""
    step: float
    """Increment of the forward difference."""
    lower: float = -np.inf
    upper: float = np.inf
    size: float = 1.0
    """Expected order of magnitude."""
    effect: str = ""
    """Effect to which the parameter belongs; empty outside the block `effects`."""
    overrides: tuple[tuple[int, float], ...] = ()
    """Indices and values of entries that are changed only for the derivative with respect to this parameter.

    They define the shape of an effect that is off.
    """
    amplitude: bool = True
    """Whether the parameter is an amplitude; otherwise it is a shape parameter."""

    def read(self, estimate: Estimate) -> float:
        """Return the value that the parameter has in an estimate."""
        return float(estimate.vector[self.place])


def unknown_ratios(base: ArrayLike) -> Array:
    """Convert base parameters to the (7,) unknowns: five ratios, b and p/b.

    The base parameters have the shape (7,) with p, or (6,) without p.
    """
    values = np.asarray(base, dtype=np.float64)
    b = values[BASE.index("b")]
    return np.append(base_ratios(values[: len(BASE)]), [b, values[-1] / b if len(values) > len(BASE) else np.nan])


def with_scale(ratios: Array, b: float) -> Array:
    """Return the (7,) ratios after a change of b, the common scale of all torques, kg m^2."""
    ratios = ratios.copy()
    ratios[SCALE] = b
    return ratios


def whole_of(ratios: Array) -> Array:
    """Convert (..., 7) ratios, b and p/b to (..., 7) base parameters, SI.

    If p/b is nan, p is nan.
    """
    on_elbow = ratios[..., ON_ELBOW:] if ratios.shape[-1] > ON_ELBOW else np.full((*ratios.shape[:-1], 1), np.nan)
    unit = np.concatenate([base_from_ratios(ratios[..., : len(RATIOS)]), on_elbow], axis=-1)
    return ratios[..., SCALE, None] * unit


def alone_share(ratios: Array) -> float:
    """Return the inertia of the inner rod alone about joint 1, relative to b.

    Args:
        ratios: (7,) ratios, b and p/b
    """
    return float(ratios[RATIOS.index("a/b")] - ratios[ON_ELBOW])


def visible_ratios(setups: Iterable[Setup], scale_visible: bool = False) -> tuple[int, ...]:
    """Return the indices in `Estimate.ratios` of the unknowns that the runs determine.

    All other unknowns keep their values. Runs with two free rods determine the five ratios. Additional runs with only
    the inner rod also determine p/b. If joint 1 is prescribed, the outer rod determines d/b and c2/b. If no run has a
    swing of both rods, some elements have another meaning:

        e1/b, c1/b    gravity and friction, divided by the inertia of the swinging part
        d/b           gravity of the outer rod, if it does not hang in line with the inner rod
        a/b           ratio of the inertias of two mountings with the same friction c1
    """
    all_setups = list(setups)
    setups = [setup for setup in all_setups if setup.inner is None]
    if not setups:
        outer = {RATIOS.index("d/b"), RATIOS.index("c2/b")}
        return tuple(sorted(outer | ({SCALE} if scale_visible else set())))
    mountings = {setup.mounting for setup in setups}
    elbows = {setup.elbow for setup in setups if setup.mounting == "clamped"}
    aside = "outer" in mountings or len(elbows) > 1 or any(abs(math.sin(elbow)) > STRAIGHT for elbow in elbows)
    if "both" in mountings:
        ratios = {*range(len(RATIOS)), *([ON_ELBOW] if "inner" in mountings else [])}
    else:
        names = {"c1/b", *(["e1/b"] if mountings & {"inner", "clamped"} else []), *(["d/b"] if aside else [])}
        # several elbow angles alone leave a common factor of a + b, d, e1 and c1
        ratios = {RATIOS.index(name) for name in names | ({"a/b"} if len(mountings) > 1 else set())}
    return tuple(sorted(ratios | ({SCALE} if scale_visible else set())))


def ratio_parameters(estimate: Estimate, visible: Iterable[int] = range(len(RATIOS))) -> tuple[FreeParameter, ...]:
    """Return the free parameters for the ratios with the indices `visible` in `Estimate.ratios`."""
    steps = DIFFERENCE_STEPS
    sizes = np.maximum(np.abs(estimate.ratios), steps.least_ratio).tolist()
    lower = [0.0 if place in FRICTION else -np.inf for place in range(len(UNKNOWN_RATIOS))]
    return tuple(
        FreeParameter(
            UNKNOWN_RATIOS[place], "ratios", place, steps.ratio * sizes[place], lower[place], size=sizes[place]
        )
        for place in visible
    )


def zero_parameters(setups: Iterable[Setup]) -> tuple[FreeParameter, ...]:
    """Return the free zero offsets of the encoders of mounted rods, separate for each run."""
    encoders = ((run, joint) for run, setup in enumerate(setups) for joint in range(1 if setup.alone else 2))
    return tuple(
        FreeParameter(
            f"zero{joint + 1}_of_run{run + 1}_rad", "zeros", ZEROS_BEGIN + 2 * run + joint, 1.0, size=ZERO_SIZE
        )
        for run, joint in encoders
    )


def effect_parameters(
    effect: Effect,
    *,
    refined: bool = False,
    overrides: tuple[tuple[int, float], ...] = (),
    limits: Array | None = None,
) -> tuple[FreeParameter, ...]:
    """Return the free parameters for the amplitudes of an effect.

    If `refined` is true, the continuous shape parameters of the effect are included.

    Args:
        effect: the effect
        refined: whether continuous shape parameters are free
        overrides: shape values, as (index in `Estimate.params`, value), that are used for these derivatives only
        limits: (SIZE,) largest sizes of amplitudes, `dpr_lab.effects.limits`; None: no limits
    """
    parameters, steps = [], DIFFERENCE_STEPS
    places = tuple((EFFECTS_BEGIN + index, value) for index, value in overrides)
    for index, parameter in enumerate(effect.parameters, start=SLICES[effect.name].start):
        amplitude = parameter.role == "amplitude"
        if amplitude:
            upper = np.inf if limits is None else float(limits[index])
            step = steps.dry_arm if effect.dry and effect.of_arm else steps.amplitude
            step = steps.geared if effect.stage == "play0" else step
            lower = 0.0 if parameter.sign == "positive" else -upper
        elif refined and parameter.continuous:
            step, lower, upper = steps.shape, steps.least_shape * parameter.scan[0], np.inf
        else:
            continue
        size, place = parameter.typical, EFFECTS_BEGIN + index
        parameters.append(
            FreeParameter(
                parameter.name, "effects", place, step * size, lower, upper, size, effect.name, places, amplitude
            )
        )
    return tuple(parameters)


def moved(estimate: Estimate, free: Sequence[FreeParameter], step: Array, initial_step: Array) -> Estimate:
    """Apply a step to an estimate; every parameter stays within its bounds.

    Args:
        estimate: estimate before the step
        free: free parameters
        step: (free,) step of the free parameters
        initial_step: (segments, 4) step of the initial states
    """
    vector = estimate.vector.copy()
    for parameter, change in zip(free, step.tolist(), strict=True):
        vector[parameter.place] = min(max(vector[parameter.place] + change, parameter.lower), parameter.upper)
    return Estimate(vector, estimate.initial + initial_step)

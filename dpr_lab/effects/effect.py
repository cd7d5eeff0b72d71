"""What an effect is: a physical cause of a difference between simulation and rig, as data and one kernel."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

Stage = Literal["torque", "load", "arm", "timing", "encoder", "play"]
"""Where in the chain from forces to counts the kernel is called, and with what (`dpr_lab.effects.quantities`).

    torque   (motion, rods, known, vector, at) -> Terms           what moves the rods
    load     the same, once more with the joint forces known      friction that follows the load
    arm      (known, vector, at) -> Mount                         what holds the arm
    timing   (t, vector, at) -> (shift1, shift2)                  s added to the instants at which joints are read
    encoder  (angle1, angle2, t, run, known, vector, at) -> (added1, added2)    rad added to what encoders read
    play     (angle, held, vector, at) -> held                    angle that the encoder of joint 2 still holds

`vector` holds the parameters of all effects and `at` is the place of this effect's first one. A kernel is called only
while one of its amplitudes is not zero.
"""

Site = Literal["joint torque", "geometry", "base", "sensor", "timing"]


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """One coefficient.

    An amplitude of zero does nothing; an effect all of whose amplitudes are zero is off, whatever its shape parameters.
    """

    name: str
    """Spells its unit, as in `torque_Nm`."""
    unit: str
    typical: float
    """Size met on a laboratory rig, in `unit`."""
    sign: Literal["any", "positive"] = "any"
    """Which values are physical."""
    role: Literal["amplitude", "shape"] = "amplitude"
    default: float = 0.0
    """What a shape parameter is while nobody says otherwise; zero for an amplitude."""
    scan: tuple[float, ...] = ()
    """Values of a shape parameter to try before refining; empty: those that the recording offers (runs, instants)."""


def shape(name: str, unit: str, default: float, scan: tuple[float, ...] = ()) -> EffectParameter:
    """A shape parameter, positive, whose typical size is its default."""
    return EffectParameter(name, unit, default, "positive", "shape", default, scan)


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect."""

    name: str
    equation: str
    """What it adds, in the words of `physics.md`: torques on theta1, theta2, or changes of what is read."""
    parameters: tuple[EffectParameter, ...]
    site: Site
    stage: Stage
    kernel: Callable[..., Any]
    bench_check: str
    """What to do at the rig to confirm it, or to tell it from its twins."""
    source: str
    dissipative: bool = False
    """Whether it can only take energy out of the rods (presliding gives back no more than it has stored)."""
    potential: bool = False
    """Whether its torque is a function of the joint's angle alone."""
    twins: tuple[str, ...] = ()
    """Effects that free swings tell from this one not at all or hardly."""
    nested: tuple[str, ...] = ()
    """Simpler effects to prefer when they explain as much."""
    absorbed_by: tuple[str, ...] = ()
    """Base parameters that take this effect up exactly, so that a free swing cannot show it."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """The parameters that are zero when the effect is off."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "amplitude")

    @property
    def shapes(self) -> tuple[EffectParameter, ...]:
        """The parameters that say how, not how much."""
        return tuple(parameter for parameter in self.parameters if parameter.role == "shape")

"""The hidden effects of a sealed plant, revealed once the diagnosis is recorded."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dpr_lab.dynamics.base import BASE, base_parameters
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import DprError
from dpr_lab.rig import PARAMETERS, Rig

Coefficients = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class Truth:
    """Revealed truth of a plant."""

    effects: Coefficients
    """Library effects and their parameters, SI; torques at the plant's own scale."""
    foreign: str | None
    """The effect that is not in the library, or not in this form."""
    family: tuple[str, ...]
    """Library effects that would be a right answer for the foreign one."""
    held_back: bool
    """Whether the foreign effect is kept out of all tuning."""
    parameters: Mapping[str, float]
    """The nine true parameters, SI."""
    encoders: Mapping[str, Any]
    """What encoders and board add."""
    drawn: Mapping[str, Any] = field(default_factory=dict)
    """What was asked of the draw: kind, level, seed; empty for a plant that was not sealed."""

    @property
    def answers(self) -> tuple[tuple[str, ...], ...]:
        """For each cause that there is, the names that are right for it."""
        known = tuple((name,) for name in self.effects)
        return (*known, self.family) if self.family else known

    @property
    def outside(self) -> bool:
        """Whether the plant has a cause outside the library."""
        return self.foreign is not None and not self.family

    @property
    def clean(self) -> bool:
        """Whether there is nothing to find."""
        return not self.effects and self.foreign is None

    def sizes(self, rig: Rig, scale_b: float) -> dict[str, dict[str, float]]:
        """True amplitudes of the library effects, converted to the scale that the lab assumes.

        A free swing does not show the common scale of torques and inertias: the lab's are relative to a b that it
        holds, so that true torques and inertias are to be multiplied by scale_b / b of the plant.
        """
        Z = np.array([self.parameters[name] for name in PARAMETERS])
        larger = scale_b / float(base_parameters(Z, rig.L1, rig.g)[BASE.index("b")])
        return {
            name: {
                parameter.name: values[parameter.name] * larger**parameter.scale_power
                for parameter in EFFECTS[name].amplitudes
                if parameter.name in values
            }
            for name, values in self.effects.items()
        }


def read_truth(opened: Mapping[str, Any]) -> Truth:
    """The truth as the opened plant tells it."""
    foreign = next(iter(opened["foreign"]), None)
    return Truth(
        effects=opened["effects"],
        foreign=foreign,
        family=tuple(opened["family"].get(foreign, ())),
        held_back=foreign in opened["held_back"],
        parameters=opened["parameters"],
        encoders=opened["encoders"],
        drawn=opened.get("drawn", {}),
    )


def unsealed(opened: Mapping[str, Any], seal: str) -> Truth:
    """The truth of a plant whose seal was given away before.

    Raises:
        DprError: the revealed truth is not the sealed one.
    """
    text = opened["salt"] + json.dumps(opened["truth"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != seal:
        raise DprError(f"the opened plant is not the one that was sealed as {seal[:16]}...: this trial does not count")
    return read_truth(opened["truth"])

"""Truth of a sealed plant, which is revealed after the diagnosis."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dpr_lab.dynamics.base import BASE, RATIOS, base_parameters
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import DprError
from dpr_lab.rig import PARAMETERS, Rig

Coefficients = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class Truth:
    """Truth of a plant after it is revealed."""

    effects: Coefficients
    """Parameters of the effects of the library, SI, by effect; torques have the scale of the plant."""
    foreign: str | None
    """Name of an effect that the library does not contain, or not in this functional form; None without one."""
    family: tuple[str, ...]
    """Effects of the library that count as correct names of this out-of-library effect."""
    held_back: bool
    """Whether the out-of-library effect was excluded from all tuning of dpr-lab."""
    parameters: Mapping[str, float]
    """True values of the nine parameters, SI."""
    encoders: Mapping[str, Any]
    """Errors of the encoders and of the board."""
    drawn: Mapping[str, Any] = field(default_factory=dict)
    """Kind, level and seed that were requested; empty for a plant that was not sealed."""

    @property
    def answers(self) -> tuple[tuple[str, ...], ...]:
        """Correct names of each cause that can be named."""
        known = tuple((name,) for name in self.effects)
        return (*known, self.family) if self.family else known

    @property
    def outside(self) -> bool:
        """Whether the plant has a cause outside the library."""
        return self.foreign is not None and not self.family

    @property
    def clean(self) -> bool:
        """Whether the plant has no effect."""
        return not self.effects and self.foreign is None

    def sizes(self, rig: Rig, assumed: float) -> dict[str, dict[str, float]]:
        """Return the true amplitudes of the effects at the scale of the diagnosis, SI.

        A free swing does not determine the common scale of torques and inertias, so a diagnosis assumes an inertia
        (`assumed_inertia`). True torques and inertias are therefore multiplied by the ratio of this inertia, `assumed`,
        to that of the plant.
        """
        Z = np.array([self.parameters[name] for name in PARAMETERS])
        l1, _, m1, *_, J1, _ = Z.tolist()
        alone = J1 + m1 * l1**2
        b = float(base_parameters(Z, rig.L1, rig.g)[BASE.index("b")])
        larger = assumed / (alone if rig.rods.mounting == "inner" else b)
        return {
            name: {
                parameter.name: values[parameter.name] * larger**parameter.scale_power
                for parameter in EFFECTS[name].amplitudes
                if parameter.name in values
            }
            for name, values in self.effects.items()
        }


def assumed_inertia(diagnosis: Mapping[str, Any], rig: Rig) -> float:
    """Return the inertia, kg m^2, to which a diagnosis relates all sizes.

    This is b, or the inertia of the inner rod if only the inner rod is mounted.

    Args:
        diagnosis: output of `dpr-lab diagnose --json`
        rig: the rig file of the diagnosis
    """
    b = float(diagnosis["scale_b"])
    if rig.rods.mounting != "inner":
        return b
    fitted = diagnosis.get("fitted") or [*diagnosis["ratios"].values()]  # files of older versions lack `fitted`
    return b * (fitted[RATIOS.index("a/b")]["value"] - (diagnosis.get("p_over_b") or 0.0))


def read_truth(opened: Mapping[str, Any]) -> Truth:
    """Return the truth from the content of a revealed plant."""
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
    """Verify the published seal of a revealed plant, and return its truth.

    Raises:
        DprError: the revealed truth does not match the seal.
    """
    text = opened["salt"] + json.dumps(opened["truth"], sort_keys=True, separators=(",", ":"))
    if hashlib.sha256(text.encode()).hexdigest() != seal:
        raise DprError(f"the revealed plant does not match the seal {seal[:16]}...: this trial does not count")
    return read_truth(opened["truth"])

"""Shares of the gap: explained by effects, reproducible, varying between recordings, and noise."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from dpr_lab.gap.result.saved import Saved

Share = Annotated[float, Field(ge=0.0, le=1.0)]


@dataclass(frozen=True, slots=True)
class ChangedRig:
    """Limits beyond which a rig probably changed between its recordings."""

    share: float = 0.5
    """Minimum share of the mean squared residual that varying parameters must remove."""
    scatter: float = 0.05
    """Maximum relative scatter of a ratio between recordings of an unchanged rig."""


CHANGED_RIG = ChangedRig()


class VaryingParameter(Saved):
    """A parameter of the corrected model that differs between recordings."""

    effect: str
    """Name of the effect, a key of `dpr_lab.effects.EFFECTS`; empty for a ratio of the rods."""
    name: str
    """Name of the parameter."""
    values: dict[str, float]
    """Value of the parameter, SI, by recording or quarter. All other parameters have common values."""
    std: float
    """Standard deviation of one value due to noise and disturbances, SI."""
    spread: float
    """Standard deviation of the true value between recordings, SI: the scatter without the part due to `std`."""
    sigmas: float
    """Scatter of the values in units of `std`; 1 is expected by chance."""


class GapBudget(Saved):
    """Shares of the mean squared residual of the bare model; their sum is 1.

    Each recording is predicted from the other recordings. The shares are removed in this order: `explained` by the
    corrected model; `unmodelled` by free torques and encoder errors that are fitted to the other recordings; `varying`
    by parameters that are fitted to the recording itself.
    """

    basis: Literal["recordings", "pieces of one recording"]
    """Units that are predicted: whole recordings, or the quarters of a single recording."""
    explained: Share
    """Share that the corrected model removes."""
    varying: Share
    """Share that parameters with different values in the recordings remove."""
    unmodelled: Share
    """Reproducible share that no effect of the model explains."""
    not_reproducible: Share
    """Share above the noise that differs from recording to recording."""
    noise: Share
    """Share that the noise of the readings causes."""
    parameters: list[VaryingParameter] = []
    """Parameters that differ between recordings, most significant first."""
    undecided: str = ""
    """Reason why the shares cannot be determined; empty if they are determined.

    If they are not determined, the unexplained part counts as not reproducible.
    """

    @property
    def of_gap(self) -> float | None:
        """Explained share of the mean squared gap; None without a gap."""
        above = 1 - self.noise
        return self.explained / above if above > 0 and not self._no_gap else None

    @property
    def of_reproducible(self) -> float | None:
        """Explained share of the reproducible part of the gap; None if this part is zero or not determined."""
        reproducible = self.explained + self.unmodelled
        return self.explained / reproducible if reproducible > 0 and not self.undecided else None

    @property
    def changed_ratio(self) -> VaryingParameter | None:
        """Ratio that differs between recordings by more than an unchanged rig allows.

        The value is None if there is no such ratio. Friction ratios are not considered.
        """
        if self.basis != "recordings" or self.varying < CHANGED_RIG.share:
            return None
        for parameter in self.parameters:
            if not parameter.effect and not parameter.name.startswith("c"):
                if parameter.spread > CHANGED_RIG.scatter * np.abs(np.mean([*parameter.values.values()])):
                    return parameter
        return None

    @property
    def _no_gap(self) -> bool:
        return bool(self.undecided) and self.explained == 0

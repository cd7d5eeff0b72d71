"""What of the gap is reproducible, and what of that is explained."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(allow_inf_nan=False)]
Share = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1.0)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class VaryingParameter(_Part):
    """A parameter of the corrected model that differs between recordings."""

    effect: str
    """A name of `dpr_lab.effects.EFFECTS`; empty for a ratio of the rods."""
    name: str
    """The parameter."""
    values: dict[str, Number]
    """Recording or piece -> its value there, all others being common, SI."""
    std: Number
    """Standard deviation of such a value by noise and disturbances, SI."""
    spread: Number
    """Standard deviation between recordings, that of each value taken off, SI."""
    sigmas: Number
    """How far the values scatter, in standard deviations of one value; 1 = chance."""


class GapBudget(_Part):
    """Mean squared residual of the bare model, split by what removes it; the shares sum to 1.

    Each recording is predicted from the others. Removed are, in this order: what the corrected model explains, what
    free torques and encoder errors fitted to the others explain beyond it, and what parameters fitted to the recording
    itself explain beyond that.
    """

    basis: Literal["recordings", "pieces of one recording"]
    """What is predicted from the others: whole recordings, or the quarters of the only one."""
    explained: Share
    """By the named effects; it carries over to other recordings."""
    varying: Share
    """By parameters that differ between recordings."""
    unmodelled: Share
    """Reproducible, and in no effect of the model."""
    not_reproducible: Share
    """Different in each recording, above the noise."""
    noise: Share
    """Noise of the readings."""
    parameters: list[VaryingParameter] = []
    """Those that differ, the one that differs most first."""
    undecided: str = ""
    """Why the budget cannot be decided; what is not explained then counts as not reproducible. Else empty."""

    @property
    def of_gap(self) -> float | None:
        """Share of the mean squared gap above the noise that is explained; None where there is no gap."""
        above = 1 - self.noise
        return self.explained / above if above > 0 and not self._no_gap else None

    @property
    def of_reproducible(self) -> float | None:
        """Share of its reproducible part; None where nothing is known to be reproducible."""
        whole = self.explained + self.unmodelled
        return self.explained / whole if whole > 0 and not self.undecided else None

    @property
    def _no_gap(self) -> bool:
        return bool(self.undecided) and self.explained == 0

"""How far a diagnosis is to be trusted on one rig: blind trials on plants that are like it."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(allow_inf_nan=False)]

NOTHING = "nothing"
"""In place of a name, where there is no effect or none was named."""


REFUSED = "refused"
"""In place of a verdict, where a plant's recordings could not be diagnosed."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class TrustTrial(_Part):
    """One plant at the fitted point, recorded as the rig was, and its diagnosis."""

    kind: Literal["as found", "another", "clean"]
    """Its effects: those that were named, one drawn from the library, or none."""
    truth: dict[str, dict[str, Number]]
    """Its effects with all parameters, SI."""
    named: list[str]
    verdict: str
    """That of the diagnosis, or `REFUSED`."""
    right: list[str]
    """Effects of the truth that were named, alone or in a class that these recordings do not split."""
    wrong: list[str]
    """Names of what was not there."""
    seconds: Number


class ConfusionCell(_Part):
    """Frequency of naming one effect where another one was hidden."""

    true: str
    named: str
    trials: int


class TrustShare(_Part):
    """Frequency of an outcome in the blind trials."""

    held: int
    of: int
    interval90: tuple[Number, Number]
    """Of the share, by Wilson's score."""


class Trust(_Part):
    """Blind trials of a diagnosis and their summary."""

    seed: int
    seconds_each: Number
    """Median."""
    trials: list[TrustTrial]
    confusion: list[ConfusionCell]
    right: TrustShare
    """Trials with effects in which all of them were named, and nothing else."""
    wrong: TrustShare
    """Trials with effects in which something was named that was not there."""
    false_alarms: TrustShare
    """Clean trials in which something was named."""

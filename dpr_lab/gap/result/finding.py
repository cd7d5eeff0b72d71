"""Sensor fault of a recording, as it is saved."""

from dataclasses import dataclass, field
from typing import Annotated

from pydantic import BeforeValidator, ConfigDict, Field
from pydantic.json_schema import SkipJsonSchema


@dataclass(frozen=True, slots=True)
class SensorFinding:
    """A sensor fault that was detected without a model."""

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False, revalidate_instances="always")

    name: str
    """Kind of the sensor fault."""
    run: str
    """Name of the run."""
    axis: str | None
    """Encoder with the fault: `joint1`, `joint2` or `joint0`; None for all encoders."""
    at_s: float | None
    """Instant of the fault, s since the release; None for the whole run."""
    evidence: str
    """Description of the evidence."""
    count: int = 1
    """Number of faults of this kind; `at_s` is the instant of the first one."""
    step: Annotated[SkipJsonSchema[float | None], Field(exclude=True), BeforeValidator(lambda _: None)] = field(
        default=None, compare=False
    )
    """Size of the step of a reading, rad; None for other faults, and in a diagnosis."""

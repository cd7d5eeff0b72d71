"""Types of the results that commands print as JSON."""

from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from dpr_lab.certificate.document import Certificate
from dpr_lab.drift.changes import Drift
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel


class PrintedDiagnosis(Diagnosis):
    """What `dpr-lab diagnose --json` prints, and `diagnosis.json` of its folder."""

    files: dict[str, str] = Field(default={})
    """Name of each file that was written -> its path."""


class CheckedDiagnosis(Diagnosis):
    """What `dpr-lab check --json` prints: the diagnosis after a check, which `checks_done` lists last."""


class PrintedModel(Model):
    """What `dpr-lab identify --json` prints, and `model.json`."""

    model: str = ""
    """Path of the file that was written; not in the file itself."""


class PrintedMovingArm(MovingArmModel):
    """The same of a rig whose arm was free or driven."""

    model: str = ""
    """Path of the file that was written; not in the file itself."""


class DriftRun(BaseModel):
    """Estimates of one run: parameter -> value, SI."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]  # pyright: ignore[reportIncompatibleVariableOverride]

    name: str
    """Name of the run."""
    group: str
    """Name of its group."""


@dataclass(frozen=True, slots=True)
class PrintedDrift(Drift):
    """What `dpr-lab drift --json` prints."""

    drifted: bool
    """Whether any parameter changed significantly."""
    sentence: str
    """The result in words."""
    assumed_b: float | None
    """b that absolute sizes assume, kg m^2; null where the runs identify it."""
    runs: tuple[DriftRun, ...]
    """Estimates of each run, in the order of time."""
    torques: tuple[str, ...]
    """Kinds of the known torques that drove the runs."""
    files: dict[str, str]
    """Name of each file that was written -> its path."""


@dataclass(frozen=True, slots=True)
class PublishedSchema:
    """A type and the version of its schema, which rises when a reader of the last one would fail."""

    type: Any
    printed_by: str
    """Command with `--json`."""
    version: int = 1


SCHEMAS = {
    "diagnosis": PublishedSchema(PrintedDiagnosis, "diagnose, trials diagnose"),
    "model": PublishedSchema(PrintedModel | PrintedMovingArm, "identify"),
    "check": PublishedSchema(CheckedDiagnosis, "check"),
    "certificate": PublishedSchema(Certificate, "certify"),
    "drift": PublishedSchema(PrintedDrift, "drift"),
}
"""Name, as `dpr-lab schema` takes it -> what it describes."""
